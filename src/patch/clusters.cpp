#include "patch/patches.h"

#include <algorithm>
#include <queue>
#include <unordered_map>

namespace farol {
namespace {

// Facets side by side: those that share an edge, by its two points.
std::vector<std::vector<uint32_t>> neighboursOf(const FacetSet& facets) {
  std::vector<std::pair<uint64_t, uint32_t>> edges;
  for (uint32_t f = 0; f < facets.facets.size(); ++f) {
    const Facet& facet = facets.facets[f];
    const size_t n = facet.cornerCount();
    for (size_t k = 0; k < n; ++k) {
      const auto [a, b] = std::minmax(facet.corners[k], facet.corners[(k + 1) % n]);
      edges.emplace_back(uint64_t{a} << 32 | b, f);
    }
  }
  std::sort(edges.begin(), edges.end());
  std::vector<std::vector<uint32_t>> result(facets.facets.size());
  for (size_t first = 0, last = 0; first < edges.size(); first = last) {
    while (last < edges.size() && edges[last].first == edges[first].first) ++last;
    for (size_t i = first; i < last; ++i) {
      for (size_t k = first; k < last; ++k) {
        if (edges[i].second != edges[k].second) result[edges[i].second].push_back(edges[k].second);
      }
    }
  }
  for (auto& list : result) std::sort(list.begin(), list.end());
  return result;
}

}  // namespace

std::vector<uint32_t> clusteredCells(const PatchSet& patches, const FacetSet& facets, double size, double degrees) {
  const double cosine = std::cos(degrees * kPi / 180), width = size / facets.frame.size;
  const auto mayJoin = [&](uint32_t f) {
    const CellGrid& g = patches.grids[f];
    if (g.nu * g.nv > 1) return false;
    const Patch& front = patches.patches[patches.cellMap[g.frontCell]];
    return !front.isSpecular() && !front.emits();
  };
  // Breadth first from each facet in turn, so that clusters are round; no wider than a patch and of no more area.
  const auto neighbours = neighboursOf(facets);
  std::vector<uint32_t> clusterOf(facets.facets.size(), kNone);
  uint32_t count = 0;
  for (uint32_t seed = 0; seed < clusterOf.size(); ++seed) {
    if (clusterOf[seed] != kNone || !mayJoin(seed)) continue;
    const Facet& first = facets.facets[seed];
    const Vec3 middle = first.parallelogram ? facets.point(first, 0.5, 0.5) : facets.point(first, 1.0 / 3, 1.0 / 3);
    std::queue<uint32_t> border;
    border.push(seed);
    clusterOf[seed] = count;
    double area = first.area;
    while (!border.empty()) {
      const uint32_t at = border.front();
      border.pop();
      for (const uint32_t f : neighbours[at]) {
        const Facet& facet = facets.facets[f];
        const bool fits = clusterOf[f] == kNone && facet.surface == first.surface && facet.doubleSided == first.doubleSided &&
                          area + facet.area <= width * width && glm::dot(facet.normal, first.normal) >= cosine && mayJoin(f);
        if (!fits) continue;
        bool inside = true;
        for (size_t k = 0; k < facet.cornerCount(); ++k) inside &= glm::distance(facets.points[facet.corners[k]], middle) <= width;
        if (!inside) continue;
        clusterOf[f] = count;
        area += facet.area;
        border.push(f);
      }
    }
    ++count;
  }
  std::vector<uint32_t> map(patches.cells.size());
  std::unordered_map<uint64_t, uint32_t> numbers;  // of patches, in the order of their first cells
  for (uint32_t c = 0; c < map.size(); ++c) {
    const Cell& cell = patches.cells[c];
    const bool alone = clusterOf[cell.facet] == kNone;
    const uint64_t key = alone ? uint64_t{1} << 63 | c : uint64_t{clusterOf[cell.facet]} << 1 | (cell.back ? 1 : 0);
    map[c] = numbers.try_emplace(key, static_cast<uint32_t>(numbers.size())).first->second;
  }
  return map;
}

}  // namespace farol
