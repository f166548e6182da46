// A scene as read from a file, checked: triangles in world coordinates, materials, cameras, lights.
// Lengths are in the file's units, double precision; nothing here knows of patches or of a GPU.
#pragma once

#include "base/log.h"
#include "scene/material.h"

#include <array>
#include <string>
#include <vector>

namespace farol {

// One primitive of one node. Attribute arrays are empty or as long as `positions`.
struct Surface {
  std::string name;  // unique: node name, "#k" from its second primitive on, "~k" for equal names
  uint32_t material = 0;
  std::vector<Vec3> positions;  // [scene units]
  std::vector<Vec3> normals;    // shading normals, unit length; used for smooth display only
  std::array<std::vector<Vec2>, 2> texcoords;
  std::vector<Rgb> colors;                         // linear
  std::vector<std::array<uint32_t, 3>> triangles;  // counter-clockwise seen from the front
};

struct Camera {
  std::string name;
  Vec3 position{0}, forward{0, 0, -1}, up{0, 1, 0};  // forward and up: unit vectors at right angles
  double verticalFov = 0.7;                          // [rad]; unused when orthographic
  bool orthographic = false;
  double halfWidth = 1, halfHeight = 1;  // orthographic: half extents [scene units]
  bool frontFacesOnly = false;           // leave out faces seen from behind: a view into a closed room from outside
};

// KHR_lights_punctual; kept for the direct-light stage.
struct PunctualLight {
  enum class Kind { point, spot, directional };
  std::string name;
  Kind kind = Kind::point;
  Vec3 position{0}, direction{0, 0, -1};      // direction: unit vector along which light leaves
  Rgb intensity{0};                           // candela, or lux for directional
  double range = 0;                           // [scene units]; 0: unlimited
  double innerCone = 0, outerCone = kPi / 4;  // half angles [rad]
  std::vector<uint32_t> mirrors = {};         // of an image: those on the way to the light (light/lamp_images.h)
};

struct Scene {
  std::string path;
  std::vector<Surface> surfaces;
  std::vector<Material> materials;
  std::vector<Texture> textures;
  std::vector<Camera> cameras;
  std::vector<PunctualLight> lights;
};

// Reads glTF 2.0 (.gltf, .glb). Throws Error with one sentence (file, object, found, allowed) for
// anything that cannot be used; what is merely left out is said once through the log.
Scene loadScene(const std::string& path, Log& log);

// The camera called `name`, the first one when `name` is empty, or a view of the whole scene from
// outside when the file has none. Throws when no camera has that name, listing those that exist.
Camera chooseCamera(const Scene& scene, const std::string& name);

}  // namespace farol
