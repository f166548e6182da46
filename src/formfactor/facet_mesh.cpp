#include "formfactor/facet_mesh.h"

#include <algorithm>
#include <utility>

namespace farol {
namespace {

using shader::toVec4;

struct ClusterSizes {
  size_t facets, count;  // facets per cluster, clusters
};

ClusterSizes clusterSizes(const FacetSet& facets) {
  const size_t n = facets.facets.size(), size = std::clamp<size_t>(n / 128, 1, 64);
  return {size, (n + size - 1) / size};
}

// Bits of x (10 of them) spread out to every third place.
uint32_t spreadBits(uint32_t x) {
  x = (x | x << 16) & 0x030000FFu;
  x = (x | x << 8) & 0x0300F00Fu;
  x = (x | x << 4) & 0x030C30C3u;
  return (x | x << 2) & 0x09249249u;
}

}  // namespace

FacetMesh buildFacetMesh(const FacetSet& facets, std::span<const uint32_t> order) {
  FacetMesh mesh;
  for (uint32_t i = 0; i < facets.facets.size(); ++i) {
    const uint32_t f = order.empty() ? i : order[i];
    const Facet& facet = facets.facets[f];
    const auto first = static_cast<uint32_t>(mesh.vertices.size());
    for (uint32_t k = 0; k < facet.cornerCount(); ++k) {
      const Vec3& p = facets.points[facet.corners[k]];
      const uint32_t corner = !facet.parallelogram && k == 2 ? 3 : k;  // a triangle's third corner is at (0,1)
      mesh.vertices.push_back({static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z), 4 * f + corner});
    }
    mesh.indices.insert(mesh.indices.end(), {first, first + 1, first + 2});
    if (facet.parallelogram) mesh.indices.insert(mesh.indices.end(), {first, first + 2, first + 3});
  }
  return mesh;
}

FacetClusters buildClusters(const FacetSet& facets) {
  const size_t n = facets.facets.size(), size = clusterSizes(facets).facets;
  std::vector<std::pair<uint32_t, uint32_t>> keys;  // (Morton code of the centroid, facet)
  for (uint32_t f = 0; f < n; ++f) {
    const Facet& facet = facets.facets[f];
    const Vec3 p = facets.point(facet, facet.parallelogram ? 0.5 : 1.0 / 3, facet.parallelogram ? 0.5 : 1.0 / 3) + Vec3(0.5);
    uint32_t code = 0;
    for (int c = 0; c < 3; ++c) code |= spreadBits(static_cast<uint32_t>(std::clamp(p[c] * 1023, 0.0, 1023.0))) << c;
    keys.emplace_back(code, f);
  }
  std::sort(keys.begin(), keys.end());
  FacetClusters clusters;
  uint32_t firstIndex = 0;
  for (size_t first = 0; first < n; first += size) {
    Vec3 low(1e300), high(-1e300);
    uint32_t indexCount = 0;
    for (size_t k = first; k < std::min(n, first + size); ++k) {
      const Facet& facet = facets.facets[keys[k].second];
      clusters.order.push_back(keys[k].second);
      indexCount += facet.parallelogram ? 6 : 3;
      for (size_t corner = 0; corner < facet.cornerCount(); ++corner) {
        low = glm::min(low, facets.points[facet.corners[corner]]);
        high = glm::max(high, facets.points[facet.corners[corner]]);
      }
    }
    clusters.records.push_back({toVec4(0.5 * (low + high)), toVec4(0.5 * (high - low)), firstIndex, indexCount, 0, 0});
    firstIndex += indexCount;
  }
  return clusters;
}

size_t clusterCountOf(const FacetSet& facets) { return clusterSizes(facets).count; }

}  // namespace farol
