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
  // Clip to the upper half space first (Sutherland and Hodgman 1974, one plane).
  std::vector<Vec3> clipped;
  for (size_t k = 0; k < polygon.size(); ++k) {
    const Vec3 a = polygon[k] - point, b = polygon[(k + 1) % polygon.size()] - point;
    const double ha = glm::dot(normal, a), hb = glm::dot(normal, b);
    if (ha >= 0) clipped.push_back(a);
    if ((ha > 0 && hb < 0) || (ha < 0 && hb > 0)) clipped.push_back(a + ha / (ha - hb) * (b - a));
  }
  double sum = 0;
  for (size_t k = 0; k < clipped.size(); ++k) sum += lambertEdge(normal, clipped[k], clipped[(k + 1) % clipped.size()]);
  return std::max(0.0, -sum);  // seen from the counted side the vertices run clockwise around the direction of sight
}

}  // namespace farol
