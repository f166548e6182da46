// What is known of some patches, carried over to their neighbours.
#pragma once

#include "patch/patches.h"

namespace farol {

// All patches in an order that keeps neighbours together: by the axis that they face, then along a Morton curve.
class Neighbourhood {
 public:
  explicit Neighbourhood(const PatchSet& patches);

  std::span<const uint32_t> order() const { return order_; }

  // Mean of [patches] values over the 2 half + 1 patches around each in the order, shorter at its ends.
  std::vector<double> smoothed(const std::vector<double>& values, size_t half) const;

  // Number of each patch's group: at most `count` groups of neighbours, about equal in size.
  std::vector<uint32_t> groups(size_t count) const;

  // For every patch the figures of a window of `count` probes around it in the order, fewer if there are no more:
  // `use(patch, window)` hears of the window as numbers of probes.
  template <typename Use>
  void forEachWindow(std::span<const uint32_t> probes, size_t count, Use&& use) const {
    const std::vector<uint32_t> sorted = sortedProbes(probes);
    size_t next = 0;  // first probe at or after the patch
    for (size_t k = 0; k < order_.size(); ++k) {
      while (next < sorted.size() && placeOf_[probes[sorted[next]]] < k) ++next;
      const size_t half = std::min(count / 2, next);
      const size_t last = std::min(sorted.size(), next - half + count), first = last - std::min(count, last);
      use(order_[k], std::span<const uint32_t>(sorted).subspan(first, last - first));
    }
  }

 private:
  std::vector<uint32_t> sortedProbes(std::span<const uint32_t> probes) const;

  std::vector<uint32_t> order_, placeOf_;  // [patches]
};

}  // namespace farol
