// Closed forms for unoccluded form factors: the reference every other method is held against.
#pragma once

#include "base/math.h"

#include <span>
#include <vector>

namespace farol {

// Form factor from a point with unit normal to a polygon, clipped at the point's horizon (Lambert's contour sum;
// Howell's catalog, "element to polygon"). Vertices run counter-clockwise seen from the side that is counted:
// a polygon seen from behind gives 0. Nothing is assumed to be in between.
double pointToPolygon(const Vec3& point, const Vec3& normal, std::span<const Vec3> polygon);

}  // namespace farol
