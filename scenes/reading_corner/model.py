# Models the scene in Blender and exports it with Blender's own glTF exporter:
#   blender --background --python model.py
import math
import os

import bpy

here = os.path.dirname(os.path.abspath(__file__))
bpy.ops.wm.read_factory_settings(use_empty=True)


def image(name, size, colour_at):
    picture = bpy.data.images.new(name, size, size)
    pixels = []
    for y in range(size):
        for x in range(size):
            pixels += list(colour_at(x / size, y / size)) + [1.0]
    picture.pixels = pixels
    picture.pack()
    return picture


def planks(u, v):
    board = int(v * 8)
    seam = (v * 8) % 1.0 < 0.03 or (u + 0.37 * board) % 0.5 < 0.006
    grain = 0.06 * math.sin(90 * (v + 0.012 * math.sin(9 * u + 5 * board)) + 2.1 * board)
    tone = 0.62 + 0.07 * math.sin(12.9 * board) + grain
    if seam:
        tone *= 0.45
    return (tone, 0.70 * tone, 0.48 * tone)


def weave(u, v):
    ring = math.hypot(u - 0.5, v - 0.5)
    band = int(ring * 14) % 2
    return (0.55, 0.16, 0.14) if band else (0.78, 0.70, 0.58)


def material(name, colour, emission=None, strength=0.0, texture=None):
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    m.use_backface_culling = True  # one-sided: the exporter would mark everything doubleSided
    shader = m.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Metallic"].default_value = 0
    shader.inputs["Roughness"].default_value = 1
    if texture:
        node = m.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = texture
        m.node_tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    if emission:
        shader.inputs["Emission"].default_value = (*emission, 1)
        shader.inputs["Emission Strength"].default_value = strength
    return m


plaster = material("plaster", (0.76, 0.74, 0.70))
blue = material("blue paint", (0.25, 0.38, 0.52))
wood = material("wood", (0.42, 0.25, 0.13))
cloth = material("cloth", (0.62, 0.30, 0.16))
clay = material("clay", (0.70, 0.66, 0.60))
leaf = material("leaf", (0.16, 0.34, 0.10))
floor_wood = material("planks", (1, 1, 1), texture=image("planks", 256, planks))
rug_cloth = material("rug", (1, 1, 1), texture=image("weave", 128, weave))
bulb = material("bulb", (0.8, 0.8, 0.8), (1.0, 0.78, 0.52), 60)
window = material("window", (0.1, 0.1, 0.1), (0.72, 0.86, 1.0), 9)


def finish(name, mat, smooth=False):
    o = bpy.context.object
    o.name = name
    o.data.materials.clear()
    o.data.materials.append(mat)
    if smooth:
        bpy.ops.object.shade_smooth()
    return o


def plane(name, mat, size, location, rotation=(0, 0, 0)):
    bpy.ops.mesh.primitive_plane_add(size=1, location=location, rotation=rotation)
    o = finish(name, mat)
    o.scale = (size[0], size[1], 1)
    return o


def box(name, mat, size, location, rotation=(0, 0, 0), bevel=0.0):
    bpy.ops.mesh.primitive_cube_add(size=1, location=location, rotation=rotation)
    o = finish(name, mat)
    o.scale = size
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    if bevel:
        b = o.modifiers.new("bevel", "BEVEL")
        b.width, b.segments = bevel, 2
    return o


W, D, H = 4.0, 3.6, 2.6
right = math.pi / 2
plane("floor", floor_wood, (W, D), (0, 0, 0))
plane("ceiling", plaster, (W, D), (0, 0, H), (math.pi, 0, 0))
plane("back_wall", blue, (W, H), (0, D / 2, H / 2), (right, 0, 0))
plane("front_wall", plaster, (W, H), (0, -D / 2, H / 2), (-right, 0, 0))
plane("left_wall", plaster, (H, D), (-W / 2, 0, H / 2), (0, right, 0))
plane("right_wall", plaster, (H, D), (W / 2, 0, H / 2), (0, -right, 0))
plane("window", window, (1.2, 1.4), (-W / 2 + 0.01, 0.1, 1.45), (0, right, 0))
plane("rug", rug_cloth, (1.9, 1.9), (0.25, 0.1, 0.008))

# Arm chair
box("seat", cloth, (0.85, 0.80, 0.28), (0.75, 0.55, 0.34), (0, 0, -0.5), 0.05)
box("backrest", cloth, (0.85, 0.22, 0.70), (0.93, 0.87, 0.72), (-0.12, 0, -0.5), 0.06)
for side, x, y in (("left", 0.40, 0.72), ("right", 1.10, 0.34)):
    box(side + "_arm", cloth, (0.16, 0.78, 0.36), (x, y, 0.46), (0, 0, -0.5), 0.05)

# Side table with a vase and books
bpy.ops.mesh.primitive_cylinder_add(vertices=32, radius=0.34, depth=0.04, location=(-0.35, 0.55, 0.55))
finish("table_top", wood)
bpy.ops.mesh.primitive_cylinder_add(vertices=16, radius=0.035, depth=0.50, location=(-0.35, 0.55, 0.28))
finish("table_leg", wood, True)
bpy.ops.mesh.primitive_cylinder_add(vertices=32, radius=0.20, depth=0.03, location=(-0.35, 0.55, 0.016))
finish("table_foot", wood)
bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=14, radius=0.10, location=(-0.45, 0.62, 0.672))
vase = finish("vase", clay, True)
vase.scale = (1, 1, 1.05)
for k, (dx, dy, turn) in enumerate(((0, 0, 0.2), (0.01, 0.01, 0.45), (-0.01, 0, 0.05))):
    box("book%d" % k, (leaf, blue, clay)[k], (0.18, 0.13, 0.03), (-0.22 + dx, 0.50 + dy, 0.587 + 0.0305 * k), (0, 0, turn))

# Shelf on the back wall, with a head on it
box("shelf", wood, (1.3, 0.24, 0.03), (-0.9, D / 2 - 0.125, 1.35))
bpy.ops.mesh.primitive_monkey_add(size=0.34, location=(-1.1, D / 2 - 0.18, 1.55), rotation=(-0.1, 0, 0.35))
head = finish("head", clay, True)
sub = head.modifiers.new("smooth", "SUBSURF")
sub.levels = sub.render_levels = 1
for k in range(7):
    box("spine%d" % k, (cloth, blue, leaf, wood)[k % 4], (0.035 + 0.006 * (k % 3), 0.17, 0.20 + 0.015 * (k * 5 % 4)),
        (-0.72 + 0.06 * k, D / 2 - 0.14, 1.365 + 0.5 * (0.20 + 0.015 * (k * 5 % 4)) + 0.001))

# Standing lamp: a bulb in an open shade
bpy.ops.mesh.primitive_cylinder_add(vertices=32, radius=0.16, depth=0.03, location=(1.55, 1.3, 0.016))
finish("lamp_foot", wood)
bpy.ops.mesh.primitive_cylinder_add(vertices=12, radius=0.018, depth=1.45, location=(1.55, 1.3, 0.75))
finish("lamp_pole", wood, True)
bpy.ops.mesh.primitive_cone_add(vertices=32, radius1=0.26, radius2=0.16, depth=0.28, end_fill_type="NOTHING", location=(1.55, 1.3, 1.62))
shade = finish("lamp_shade", material("shade", (0.82, 0.78, 0.70)), True)
shade.data.materials[0].use_backface_culling = False  # the one two-sided surface
bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.055, location=(1.55, 1.3, 1.60))
finish("lamp_bulb", bulb, True)

# A plant: leaves are two-sided, too
bpy.ops.mesh.primitive_cone_add(vertices=24, radius1=0.13, radius2=0.19, depth=0.30, location=(-1.55, 1.35, 0.151))
finish("pot", clay, True)
two_sided_leaf = material("two-sided leaf", (0.16, 0.34, 0.10))
two_sided_leaf.use_backface_culling = False
for k in range(14):
    turn, lift = 2.4 * k, 0.55 + 0.05 * (k % 5)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=3, y_subdivisions=6, size=1, rotation=(0, -lift, turn),
                                    location=(-1.55 + 0.16 * math.cos(turn), 1.35 + 0.16 * math.sin(turn), 0.55 + 0.02 * k))
    blade = finish("leaf%d" % k, two_sided_leaf, True)
    for vertex in blade.data.vertices:
        along = vertex.co.x + 0.5
        vertex.co.y *= 0.22 * math.sin(math.pi * (0.08 + 0.86 * along))
        vertex.co.x *= 0.42
        vertex.co.z += 0.12 * along * (1 - along) - 0.10 * along * along

bpy.ops.object.camera_add(location=(0.2, -1.72, 1.42), rotation=(1.42, 0, 0.06))
camera = bpy.context.object
camera.name = "reader"
camera.data.angle = 1.35

bpy.ops.export_scene.gltf(filepath=os.path.join(here, "reading_corner.glb"), export_format="GLB", export_apply=True,
                          export_cameras=True, export_lights=False, export_normals=True, export_texcoords=True)
