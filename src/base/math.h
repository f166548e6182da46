// Vectors and constants that every room uses. Geometry on the CPU is in double precision.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

namespace farol {

using Vec2 = glm::dvec2;
using Vec3 = glm::dvec3;
using Rgb = glm::dvec3;  // three independent channels: red, green, blue

inline constexpr double kPi = 3.14159265358979323846;

inline double maxChannel(const Rgb& c) { return std::max({c.r, c.g, c.b}); }
inline double minChannel(const Rgb& c) { return std::min({c.r, c.g, c.b}); }
inline double luminance(const Rgb& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; }  // BT.709

// A unit vector at right angles to the unit vector n.
inline Vec3 anyPerpendicular(const Vec3& n) {
  const Vec3 helper = std::abs(n.x) < 0.6 ? Vec3(1, 0, 0) : Vec3(0, 1, 0);
  return glm::normalize(glm::cross(n, helper));
}

// 64 well-mixed bits from 64 bits (Steele, Lea, Flood 2014, "SplitMix"): seeds per patch and position.
inline uint64_t mixBits(uint64_t x) {
  x += 0x9E3779B97F4A7C15ull;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

// A number in [0, 1) from the 53 high bits.
inline double unitFromBits(uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

}  // namespace farol
