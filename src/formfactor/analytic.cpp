#include "formfactor/analytic.h"

namespace farol {

double lambertEdge(const Vec3& normal, const Vec3& a, const Vec3& b) {
  const Vec3 cross = glm::cross(a, b);
  const double length = glm::length(cross);
  if (length == 0) return 0;
  // The angle by atan2 of cross and dot: acos loses half its digits near 0 and pi.
  return std::atan2(length, glm::dot(a, b)) * glm::dot(normal, cross) / length / (2 * kPi);
}

double pointToPolygon(const Vec3& point, const Vec3& normal, std::span<const Vec3> polygon) {
  // Clip to the upper half space on the way (Sutherland and Hodgman 1974, one plane): a convex polygon gains one edge,
  // from where it leaves the half space to where it enters again; any other gains one edge per visit.
  double sum = 0;
  Vec3 first(0), last(0);
  bool started = false;
  const auto visit = [&](const Vec3& v) {
    if (started)
      sum += lambertEdge(normal, last, v);
    else
      first = v;
    started = true;
    last = v;
  };
  for (size_t k = 0; k < polygon.size(); ++k) {
    const Vec3 a = polygon[k] - point, b = polygon[k + 1 < polygon.size() ? k + 1 : 0] - point;
    const double ha = glm::dot(normal, a), hb = glm::dot(normal, b);
    if (ha >= 0) visit(a);
    if ((ha > 0 && hb < 0) || (ha < 0 && hb > 0)) visit(a + ha / (ha - hb) * (b - a));
  }
  if (started) sum += lambertEdge(normal, last, first);
  return std::max(0.0, -sum);  // seen from the counted side the vertices run clockwise around the direction of sight
}

}  // namespace farol
