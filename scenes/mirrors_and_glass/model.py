"""Writes the four scenes of this folder: python3 model.py"""
import base64
import json
import math
import struct


def quad(a, b, c, d):
    return [a, b, c, d]


def box(low, high, inward=False):
    """Faces of an axis-parallel box, counter-clockwise from outside, or from inside."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    faces = {
        "x0": [(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)],
        "x1": [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
        "y0": [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
        "y1": [(x0, y1, z0), (x0, y1, z1), (x1, y1, z1), (x1, y1, z0)],
        "z0": [(x0, y0, z0), (x0, y1, z0), (x1, y1, z0), (x1, y0, z0)],
        "z1": [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
    }
    return {k: v[::-1] if inward else v for k, v in faces.items()}


def turned(faces, angle, centre):
    """Faces turned about the vertical through `centre`."""
    c, s = math.cos(angle), math.sin(angle)
    def turn(p):
        x, z = p[0] - centre[0], p[2] - centre[1]
        return (centre[0] + c * x + s * z, p[1], centre[1] - s * x + c * z)
    return {k: [turn(p) for p in v] for k, v in faces.items()}


def look(position, target):
    """Rotation of a camera (quaternion x, y, z, w) that looks from position to target."""
    f = [t - p for p, t in zip(position, target)]
    length = math.sqrt(sum(x * x for x in f))
    f = [x / length for x in f]
    yaw, pitch = math.atan2(-f[0], -f[2]), math.asin(f[1])
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    return [cy * sp, sy * cp, -sy * sp, cy * cp]


def write(name, title, materials, surfaces, camera):
    data, views, accessors, meshes, nodes = b"", [], [], [], []
    names = list(materials)
    for surface, material, polygons in surfaces:
        points = [p for polygon in polygons for p in polygon]
        indices = []
        for k in range(len(polygons)):
            indices += [4 * k, 4 * k + 1, 4 * k + 2, 4 * k, 4 * k + 2, 4 * k + 3]
        for part, kind, count in ((b"".join(struct.pack("<3f", *p) for p in points), "VEC3", len(points)),
                                  (struct.pack("<%dI" % len(indices), *indices), "SCALAR", len(indices))):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
            accessors.append({"bufferView": len(views) - 1, "componentType": 5126 if kind == "VEC3" else 5125,
                              "type": kind, "count": count})
            data += part
        accessors[-2]["min"] = [min(p[i] for p in points) for i in range(3)]
        accessors[-2]["max"] = [max(p[i] for p in points) for i in range(3)]
        meshes.append({"primitives": [{"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1,
                                       "material": names.index(material)}]})
        nodes.append({"name": surface, "mesh": len(meshes) - 1})
    position, target, yfov = camera
    nodes.append({"name": "camera", "camera": 0, "translation": list(position), "rotation": look(position, target)})
    doc = {
        "asset": {"version": "2.0", "copyright": "CC0-1.0", "extras": {"title": title}},
        "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes, "meshes": meshes,
        "materials": [dict(m, name=n) for n, m in materials.items()],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data),
                     "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": yfov, "znear": 0.01}}],
        "extensionsUsed": ["KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_ior"],
    }
    with open(name + ".gltf", "w") as file:
        json.dump(doc, file, indent=1)
        file.write("\n")


def paint(r, g, b):
    return {"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [r, g, b, 1]}}


def lamp(exitance):
    return {"extras": {"farol": {"diffuse": [0, 0, 0], "emission": exitance}}}


def mirror(s):
    return {"pbrMetallicRoughness": {"metallicFactor": 1, "roughnessFactor": 0, "baseColorFactor": [s, s, s, 1]}}


def glass(ior):
    return {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0, "baseColorFactor": [1, 1, 1, 1]},
            "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
                           "KHR_materials_ior": {"ior": ior},
                           "KHR_materials_volume": {"thicknessFactor": 1}}}


def room(x, y, z, paints):
    return [(k, paints.get(k, "white"), [v]) for k, v in box((0, 0, 0), (x, y, z), inward=True).items()]


PAINTS = {"white": paint(0.75, 0.75, 0.72), "wood": paint(0.45, 0.3, 0.18), "red": paint(0.6, 0.12, 0.08),
          "blue": paint(0.1, 0.2, 0.55), "green": paint(0.15, 0.45, 0.15), "orange": paint(0.75, 0.4, 0.08)}


def mirror_room():
    """A mirror on the far wall: a block is orange on the side one sees, blue on the side that only the mirror sees."""
    surfaces = room(4, 2.6, 5, {"y0": "wood", "x0": "red", "x1": "green"})
    m = box((0.7, 0.5, 0.03), (2.9, 2.2, 0.06))
    surfaces += [("mirror", "mirror", [m["z1"]]), ("frame", "wood", [m[k] for k in ("x0", "x1", "y0", "y1", "z0")])]
    b = turned(box((1.6, 0.0, 1.6), (2.4, 0.9, 2.4)), 0.5, (2.0, 2.0))
    surfaces += [("block front", "orange", [b["z1"], b["x1"]]), ("block back", "blue", [b["z0"], b["x0"]]),
                 ("block top", "white", [b["y1"]])]
    surfaces.append(("lamp", "lamp", [box((1.6, 2.5, 2.6), (2.4, 2.55, 3.4))["y0"]]))
    write("mirror_room", "A room with a mirror", dict(PAINTS, mirror=mirror(0.9), lamp=lamp([60, 56, 48])), surfaces,
          ((3.2, 1.5, 4.8), (1.7, 1.1, 0), 0.85))


def light_pipe():
    """A square pipe of mirrors brings the light of a lamp on the roof into a room without any other light."""
    x, y, z, low, high, top = 3.0, 2.4, 3.0, 1.25, 1.75, 5.0
    faces = box((0, 0, 0), (x, y, z), inward=True)
    surfaces = [(k, {"y0": "wood", "x0": "blue"}.get(k, "white"), [faces[k]]) for k in ("x0", "x1", "y0", "z0", "z1")]
    def ceiling(x0, z0, x1, z1):
        return box((x0, 0, z0), (x1, y, z1), inward=True)["y1"]
    surfaces.append(("ceiling", "white", [ceiling(0, 0, x, low), ceiling(0, high, x, z), ceiling(0, low, low, high),
                                          ceiling(high, low, x, high)]))
    pipe = box((low, y, low), (high, top, high), inward=True)
    surfaces.append(("pipe", "mirror", [pipe[k] for k in ("x0", "x1", "z0", "z1")]))
    surfaces.append(("lamp", "lamp", [pipe["y1"]]))
    b = turned(box((0.7, 0, 0.8), (1.2, 0.6, 1.3)), 0.4, (0.95, 1.05))
    surfaces.append(("block", "orange", [b[k] for k in ("x0", "x1", "y1", "z0", "z1")]))
    write("light_pipe", "A light pipe", dict(PAINTS, mirror=mirror(0.95), lamp=lamp([300, 300, 300])), surfaces,
          ((2.8, 1.5, 2.9), (1.1, 1.0, 0.6), 1.1))


def glass_block():
    """A block of glass above a floor, and a small bright lamp: light through the glass gathers on the floor and wall."""
    surfaces = room(2.4, 1.8, 2.4, {"x0": "red", "x1": "blue"})
    b = turned(box((0.9, 0.15, 0.9), (1.5, 0.75, 1.5)), 0.6, (1.2, 1.2))
    surfaces.append(("glass", "glass", list(b.values())))
    surfaces.append(("lamp", "lamp", [box((1.75, 1.7, 1.1), (1.95, 1.72, 1.3))["y0"]]))
    write("glass_block", "A glass block", dict(PAINTS, glass=glass(1.5), lamp=lamp([260, 250, 230])), surfaces,
          ((1.2, 1.15, 2.35), (1.15, 0.45, 0.6), 0.95))


def facing_mirrors():
    """Two mirrors face each other: images without end."""
    surfaces = room(3, 2.4, 4, {"y0": "wood", "z0": "red", "z1": "green"})
    for name, face, low, high in (("left mirror", "x1", (0.02, 0.3, 0.6), (0.05, 2.1, 3.4)),
                                  ("right mirror", "x0", (2.95, 0.3, 0.6), (2.98, 2.1, 3.4))):
        m = box(low, high)
        surfaces += [(name, "mirror", [m[face]]),
                     (name + " frame", "wood", [v for k, v in m.items() if k != face])]
    b = turned(box((1.2, 0, 1.4), (1.7, 0.8, 1.9)), 0.3, (1.45, 1.65))
    surfaces.append(("block", "orange", [b[k] for k in ("x0", "x1", "y1", "z0", "z1")]))
    surfaces.append(("lamp", "lamp", [box((1.1, 2.3, 1.6), (1.9, 2.32, 2.4))["y0"]]))
    write("facing_mirrors", "Two mirrors facing each other", dict(PAINTS, mirror=mirror(0.9), lamp=lamp([50, 47, 40])),
          surfaces, ((2.5, 1.5, 3.2), (0.0, 0.9, 1.5), 0.95))


for make in (mirror_room, light_pipe, glass_block, facing_mirrors):
    make()
