// Closed forms for unoccluded form factors: the reference every other method is held against.
#pragma once

#include "base/math.h"

#include <span>
#include <vector>

namespace farol {

// Share of Lambert's contour sum that the directed edge a -> b adds, seen from the origin with this unit normal: the
// sum over a polygon's edges, counter-clockwise around the normal, is its form factor.
double lambertEdge(const Vec3& normal, const Vec3& a, const Vec3& b);

// Form factor from a point with unit normal to a polygon, clipped at the point's horizon (Lambert's contour sum;
// Howell's catalog, "element to polygon"). Vertices run counter-clockwise seen from the side that is counted:
// a polygon seen from behind gives 0. Nothing is assumed to be in between.
double pointToPolygon(const Vec3& point, const Vec3& normal, std::span<const Vec3> polygon);

}  // namespace farol
