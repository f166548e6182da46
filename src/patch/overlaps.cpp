#include "patch/overlaps.h"

#include <map>

namespace farol {
namespace {

using Polygon = std::vector<Vec2>;

double areaOf(const Polygon& p) {
  double area = 0;
  for (size_t k = 0; k < p.size(); ++k) {
    const Vec2 &a = p[k], &b = p[(k + 1) % p.size()];
    area += 0.5 * (a.x * b.y - a.y * b.x);
  }
  return area;
}

// The part of `subject` inside the convex, counter-clockwise `clip` (Sutherland and Hodgman 1974).
Polygon clipped(Polygon subject, const Polygon& clip) {
  for (size_t k = 0; k < clip.size() && !subject.empty(); ++k) {
    const Vec2 &a = clip[k], edge = clip[(k + 1) % clip.size()] - a;
    const auto side = [&](const Vec2& p) { return edge.x * (p.y - a.y) - edge.y * (p.x - a.x); };
    Polygon kept;
    for (size_t i = 0; i < subject.size(); ++i) {
      const Vec2 &p = subject[i], &q = subject[(i + 1) % subject.size()];
      const double sp = side(p), sq = side(q);
      if (sp >= 0) kept.push_back(p);
      if ((sp > 0 && sq < 0) || (sp < 0 && sq > 0)) kept.push_back(p + sp / (sp - sq) * (q - p));
    }
    subject = std::move(kept);
  }
  return subject;
}

struct InPlane {
  uint32_t facet = 0;
  double offset = 0;  // of the plane
  Polygon polygon;
  Vec2 low{1e300}, high{-1e300};
};

// Facets of about one direction, their corners in coordinates across it.
std::vector<InPlane> across(const FacetSet& facets, const std::vector<uint32_t>& members) {
  const Vec3 n = facets.facets[members[0]].normal, t = anyPerpendicular(n), u = glm::cross(n, t);
  std::vector<InPlane> result;
  for (const uint32_t f : members) {
    const Facet& facet = facets.facets[f];
    InPlane p{f, glm::dot(n, facets.points[facet.corners[0]]), {}};
    for (size_t k = 0; k < facet.cornerCount(); ++k) {
      const Vec3& corner = facets.points[facet.corners[k]];
      p.polygon.emplace_back(glm::dot(t, corner), glm::dot(u, corner));
      p.low = glm::min(p.low, p.polygon.back());
      p.high = glm::max(p.high, p.polygon.back());
    }
    result.push_back(std::move(p));
  }
  std::sort(result.begin(), result.end(), [](const InPlane& a, const InPlane& b) { return a.low.x < b.low.x; });
  return result;
}

}  // namespace

std::vector<Overlap> findOverlaps(const FacetSet& facets, size_t most) {
  // Facets of one plane have one direction to rounding, and offsets that differ by no more: they share a key, but for
  // those that fall on either side of a step.
  constexpr double kDirections = 4096, kOffsets = 1 << 16;
  std::map<std::array<int64_t, 4>, std::vector<uint32_t>> byPlane;
  for (uint32_t f = 0; f < facets.facets.size(); ++f) {
    const Vec3& n = facets.facets[f].normal;
    const auto step = [](double x, double steps) { return static_cast<int64_t>(std::floor(x * steps + 0.37)); };
    byPlane[{step(n.x, kDirections), step(n.y, kDirections), step(n.z, kDirections),
             step(glm::dot(n, facets.points[facets.facets[f].corners[0]]), kOffsets)}]
        .push_back(f);
  }
  constexpr double kLeastShare = 1e-4;  // of the smaller facet; less is rounding at a common edge
  std::vector<Overlap> overlaps;
  for (const auto& [plane, members] : byPlane) {
    if (members.size() < 2) continue;
    const std::vector<InPlane> sorted = across(facets, members);
    for (size_t i = 0; i < sorted.size(); ++i) {
      const InPlane& a = sorted[i];
      for (size_t k = i + 1; k < sorted.size() && sorted[k].low.x < a.high.x; ++k) {
        const InPlane& b = sorted[k];
        if (b.low.y >= a.high.y || b.high.y <= a.low.y || std::abs(a.offset - b.offset) > kWeldTolerance) continue;
        const double area = areaOf(clipped(a.polygon, b.polygon));
        if (area > kLeastShare * std::min(facets.facets[a.facet].area, facets.facets[b.facet].area))
          overlaps.push_back({std::min(a.facet, b.facet), std::max(a.facet, b.facet), area});
      }
    }
  }
  std::stable_sort(overlaps.begin(), overlaps.end(), [](const Overlap& a, const Overlap& b) { return a.area > b.area; });
  if (overlaps.size() > most) overlaps.resize(most);
  return overlaps;
}

}  // namespace farol
