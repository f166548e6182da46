// The patches that are close to one, for their size: a tree over their centres.
#pragma once

#include "base/math.h"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace farol {

class NearPatches {
 public:
  // Of patches with these centres [unit coordinates] and sizes, the roots of their areas.
  NearPatches(std::span<const Vec3> centres, std::span<const double> sizes);

  struct Near {
    double error;   // of the factor to it, as predicted
    double factor;  // from the centre, with nothing in between
    uint32_t patch;
    bool operator<(const Near& o) const { return error > o.error || (error == o.error && patch < o.patch); }
  };

  // What one centre point at distance d leaves of the factor F to a patch, where its own has the size h: largest at about
  // half a size and falling towards contact (failure 1).
  static double errorOf(double factor, double h, double squaredDistance) {
    return 0.1 * factor * h * h / std::max(squaredDistance, 0.25 * h * h);
  }

  // The `most` patches with the largest predicted errors above `least`, largest first; `factorTo(j)` tells the factor to a
  // patch that comes into question, and is taken to be at most area / (pi d^2), what it is facing one straight. Appends to
  // `found`, which is to be empty.
  void find(uint32_t patch, size_t most, double least, const std::function<double(uint32_t)>& factorTo,
            std::vector<Near>& found) const;

 private:
  struct Node {
    Vec3 low{1e300}, high{-1e300};  // of the centres
    double area = 0;                // of the largest patch
    uint32_t first = 0, last = 0;   // in order_
    uint32_t below = 0;             // the first of its two parts; 0 for a leaf
  };
  void build(uint32_t node);
  double bound(const Node& node, uint32_t patch) const;

  std::span<const Vec3> centres_;
  std::span<const double> sizes_;
  std::vector<uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace farol
