#include "test_scene.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <unistd.h>

namespace farol::test {
namespace {

using nlohmann::json;

std::string base64(const std::string& bytes) {
  static const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t block = 0;
    for (size_t k = 0; k < 3; ++k) block = block << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (size_t k = 0; k < 4; ++k) out += i + k <= bytes.size() ? digits[block >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

}  // namespace

std::array<double, 4> generalRotation() {
  // R has trace 2 and the axis (R32 - R23, R13 - R31, R21 - R12) = (1, 1, 1): 60 degrees about it.
  const double s = 0.5 / std::sqrt(3.0);
  return {s, s, s, std::sqrt(3.0) / 2};
}

json gltfOf(const std::vector<TestSurface>& surfaces, const Placement& placement) {
  json doc = {{"asset", {{"version", "2.0"}}}, {"scene", 0}};
  std::string binary;
  const auto addView = [&](const void* data, size_t bytes) {
    doc["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", bytes}});
    binary.append(static_cast<const char*>(data), bytes);
    return doc["bufferViews"].size() - 1;
  };
  for (const TestSurface& s : surfaces) {
    std::vector<float> positions;
    std::vector<uint32_t> indices;
    for (const auto& polygon : s.polygons) {
      const auto first = static_cast<uint32_t>(positions.size() / 3);
      for (const Vec3& p : polygon) {
        for (int c = 0; c < 3; ++c) positions.push_back(static_cast<float>(p[c]));
      }
      for (uint32_t k = 1; k + 1 < polygon.size(); ++k) indices.insert(indices.end(), {first, first + k, first + k + 1});
    }
    const size_t number = doc["meshes"].size();
    const size_t positionView = addView(positions.data(), positions.size() * sizeof(float));
    const size_t indexView = addView(indices.data(), indices.size() * sizeof(uint32_t));
    doc["accessors"].push_back(
        {{"bufferView", positionView}, {"componentType", 5126}, {"type", "VEC3"}, {"count", positions.size() / 3}});
    doc["accessors"].push_back({{"bufferView", indexView}, {"componentType", 5125}, {"type", "SCALAR"}, {"count", indices.size()}});
    doc["materials"].push_back({{"name", "paint of " + s.name},
                                {"doubleSided", s.twoSided},
                                {"extras",
                                 {{"farol",
                                   {{"diffuse", {s.reflectance.r, s.reflectance.g, s.reflectance.b}},
                                    {"specular", {s.mirror.r, s.mirror.g, s.mirror.b}},
                                    {"transmission", {s.transmission.r, s.transmission.g, s.transmission.b}},
                                    {"ior", s.ior},
                                    {"solid", s.solid},
                                    {"emission", {s.emission.r, s.emission.g, s.emission.b}}}}}}});
    if (s.attenuationDistance > 0) {
      doc["materials"].back()["extensions"]["KHR_materials_volume"] = {
          {"thicknessFactor", 1}, {"attenuationDistance", s.attenuationDistance}, {"attenuationColor", {0.1, 0.1, 0.1}}};
    }
    doc["meshes"].push_back(
        {{"primitives",
          json::array({{{"attributes", {{"POSITION", 2 * number}}}, {"indices", 2 * number + 1}, {"material", number}}})}});
    doc["nodes"].push_back({{"name", s.name},
                            {"mesh", number},
                            {"rotation", placement.rotation},
                            {"translation", {placement.translation.x, placement.translation.y, placement.translation.z}},
                            {"scale", {placement.scale, placement.scale, placement.scale}}});
    doc["scenes"][0]["nodes"].push_back(number);
  }
  doc["buffers"] =
      json::array({{{"byteLength", binary.size()}, {"uri", "data:application/octet-stream;base64," + base64(binary)}}});
  return doc;
}

TemporaryFolder::TemporaryFolder() {
  static std::atomic<int> counter{0};
  folder_ = std::filesystem::temp_directory_path() / ("farol-test-" + std::to_string(getpid()) + "-" + std::to_string(counter++));
  std::filesystem::create_directories(folder_);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

std::vector<std::string> TemporaryFolder::files() const {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder_)) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

void writeText(const std::string& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

std::string readText(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::vector<std::string>> readCsv(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(readText(path));
  for (std::string line; std::getline(lines, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    rows.emplace_back();
    std::istringstream fields(line);
    for (std::string field; std::getline(fields, field, ',');) rows.back().push_back(field);
  }
  return rows;
}

Scene loadSurfaces(const std::vector<TestSurface>& surfaces, const Placement& placement) {
  const TemporaryFolder folder;
  const std::string path = folder.path("scene.gltf");
  writeText(path, gltfOf(surfaces, placement).dump());
  Log log(true);
  return loadScene(path, log);
}

std::vector<Vec3> rectangle(double x0, double y0, double x1, double y1, double z) {
  return {{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}};
}

std::vector<TestSurface> closedBox(const Vec3& s, const Rgb& reflectance, const Rgb& emission) {
  const auto corner = [&](int x, int y, int z) { return Vec3(x * s.x, y * s.y, z * s.z); };
  const auto face = [&](const char* name, std::vector<Vec3> polygon) {
    return TestSurface{name, {std::move(polygon)}, reflectance, emission, false};
  };
  return {face("x0", {corner(0, 0, 0), corner(0, 1, 0), corner(0, 1, 1), corner(0, 0, 1)}),
          face("x1", {corner(1, 0, 0), corner(1, 0, 1), corner(1, 1, 1), corner(1, 1, 0)}),
          face("y0", {corner(0, 0, 0), corner(0, 0, 1), corner(1, 0, 1), corner(1, 0, 0)}),
          face("y1", {corner(0, 1, 0), corner(1, 1, 0), corner(1, 1, 1), corner(0, 1, 1)}),
          face("z0", {corner(0, 0, 0), corner(1, 0, 0), corner(1, 1, 0), corner(0, 1, 0)}),
          face("z1", {corner(0, 0, 1), corner(0, 1, 1), corner(1, 1, 1), corner(1, 0, 1)})};
}

TestSurface bumpyBall(int triangles, const Vec3& centre) {
  TestSurface ball{"ball", {}};
  const int rings = static_cast<int>(std::sqrt(triangles / 4.0)), around = 2 * rings;
  const auto point = [&](int i, int j) {
    const double t = 2 * kPi * (i % around) / around, f = kPi * j / rings;
    const double r = 0.9 + 0.12 * std::sin(5 * t) * std::sin(4 * f) * std::sin(f);
    return centre + r * Vec3(std::sin(f) * std::cos(t), std::sin(f) * std::sin(t), -std::cos(f));
  };
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < rings; ++j) {
      if (j > 0) ball.polygons.push_back({point(i, j), point(i + 1, j), point(i + 1, j + 1)});
      if (j + 1 < rings) ball.polygons.push_back({point(i, j), point(i + 1, j + 1), point(i, j + 1)});
    }
  }
  return ball;
}

std::vector<TestSurface> ballRoom(int triangles) {
  std::vector<TestSurface> surfaces = closedBox({4, 4, 3});
  surfaces.push_back({"lamp", {{{1.5, 1.5, 2.98}, {1.5, 2.5, 2.98}, {2.5, 2.5, 2.98}, {2.5, 1.5, 2.98}}}});
  surfaces.back().emission = Rgb(10);
  surfaces.push_back(bumpyBall(triangles, {2, 2, 1.15}));
  return surfaces;
}

std::vector<TestSurface> colouredBox() {
  auto box = closedBox({1, 2, 3});
  const Rgb rho[6] = {{0.7, 0.05, 0.05}, {0.1, 0.45, 0.1}, {0.75, 0.7, 0.65}, {0.75, 0.72, 0.7}, {0.4, 0.4, 0.45}, {0.8, 0.8, 0.8}};
  for (size_t i = 0; i < 6; ++i) box[i].reflectance = rho[i];
  box[5].emission = Rgb(18, 12, 4);
  return box;
}

std::vector<TestSurface> sphereZones(const std::string& name, double radius, bool inward, const std::vector<double>& zones,
                                     int segments, const Vec3& centre) {
  std::vector<TestSurface> result;
  for (size_t k = 0; k + 1 < zones.size(); ++k) {
    TestSurface zone;
    zone.name = zones.size() == 2 ? name : name + std::to_string(k);
    const double from = std::acos(zones[k]), to = std::acos(zones[k + 1]);  // polar angles, falling
    const int rings = std::max(1, static_cast<int>(std::lround(segments * (from - to) / (2 * kPi))));
    const auto point = [&](int ring, int segment) {
      const double theta = from + (to - from) * ring / rings, phi = 2 * kPi * (segment % segments) / segments;
      return centre + radius * Vec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
    };
    for (int r = 0; r < rings; ++r) {
      for (int s = 0; s < segments; ++s) {
        std::vector<Vec3> quad = {point(r, s), point(r, s + 1), point(r + 1, s + 1), point(r + 1, s)};
        if (glm::distance(quad[0], quad[1]) < 1e-9 * radius) quad.erase(quad.begin());
        if (quad.size() == 4 && glm::distance(quad[2], quad[3]) < 1e-9 * radius) quad.erase(quad.begin() + 2);
        if (inward) std::reverse(quad.begin(), quad.end());
        zone.polygons.push_back(quad);
      }
    }
    result.push_back(zone);
  }
  return result;
}

TestSurface disk(const std::string& name, double radius, const Vec3& centre, const Vec3& normal, int segments) {
  const Vec3 a = anyPerpendicular(normal), b = glm::cross(normal, a);
  TestSurface s;
  s.name = name;
  // The polygon with the area of the disk: its corners lie a little outside.
  const double r = radius * std::sqrt(2 * kPi / segments / std::sin(2 * kPi / segments));
  const auto rim = [&](int k) {
    return centre + r * (std::cos(2 * kPi * k / segments) * a + std::sin(2 * kPi * k / segments) * b);
  };
  for (int k = 0; k < segments; ++k) s.polygons.push_back({centre, rim(k), rim((k + 1) % segments)});
  return s;
}

}  // namespace farol::test
