#include "trace/cover.h"

#include "patch/positions.h"

#include <array>
#include <tbb/parallel_for.h>

namespace farol {

bool insideObject(const Tracer& tracer, const FacetSet& facets, const Vec3& point, const Vec3& normal, bool black) {
  const Vec3 t = anyPerpendicular(normal), b = glm::cross(normal, t), origin = point + kRayOffset * normal;
  static const std::array<Vec3, 8> directions = [] {  // straight up first: it settles most points that are not inside
    std::array<Vec3, 8> d{Vec3(0, 0, 1)};
    for (int k = 1; k < 8; ++k) {
      // Nearly along the surface: something that hovers above it, at a hundredth of its own size or more, is told
      // from something that stands on it.
      const double angle = 2 * kPi * k / 7 + 0.5, sine = k == 1 ? 0.7 : 0.9999;
      d[static_cast<size_t>(k)] = {sine * std::cos(angle), sine * std::sin(angle), std::sqrt(1 - sine * sine)};
    }
    return d;
  }();
  for (const Vec3& local : directions) {
    const Vec3 direction = local.x * t + local.y * b + local.z * normal;
    const uint32_t facet = tracer.firstFacet(origin, direction);
    if (facet == kNone) return false;
    if (!tracer.seenFromBehind(facet, static_cast<float>(direction.x), static_cast<float>(direction.y),
                               static_cast<float>(direction.z))) {
      return false;
    }
    if (black && facets.facets[facet].doubleSided) return false;
  }
  return true;
}

ExposedArea findExposedArea(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, int samples,
                            uint64_t seed) {
  ExposedArea result;
  result.share.assign(patches.size(), 1.0f);
  result.point.resize(patches.size());
  tbb::parallel_for(uint32_t{0}, static_cast<uint32_t>(patches.size()), [&](uint32_t i) {
    const Vec3& normal = patches.patches[i].normal;
    result.point[i] = positionsOn(facets, patches, i, 1, seed)[0].point;
    std::vector<Vec3> exposed;
    bool black = false, anyBack = false;
    const auto points = positionsOn(facets, patches, i, samples, mixBits(seed + i));
    RayPacket up;
    HitPacket hits;
    std::vector<bool> covered(points.size(), false);
    for (size_t first = 0; first < points.size(); first += kPacketSize) {
      const auto count = static_cast<uint32_t>(std::min<size_t>(kPacketSize, points.size() - first));
      for (uint32_t k = 0; k < count; ++k) {
        const Vec3 o = points[first + k].point + kRayOffset * normal;
        up.ox[k] = static_cast<float>(o.x);
        up.oy[k] = static_cast<float>(o.y);
        up.oz[k] = static_cast<float>(o.z);
        up.dx[k] = static_cast<float>(normal.x);
        up.dy[k] = static_cast<float>(normal.y);
        up.dz[k] = static_cast<float>(normal.z);
      }
      tracer.intersect(up, count, hits);
      for (uint32_t k = 0; k < count; ++k) {
        if (hits.facet[k] == kNone || !tracer.seenFromBehind(hits.facet[k], up.dx[k], up.dy[k], up.dz[k])) continue;
        anyBack = true;
        const bool oneSided = !facets.facets[hits.facet[k]].doubleSided;
        black |= oneSided;
        covered[first + k] = insideObject(tracer, facets, points[first + k].point, normal, oneSided);
      }
    }
    if (!anyBack) return;
    double share = 0;
    Vec3 mean(0);
    for (size_t k = 0; k < points.size(); ++k) {
      if (covered[k]) continue;
      share += points[k].weight;
      mean += points[k].weight * points[k].point;
      exposed.push_back(points[k].point);
    }
    // All of a patch behind double-sided walls may be a room whose walls face outwards: nothing stands on it.
    if (exposed.empty() && !black) return;
    result.share[i] = static_cast<float>(std::min(share, 1.0));
    if (exposed.empty() || exposed.size() == points.size()) return;
    mean /= share;
    result.point[i] = exposed[0];
    for (const Vec3& p : exposed) {
      if (glm::distance(p, mean) < glm::distance(result.point[i], mean)) result.point[i] = p;
    }
  });
  return result;
}

}  // namespace farol
