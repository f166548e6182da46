// The five walls of the Cornell box as 8 x 8 cells each, or as many as asked for, on which methods are compared: mean radiosity of
// the exposed part of a cell.
#pragma once

#include "trace/cover.h"

#include <array>
#include <map>

namespace farol::benchmark {

inline constexpr size_t kCells = 8;  // per side of a wall
inline constexpr size_t kCellCount = 5 * kCells * kCells;

struct CornellBox {
  explicit CornellBox(const std::string& path, size_t cellsPerSide = kCells)
      : side(cellsPerSide), scene(loadScene(path, log)), facets(buildFacets(scene, log)), tracer(facets) {
    low = Vec3(1e300);
    high = Vec3(-1e300);
    for (const Vec3& p : facets.points) {
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
  }

  size_t cellCount() const { return 5 * side * side; }

  // Cell of a point on a facet, cellCount() for the lamp and the blocks. Unit coordinates.
  size_t cellOf(uint32_t facet, const Vec3& p) const {
    static const std::map<std::string, size_t> walls = {
        {"floor", 0}, {"ceiling", 1}, {"back_wall", 2}, {"green_wall", 3}, {"red_wall", 4}};
    const auto wall = walls.find(scene.surfaces[facets.facets[facet].surface].name);
    if (wall == walls.end()) return cellCount();
    const Vec3 q = (p - low) / (high - low);
    const double a = wall->second < 3 ? q.x : q.z, b = wall->second < 2 ? q.z : q.y;
    const auto place = [&](double x) {
      const auto n = static_cast<double>(side);
      return static_cast<size_t>(std::clamp(x * n, 0.0, n - 1e-9));
    };
    return (wall->second * side + place(b)) * side + place(a);
  }

  Rgb reflectanceOf(uint32_t facet) const {
    return scene.materials[scene.surfaces[facets.facets[facet].surface].material].evaluate({}, {}).diffuse;
  }
  Rgb emissionOf(uint32_t facet) const {
    return scene.materials[scene.surfaces[facets.facets[facet].surface].material].evaluate({}, {}).emission;
  }

  size_t side;  // cells per side of a wall
  Log log{true};
  Scene scene;
  FacetSet facets;
  Tracer tracer;
  Vec3 low, high;
};

}  // namespace farol::benchmark
