#include "base/point_welder.h"

namespace farol {
namespace {

uint64_t hashCell(int64_t x, int64_t y, int64_t z) {
  return mixBits(static_cast<uint64_t>(x) ^ mixBits(static_cast<uint64_t>(y) ^ mixBits(static_cast<uint64_t>(z))));
}

}  // namespace

uint32_t PointWelder::add(const Vec3& p) {
  // A point within the tolerance (half a cell) lies in this cell or in the nearer neighbour per axis.
  int64_t base[3];
  int64_t step[3];
  for (int axis = 0; axis < 3; ++axis) {
    const double scaled = p[axis] / cell_;
    base[axis] = static_cast<int64_t>(std::floor(scaled));
    step[axis] = scaled - std::floor(scaled) < 0.5 ? -1 : 1;
  }
  for (int corner = 0; corner < 8; ++corner) {
    const int64_t x = base[0] + ((corner & 1) != 0 ? step[0] : 0);
    const int64_t y = base[1] + ((corner & 2) != 0 ? step[1] : 0);
    const int64_t z = base[2] + ((corner & 4) != 0 ? step[2] : 0);
    const auto [first, last] = buckets_.equal_range(hashCell(x, y, z));
    for (auto it = first; it != last; ++it) {
      const Vec3& q = points_[it->second];
      if (glm::distance(p, q) <= tolerance_) {
        if (p != q) ++moved_;
        return it->second;
      }
    }
  }
  const auto index = static_cast<uint32_t>(points_.size());
  points_.push_back(p);
  buckets_.emplace(hashCell(base[0], base[1], base[2]), index);
  return index;
}

}  // namespace farol
