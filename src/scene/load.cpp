#include "base/error.h"
#include "scene/accessor.h"
#include "scene/document.h"
#include "scene/material_load.h"
#include "scene/scene.h"

#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>
#include <glm/matrix.hpp>
#include <set>
#include <utility>

namespace farol {
namespace {

using Mat4 = glm::dmat4;

double triangleArea(const Vec3& a, const Vec3& b, const Vec3& c) { return 0.5 * glm::length(glm::cross(b - a, c - a)); }

class Loader {
 public:
  Loader(const std::string& path, Log& log) : document_(readDocument(path)), log_(log) { scene_.path = path; }

  Scene run() {
    readModel();
    scene_.materials = loadMaterials(document_, log_);
    scene_.textures = loadTextures(document_, model_);
    for (const size_t root : roots()) walk(root, Mat4(1.0));
    sayWhatWasLeftOut();
    if (triangles_ == 0) throw Error("{}: the scene has no triangles", document_.path);
    return std::move(scene_);
  }

 private:
  [[noreturn]] void fail(const std::string& who, const std::string& what) const {
    throw Error("{}: {}: {}", document_.path, who, what);
  }

  void readModel() {
    tinygltf::TinyGLTF reader;
    std::string error, warning;
    const std::string folder = std::filesystem::path(document_.path).parent_path().string();
    const auto size = static_cast<unsigned int>(document_.bytes.size());
    bool good = false;
    try {
      good = document_.binary ? reader.LoadBinaryFromMemory(&model_, &error, &warning, document_.bytes.data(), size, folder)
                              : reader.LoadASCIIFromString(&model_, &error, &warning,
                                                           reinterpret_cast<const char*>(document_.bytes.data()), size, folder);
    } catch (const std::exception& e) {
      error = e.what();
    }
    document_.bytes.clear();
    document_.bytes.shrink_to_fit();
    while (!error.empty() && (error.back() == '\n' || error.back() == ' ')) error.pop_back();
    while (!warning.empty() && (warning.back() == '\n' || warning.back() == ' ')) warning.pop_back();
    if (!good) fail("file", error.empty() ? "cannot be read as glTF" : error);
    if (!warning.empty()) log_.warn({"gltf-reader", fmt::format("{}: {}", document_.path, warning)});
  }

  std::vector<size_t> roots() const {
    std::vector<size_t> result;
    if (!model_.scenes.empty()) {
      const size_t chosen = model_.defaultScene >= 0 ? static_cast<size_t>(model_.defaultScene) : 0;
      for (const int node : model_.scenes[chosen].nodes) result.push_back(static_cast<size_t>(node));
      return result;
    }
    std::set<size_t> children;
    for (const auto& node : model_.nodes) {
      for (const int child : node.children) children.insert(static_cast<size_t>(child));
    }
    for (size_t i = 0; i < model_.nodes.size(); ++i) {
      if (!children.contains(i)) result.push_back(i);
    }
    return result;
  }

  Mat4 localMatrix(const tinygltf::Node& node, const std::string& who) const {
    const auto finite = [&](const std::vector<double>& v, size_t n, const char* key) {
      if (v.empty()) return false;
      if (v.size() != n) fail(who, fmt::format("{} has {} numbers, {} are needed", key, v.size(), n));
      return true;
    };
    Mat4 m(1.0);
    if (finite(node.matrix, 16, "matrix")) {
      for (int k = 0; k < 16; ++k) m[k / 4][k % 4] = node.matrix[static_cast<size_t>(k)];
      return m;
    }
    Vec3 t(0), s(1);
    glm::dquat r(1, 0, 0, 0);
    if (finite(node.translation, 3, "translation")) t = {node.translation[0], node.translation[1], node.translation[2]};
    if (finite(node.scale, 3, "scale")) s = {node.scale[0], node.scale[1], node.scale[2]};
    if (finite(node.rotation, 4, "rotation")) {
      r = glm::dquat(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]);
      if (glm::length(r) < 1e-12) fail(who, "rotation is zero");
      r = glm::normalize(r);
    }
    m = glm::mat4_cast(r);
    m[0] *= s.x;
    m[1] *= s.y;
    m[2] *= s.z;
    m[3] = glm::dvec4(t, 1.0);
    return m;
  }

  // The document check has shown that nodes form a forest, so this ends; an explicit stack keeps deep
  // chains off the program's own.
  void walk(size_t root, const Mat4& world) {
    std::vector<std::pair<size_t, Mat4>> stack{{root, world}};
    while (!stack.empty()) {
      const auto [index, parent] = stack.back();
      stack.pop_back();
      const tinygltf::Node& node = model_.nodes[index];
      const std::string name = node.name.empty() ? fmt::format("node{}", index) : node.name;
      const Mat4 matrix = parent * localMatrix(node, fmt::format("node '{}'", name));
      if (node.mesh >= 0) addMesh(static_cast<size_t>(node.mesh), name, matrix, node.skin >= 0);
      if (node.camera >= 0) addCamera(model_.cameras[static_cast<size_t>(node.camera)], name, matrix);
      addLight(index, name, matrix);
      for (size_t k = node.children.size(); k-- > 0;) stack.emplace_back(static_cast<size_t>(node.children[k]), matrix);
    }
  }

  void addMesh(size_t index, const std::string& nodeName, const Mat4& matrix, bool skinned) {
    const tinygltf::Mesh& mesh = model_.meshes[index];
    for (size_t k = 0; k < mesh.primitives.size(); ++k) {
      const tinygltf::Primitive& primitive = mesh.primitives[k];
      const int mode = primitive.mode < 0 ? TINYGLTF_MODE_TRIANGLES : primitive.mode;
      if (mode < TINYGLTF_MODE_TRIANGLES || mode > TINYGLTF_MODE_TRIANGLE_FAN) {
        ++linesAndPoints_;
        continue;
      }
      const std::string plain = k == 0 ? nodeName : fmt::format("{}#{}", nodeName, k + 1);
      std::string name = plain;
      for (size_t number = 2; !names_.insert(name).second; ++number) name = fmt::format("{}~{}", plain, number);
      const double area = addSurface(primitive, mode, name, matrix);
      if (skinned) skinArea_ += area;
      if (!primitive.targets.empty()) morphArea_ += area;
    }
  }

  // Returns the surface's area.
  double addSurface(const tinygltf::Primitive& primitive, int mode, const std::string& name, const Mat4& matrix) {
    const std::string who = fmt::format("{}: surface '{}'", document_.path, name);
    Surface surface;
    surface.name = name;
    surface.material =
        primitive.material >= 0 ? static_cast<uint32_t>(primitive.material) : static_cast<uint32_t>(scene_.materials.size() - 1);
    readPositions(primitive, matrix, who, surface);
    readNormals(primitive, matrix, who, surface);
    readTexcoords(primitive, who, surface);
    readColors(primitive, who, surface);
    readTriangles(primitive, mode, glm::determinant(matrix) < 0, who, surface);
    const double area = checkMaterial(surface);
    triangles_ += surface.triangles.size();
    if (!surface.triangles.empty()) scene_.surfaces.push_back(std::move(surface));
    return area;
  }

  static int attribute(const tinygltf::Primitive& primitive, const char* key) {
    const auto it = primitive.attributes.find(key);
    return it != primitive.attributes.end() ? it->second : -1;
  }

  void readPositions(const tinygltf::Primitive& primitive, const Mat4& matrix, const std::string& who, Surface& surface) const {
    const int accessor = attribute(primitive, "POSITION");
    if (accessor < 0) throw Error("{}: has no POSITION", who);
    const auto values = readAccessor(model_, accessor, 3, who + ": POSITION");
    for (size_t i = 0; i + 2 < values.size(); i += 3) {
      const Vec3 p = Vec3(matrix * glm::dvec4(values[i], values[i + 1], values[i + 2], 1.0));
      if (!std::isfinite(p.x + p.y + p.z)) throw Error("{}: vertex {} is not finite after the node's transform", who, i / 3);
      surface.positions.push_back(p);
    }
  }

  void requireCount(size_t found, const Surface& surface, const char* key, const std::string& who) const {
    if (found != surface.positions.size()) {
      throw Error("{}: {} has {} entries for {} vertices", who, key, found, surface.positions.size());
    }
  }

  void readNormals(const tinygltf::Primitive& primitive, const Mat4& matrix, const std::string& who, Surface& surface) const {
    const int accessor = attribute(primitive, "NORMAL");
    if (accessor < 0 || glm::determinant(matrix) == 0) return;
    const auto values = readAccessor(model_, accessor, 3, who + ": NORMAL");
    requireCount(values.size() / 3, surface, "NORMAL", who);
    const glm::dmat3 toWorld = glm::transpose(glm::inverse(glm::dmat3(matrix)));
    for (size_t i = 0; i + 2 < values.size(); i += 3) {
      const Vec3 n = toWorld * Vec3(values[i], values[i + 1], values[i + 2]);
      const double length = glm::length(n);
      surface.normals.push_back(length > 0 ? n / length : Vec3(0));
    }
  }

  void readTexcoords(const tinygltf::Primitive& primitive, const std::string& who, Surface& surface) const {
    const char* keys[2] = {"TEXCOORD_0", "TEXCOORD_1"};
    for (size_t set = 0; set < 2; ++set) {
      const int accessor = attribute(primitive, keys[set]);
      if (accessor < 0) continue;
      const auto values = readAccessor(model_, accessor, 2, who + ": " + keys[set]);
      requireCount(values.size() / 2, surface, keys[set], who);
      for (size_t i = 0; i + 1 < values.size(); i += 2) surface.texcoords[set].emplace_back(values[i], values[i + 1]);
    }
  }

  void readColors(const tinygltf::Primitive& primitive, const std::string& who, Surface& surface) const {
    const int accessor = attribute(primitive, "COLOR_0");
    if (accessor < 0) return;
    const int components = accessorComponents(model_, accessor) == 4 ? 4 : 3;
    const auto values = readAccessor(model_, accessor, components, who + ": COLOR_0");
    const auto per = static_cast<size_t>(components);
    requireCount(values.size() / per, surface, "COLOR_0", who);
    for (size_t i = 0; i < surface.positions.size(); ++i) {
      const Rgb c(values[i * per], values[i * per + 1], values[i * per + 2]);
      if (minChannel(c) < 0 || maxChannel(c) > 1) throw Error("{}: COLOR_0 of vertex {} is outside [0, 1]", who, i);
      surface.colors.push_back(c);
    }
  }

  void readTriangles(const tinygltf::Primitive& primitive, int mode, bool flip, const std::string& who, Surface& surface) const {
    std::vector<uint32_t> indices;
    const size_t vertices = surface.positions.size();
    if (primitive.indices >= 0) {
      for (const double value : readAccessor(model_, primitive.indices, 1, who + ": indices")) {
        if (value < 0 || value >= static_cast<double>(vertices)) {
          throw Error("{}: index {} is outside its {} vertices", who, value, vertices);
        }
        indices.push_back(static_cast<uint32_t>(value));
      }
    } else {
      for (size_t i = 0; i < vertices; ++i) indices.push_back(static_cast<uint32_t>(i));
    }
    if (mode == TINYGLTF_MODE_TRIANGLES && indices.size() % 3 != 0) {
      throw Error("{}: {} indices do not make whole triangles", who, indices.size());
    }
    const size_t step = mode == TINYGLTF_MODE_TRIANGLES ? 3 : 1;
    for (size_t k = 0; k + 2 < indices.size(); k += step) {
      std::array<uint32_t, 3> t = {indices[k], indices[k + 1], indices[k + 2]};
      if (mode == TINYGLTF_MODE_TRIANGLE_STRIP && k % 2 == 1) std::swap(t[1], t[2]);
      if (mode == TINYGLTF_MODE_TRIANGLE_FAN) t = {indices[0], indices[k + 1], indices[k + 2]};
      if (flip) std::swap(t[1], t[2]);
      surface.triangles.push_back(t);
    }
  }

  double checkMaterial(const Surface& surface) {
    const Material& material = scene_.materials[surface.material];
    for (const TextureUse* use :
         {&material.baseTexture, &material.metallicRoughnessTexture, &material.emissionTexture, &material.transmissionTexture}) {
      if (use->used() && surface.texcoords[static_cast<size_t>(use->set)].empty()) {
        throw Error("{}: surface '{}': material '{}' needs TEXCOORD_{}, which the mesh lacks", document_.path, surface.name,
                    material.name, use->set);
      }
    }
    double area = 0;
    for (const auto& t : surface.triangles) {
      area += triangleArea(surface.positions[t[0]], surface.positions[t[1]], surface.positions[t[2]]);
    }
    const auto& json = document_.json;
    const auto given =
        surface.material + 1 < scene_.materials.size() ? json["materials"][surface.material] : nlohmann::json::object();
    const auto mode = given.find("alphaMode");
    if (mode != given.end() && *mode != "OPAQUE") alphaArea_ += area;
    if (material.metallic > 0 && !material.unlit && material.roughness > kMirrorRoughness && !material.exactDiffuse &&
        !material.exactSpecular) {
      roughMetalArea_ += area;
    }
    return area;
  }

  void addCamera(const tinygltf::Camera& source, const std::string& nodeName, const Mat4& matrix) {
    Camera camera;
    camera.name = nodeName;
    camera.position = Vec3(matrix[3]);
    camera.forward = glm::normalize(-Vec3(matrix[2]));
    const Vec3 up = Vec3(matrix[1]);
    camera.up = glm::normalize(up - glm::dot(up, camera.forward) * camera.forward);
    if (!std::isfinite(camera.forward.x + camera.up.x)) fail(fmt::format("camera '{}'", nodeName), "has a degenerate transform");
    camera.orthographic = source.type == "orthographic";
    if (camera.orthographic) {
      camera.halfWidth = source.orthographic.xmag;
      camera.halfHeight = source.orthographic.ymag;
      if (!(camera.halfWidth > 0 && camera.halfHeight > 0))
        fail(fmt::format("camera '{}'", nodeName), "xmag and ymag must be above 0");
    } else {
      camera.verticalFov = source.perspective.yfov;
      if (!(camera.verticalFov > 0 && camera.verticalFov < kPi)) {
        fail(fmt::format("camera '{}'", nodeName), fmt::format("yfov is {}, outside (0, pi)", camera.verticalFov));
      }
    }
    scene_.cameras.push_back(camera);
  }

  void addLight(size_t nodeIndex, const std::string& nodeName, const Mat4& matrix) {
    const auto& json = document_.json;
    const auto& node = json["nodes"][nodeIndex];
    const nlohmann::json::json_pointer at("/extensions/KHR_lights_punctual/light");
    const nlohmann::json::json_pointer listAt("/extensions/KHR_lights_punctual/lights");
    if (!node.contains(at)) return;
    const std::string who = fmt::format("light '{}'", nodeName);
    if (!json.contains(listAt) || !json[listAt].is_array() || !node[at].is_number_unsigned() ||
        node[at].get<size_t>() >= json[listAt].size()) {
      fail(who, fmt::format("light is {}, which the file does not have", node[at].dump()));
    }
    const auto& source = json[listAt][node[at].get<size_t>()];
    PunctualLight light;
    light.name = nodeName;
    light.position = Vec3(matrix[3]);
    light.direction = glm::normalize(-Vec3(matrix[2]));
    try {
      const auto type = source.at("type").get<std::string>();
      if (type == "spot")
        light.kind = PunctualLight::Kind::spot;
      else if (type == "directional")
        light.kind = PunctualLight::Kind::directional;
      else if (type != "point")
        fail(who, fmt::format("type is '{}', not point, spot or directional", type));
      const auto color = source.value("color", std::vector<double>{1, 1, 1});
      if (color.size() != 3) fail(who, "color is not three numbers");
      light.intensity = source.value("intensity", 1.0) * Rgb(color[0], color[1], color[2]);
      if (!(minChannel(light.intensity) >= 0)) fail(who, "intensity or color is negative");
      light.range = source.value("range", 0.0);
      const auto spot = source.value("spot", nlohmann::json::object());
      light.innerCone = spot.value("innerConeAngle", 0.0);
      light.outerCone = spot.value("outerConeAngle", kPi / 4);
    } catch (const nlohmann::json::exception& e) {
      fail(who, fmt::format("a member is missing or of the wrong kind ({})", e.what()));
    }
    scene_.lights.push_back(light);
  }

  void sayWhatWasLeftOut() {
    if (linesAndPoints_ > 0)
      log_.note(fmt::format("{} primitives of points or lines were skipped: they have no area", linesAndPoints_));
    if (skinArea_ > 0) log_.note(fmt::format("skinned meshes ({:.4g} square units) are taken in their rest pose", skinArea_));
    if (morphArea_ > 0)
      log_.note(fmt::format("meshes with morph targets ({:.4g} square units) are taken without them", morphArea_));
    if (alphaArea_ > 0) log_.note(fmt::format("surfaces with alpha ({:.4g} square units) are taken as opaque", alphaArea_));
    if (roughMetalArea_ > 0) {
      log_.note(
          fmt::format("metal of roughness above {} ({:.4g} square units) counts as diffuse", kMirrorRoughness, roughMetalArea_));
    }
  }

  Document document_;
  Log& log_;
  tinygltf::Model model_;
  Scene scene_;
  std::set<std::string> names_;  // of surfaces so far
  size_t triangles_ = 0, linesAndPoints_ = 0;
  double skinArea_ = 0, morphArea_ = 0, alphaArea_ = 0, roughMetalArea_ = 0;
};

}  // namespace

Scene loadScene(const std::string& path, Log& log) {
  try {
    return Loader(path, log).run();
  } catch (const nlohmann::json::exception& e) {
    throw Error("{}: file: a member has the wrong kind of value ({})", path, e.what());
  }
}

Camera chooseCamera(const Scene& scene, const std::string& name) {
  for (const Camera& camera : scene.cameras) {
    if (name.empty() || camera.name == name) return camera;
  }
  if (!name.empty()) {
    std::string known;
    for (const Camera& camera : scene.cameras) known += (known.empty() ? "" : ", ") + camera.name;
    throw Error("{}: there is no camera '{}'; the scene has {}", scene.path, name, known.empty() ? "none" : known);
  }
  // No camera: look at the whole scene from outside and above its largest horizontal side, leaving out
  // faces seen from behind, so that the near walls of a room do not hide its inside.
  Vec3 low(1e300), high(-1e300);
  for (const Surface& surface : scene.surfaces) {
    for (const Vec3& p : surface.positions) {
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
  }
  Camera camera;
  camera.name = "(automatic)";
  camera.frontFacesOnly = true;
  const Vec3 centre = 0.5 * (low + high);
  const double radius = 0.5 * glm::distance(low, high);
  const Vec3 direction = glm::normalize(Vec3(0.35, 0.45, 1.0));
  camera.verticalFov = 0.6;
  camera.position = centre + direction * (1.05 * radius / std::sin(0.5 * camera.verticalFov));
  camera.forward = -direction;
  camera.up = glm::normalize(Vec3(0, 1, 0) - glm::dot(Vec3(0, 1, 0), camera.forward) * camera.forward);
  return camera;
}

}  // namespace farol
