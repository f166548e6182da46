#include "trace/cover.h"

#include <array>
#include <tbb/parallel_for.h>

namespace farol {

uint32_t insideObject(const Tracer& tracer, const FacetSet& facets, std::span<const Vec3> points, const Vec3& normal,
                      uint32_t black) {
  const Vec3 t = anyPerpendicular(normal), b = glm::cross(normal, t);
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
  RayPacket rays;
  HitPacket hits;
  std::array<uint32_t, kPacketSize> left{};  // points that may lie inside
  auto lanes = static_cast<uint32_t>(points.size());
  for (uint32_t k = 0; k < lanes; ++k) left[k] = k;
  for (const Vec3& local : directions) {
    const Vec3 direction = local.x * t + local.y * b + local.z * normal;
    for (uint32_t k = 0; k < lanes; ++k) rays.set(k, points[left[k]] + kRayOffset * normal, direction);
    tracer.intersect(rays, lanes, hits);
    uint32_t kept = 0;
    for (uint32_t k = 0; k < lanes; ++k) {
      const uint32_t facet = hits.facet[k];
      if (facet == kNone || !tracer.seenFromBehind(facet, rays, k) || facets.facets[facet].transmits) continue;
      if ((black >> left[k] & 1) != 0 && facets.facets[facet].doubleSided) continue;
      left[kept++] = left[k];
    }
    lanes = kept;
    if (lanes == 0) return 0;
  }
  uint32_t inside = 0;
  for (uint32_t k = 0; k < lanes; ++k) inside |= 1u << left[k];
  return inside;
}

std::vector<Position> exposedPositions(const Tracer& tracer, const FacetSet& facets, std::span<const Position> all,
                                       const Vec3& normal) {
  std::vector<Position> kept;
  std::array<Vec3, kPacketSize> points;
  double total = 0;
  for (size_t first = 0; first < all.size(); first += kPacketSize) {
    const size_t count = std::min<size_t>(kPacketSize, all.size() - first);
    for (size_t k = 0; k < count; ++k) points[k] = all[first + k].point;
    const uint32_t inside = insideObject(tracer, facets, std::span(points).first(count), normal, 0);
    for (size_t k = 0; k < count; ++k) {
      if ((inside >> k & 1) != 0) continue;
      kept.push_back(all[first + k]);
      total += kept.back().weight;
    }
  }
  for (Position& p : kept) p.weight /= total;
  return kept;
}

ExposedArea findExposedArea(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, int samples, uint64_t seed) {
  ExposedArea result;
  result.share.assign(patches.size(), 1.0f);
  result.point.resize(patches.size());
  tbb::parallel_for(uint32_t{0}, static_cast<uint32_t>(patches.size()), [&](uint32_t i) {
    const Vec3& normal = patches.patches[i].normal;
    const double offset = facets.facets[patches.cells[patches.cellsOf(i)[0]].facet].rayOffset;
    result.point[i] = positionsOn(facets, patches, i, 1, seed)[0].point;
    std::vector<Vec3> exposed;
    bool black = false, anyBack = false;
    const auto points = positionsOn(facets, patches, i, samples, mixBits(seed + i));
    RayPacket up;
    HitPacket hits;
    std::vector<bool> covered(points.size(), false);
    for (size_t first = 0; first < points.size(); first += kPacketSize) {
      const auto count = static_cast<uint32_t>(std::min<size_t>(kPacketSize, points.size() - first));
      for (uint32_t k = 0; k < count; ++k) up.set(k, points[first + k].point + offset * normal, normal);
      tracer.intersect(up, count, hits);
      std::array<Vec3, kPacketSize> below;
      std::array<size_t, kPacketSize> number{};
      uint32_t lanes = 0, oneSided = 0;
      for (uint32_t k = 0; k < count; ++k) {
        if (hits.facet[k] == kNone || !tracer.seenFromBehind(hits.facet[k], up, k)) continue;
        if (facets.facets[hits.facet[k]].transmits) continue;
        if (!facets.facets[hits.facet[k]].doubleSided) oneSided |= 1u << lanes;
        below[lanes] = points[first + k].point;
        number[lanes++] = first + k;
      }
      if (lanes == 0) continue;
      anyBack = true;
      black |= oneSided != 0;
      const uint32_t inside = insideObject(tracer, facets, std::span(below).first(lanes), normal, oneSided);
      for (uint32_t k = 0; k < lanes; ++k) covered[number[k]] = (inside >> k & 1) != 0;
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
