// Gives points that lie within a tolerance of each other one common index.
#pragma once

#include "base/math.h"

#include <cstdint>
#include <unordered_map>
#include <vector>

namespace farol {

class PointWelder {
 public:
  explicit PointWelder(double tolerance) : cell_(2 * tolerance), tolerance_(tolerance) {}

  // Index of the first point seen within the tolerance of p, or of p itself when there is none.
  uint32_t add(const Vec3& p);

  const std::vector<Vec3>& points() const { return points_; }
  size_t movedCount() const { return moved_; }  // points welded to one that was not identical

 private:
  double cell_, tolerance_;
  std::vector<Vec3> points_;
  std::unordered_multimap<uint64_t, uint32_t> buckets_;  // hash of the grid cell -> index into points_
  size_t moved_ = 0;
};

}  // namespace farol
