#include "base/output_file.h"
#include "output/output.h"

#include <array>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

namespace farol {
namespace {

using nlohmann::json;

// Vertices of one surface: every cell has its own, so that colours may jump from cell to cell.
struct LitMesh {
  std::vector<float> position, color, radiosity, irradiance;  // 3 per vertex
  std::vector<uint32_t> indices;
};

void append(std::vector<float>& to, const Vec3& v) {
  for (int c = 0; c < 3; ++c) to.push_back(static_cast<float>(v[c]));
}

class LitGlb {
 public:
  LitGlb(const Scene& scene, const FacetSet& facets, const PatchSet& patches, const NodeIrradiance& irradiance)
      : scene_(scene), facets_(facets), patches_(patches), irradiance_(irradiance) {}

  void build() {
    meshes_.resize(2 * scene_.surfaces.size());
    for (uint32_t c = 0; c < patches_.cells.size(); ++c) {
      if (patches_.cellMap[c] != kNone) addCell(patches_.cells[c], patches_.patches[patches_.cellMap[c]]);
    }
  }

  std::string assemble(double exposure, json& document) {
    const double scale = brightest_ > 0 ? std::exp2(exposure) * kPi / brightest_ : 1;
    json nodes = json::array(), meshes = json::array(), roots = json::array();
    for (size_t m = 0; m < meshes_.size(); ++m) {
      LitMesh& mesh = meshes_[m];
      if (mesh.indices.empty()) continue;
      const Surface& surface = scene_.surfaces[m / 2];
      mesh.color.reserve(mesh.radiosity.size());
      for (const float b : mesh.radiosity) {
        mesh.color.push_back(static_cast<float>(std::min(1.0, scale * static_cast<double>(b) / kPi)));
      }
      json primitive = {{"mode", 4}, {"material", 0}};
      primitive["indices"] = addAccessor(mesh.indices, 5125, "SCALAR", 34963, false);
      primitive["attributes"] = {{"POSITION", addAccessor(mesh.position, 5126, "VEC3", 34962, true)},
                                 {"COLOR_0", addAccessor(mesh.color, 5126, "VEC3", 34962, false)},
                                 {"_RADIOSITY", addAccessor(mesh.radiosity, 5126, "VEC3", 34962, false)},
                                 {"_IRRADIANCE", addAccessor(mesh.irradiance, 5126, "VEC3", 34962, false)}};
      const std::string name = m % 2 == 1 ? surface.name + "~back" : surface.name;
      json entry = {{"name", name}, {"primitives", json::array({primitive})}};
      if (const Material& material = scene_.materials[surface.material]; specular(material)) {
        entry["extras"] = {{"specularMaterial", material.name}};
      }
      roots.push_back(nodes.size());
      // Vertices are relative to the scene's centre, so that float32 keeps its digits far from the origin.
      nodes.push_back({{"name", name},
                       {"mesh", meshes.size()},
                       {"translation", {facets_.frame.centre.x, facets_.frame.centre.y, facets_.frame.centre.z}}});
      meshes.push_back(entry);
    }
    addCameras(nodes, roots, document);
    document["asset"] = {{"version", "2.0"}, {"generator", "farol"}};
    document["extensionsUsed"] = {"KHR_materials_unlit"};
    document["materials"] = json::array({{{"name", "lit"},
                                          {"extensions", {{"KHR_materials_unlit", json::object()}}},
                                          {"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 1, 1}}, {"metallicFactor", 0}}}}});
    document["scene"] = 0;
    document["scenes"] = json::array({{{"nodes", roots}, {"extras", {{"scale", scale}, {"color", "COLOR_0 = scale * B / pi"}}}}});
    document["nodes"] = nodes;
    document["meshes"] = meshes;
    document["accessors"] = accessors_;
    document["bufferViews"] = views_;
    document["buffers"] = json::array({{{"byteLength", binary_.size()}}});
    return std::move(binary_);
  }

 private:
  static bool specular(const Material& m) {
    if (m.textured()) return m.transmission > 0 || (m.metallic > 0 && m.roughness <= kMirrorRoughness);
    const Optics o = m.evaluate({}, {});
    return maxChannel(o.specular + o.transmission) > 0;
  }

  void addCell(const Cell& cell, const Patch& patch) {
    const Facet& f = facets_.facets[cell.facet];
    const CellGrid& g = patches_.grids[cell.facet];
    LitMesh& mesh = meshes_[2 * f.surface + (cell.back ? 1 : 0)];
    const auto first = static_cast<uint32_t>(mesh.position.size() / 3);
    constexpr std::array<std::array<double, 2>, 4> kQuad = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}},
                                                   kTriangle = {{{0, 0}, {1, 0}, {0, 1}, {0, 0}}};
    const size_t count = f.parallelogram ? 4 : 3;
    for (size_t k = 0; k < count; ++k) {
      const auto& st = f.parallelogram ? kQuad[k] : kTriangle[k];
      const Vec2 uv = cellPoint(g, f.parallelogram, cell, st[0], st[1]);
      const Rgb h = irradiance_.at(cell.facet, cell.back, uv.x, uv.y);
      const Rgb b = patch.emission + patch.reflectance * h;
      append(mesh.position, facets_.point(f, uv.x, uv.y) * facets_.frame.size);
      append(mesh.radiosity, b);
      append(mesh.irradiance, h);
      brightest_ = std::max(brightest_, maxChannel(b));
    }
    for (uint32_t k = 1; k + 1 < count; ++k) {
      const uint32_t second = cell.back ? k + 1 : k, third = cell.back ? k : k + 1;
      mesh.indices.insert(mesh.indices.end(), {first, first + second, first + third});
    }
  }

  template <typename T>
  size_t addAccessor(const std::vector<T>& data, int componentType, const char* type, int target, bool bounds) {
    const size_t offset = binary_.size(), bytes = data.size() * sizeof(T);
    binary_.append(reinterpret_cast<const char*>(data.data()), bytes);
    views_.push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", bytes}, {"target", target}});
    const size_t per = std::string_view(type) == "VEC3" ? 3 : 1;
    json accessor = {
        {"bufferView", views_.size() - 1}, {"componentType", componentType}, {"type", type}, {"count", data.size() / per}};
    if (bounds) {
      std::array<T, 3> low, high;
      low.fill(std::numeric_limits<T>::max());
      high.fill(std::numeric_limits<T>::lowest());
      for (size_t i = 0; i < data.size(); ++i) {
        low[i % 3] = std::min(low[i % 3], data[i]);
        high[i % 3] = std::max(high[i % 3], data[i]);
      }
      accessor["min"] = low;
      accessor["max"] = high;
    }
    accessors_.push_back(accessor);
    return accessors_.size() - 1;
  }

  void addCameras(json& nodes, json& roots, json& document) const {
    for (const Camera& camera : scene_.cameras) {
      const Vec3 right = glm::cross(camera.forward, camera.up), back = -camera.forward;
      const json lens = camera.orthographic
                            ? json{{"type", "orthographic"},
                                   {"orthographic",
                                    {{"xmag", camera.halfWidth},
                                     {"ymag", camera.halfHeight},
                                     {"znear", 1e-3 * facets_.frame.size},
                                     {"zfar", 10 * facets_.frame.size}}}}
                            : json{{"type", "perspective"},
                                   {"perspective", {{"yfov", camera.verticalFov}, {"znear", 1e-3 * facets_.frame.size}}}};
      roots.push_back(nodes.size());
      nodes.push_back({{"name", camera.name},
                       {"camera", document["cameras"].size()},
                       {"matrix",
                        {right.x, right.y, right.z, 0, camera.up.x, camera.up.y, camera.up.z, 0, back.x, back.y, back.z, 0,
                         camera.position.x, camera.position.y, camera.position.z, 1}}});
      document["cameras"].push_back(lens);
    }
  }

  const Scene& scene_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  const NodeIrradiance& irradiance_;
  std::vector<LitMesh> meshes_;  // front and back of each surface
  double brightest_ = 0;
  std::string binary_;
  json views_ = json::array(), accessors_ = json::array();
};

void writeLittleEndian(std::ostream& out, uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) out.put(static_cast<char>(value >> shift & 0xFF));
}

}  // namespace

void writeLitGlb(const std::string& path, const Scene& scene, const FacetSet& facets, const PatchSet& patches,
                 const NodeIrradiance& irradiance, double exposure) {
  LitGlb lit(scene, facets, patches, irradiance);
  lit.build();
  json document;
  std::string binary = lit.assemble(exposure, document);
  std::string text = document.dump(-1, ' ', false, json::error_handler_t::replace);
  text.append((4 - text.size() % 4) % 4, ' ');
  binary.append((4 - binary.size() % 4) % 4, '\0');
  OutputFile file(path);
  std::ostream& out = file.stream();
  out << "glTF";
  writeLittleEndian(out, 2);
  writeLittleEndian(out, static_cast<uint32_t>(12 + 8 + text.size() + 8 + binary.size()));
  writeLittleEndian(out, static_cast<uint32_t>(text.size()));
  out << "JSON" << text;
  writeLittleEndian(out, static_cast<uint32_t>(binary.size()));
  out << "BIN" << '\0' << binary;
  file.commit();
}

}  // namespace farol
