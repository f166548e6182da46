#include "formfactor/neighbourhood.h"

#include <algorithm>
#include <numeric>
#include <tbb/parallel_sort.h>

namespace farol {
namespace {

// Bits of x spread to every third place.
uint64_t spreadBits(uint64_t x) {
  x = (x | x << 32) & 0x001F00000000FFFFull;
  x = (x | x << 16) & 0x001F0000FF0000FFull;
  x = (x | x << 8) & 0x100F00F00F00F00Full;
  x = (x | x << 4) & 0x10C30C30C30C30C3ull;
  return (x | x << 2) & 0x1249249249249249ull;
}

uint64_t facing(const Vec3& n) {
  const Vec3 a = glm::abs(n);
  const int axis = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
  return uint64_t{2} * static_cast<uint64_t>(axis) + (n[axis] < 0 ? 1 : 0);
}

}  // namespace

Neighbourhood::Neighbourhood(const PatchSet& patches) : order_(patches.size()), placeOf_(patches.size()) {
  Vec3 low(1e300), high(-1e300);
  for (const Patch& p : patches.patches) {
    low = glm::min(low, p.centre);
    high = glm::max(high, p.centre);
  }
  const double size = std::max(maxChannel(high - low), 1e-300);
  std::vector<uint64_t> codes;
  codes.reserve(patches.size());
  for (const Patch& p : patches.patches) {
    const Vec3 x = (p.centre - low) / size * 65535.0;
    codes.push_back(facing(p.normal) << 48 | spreadBits(static_cast<uint64_t>(x.x)) | spreadBits(static_cast<uint64_t>(x.y)) << 1 |
                    spreadBits(static_cast<uint64_t>(x.z)) << 2);
  }
  std::iota(order_.begin(), order_.end(), 0u);
  tbb::parallel_sort(order_.begin(), order_.end(),
                     [&](uint32_t a, uint32_t b) { return codes[a] != codes[b] ? codes[a] < codes[b] : a < b; });
  for (uint32_t k = 0; k < order_.size(); ++k) placeOf_[order_[k]] = k;
}

std::vector<double> Neighbourhood::smoothed(const std::vector<double>& values, size_t half) const {
  const size_t n = order_.size();
  std::vector<double> result(n);
  for (size_t k = 0; k < n; ++k) {
    const size_t first = k - std::min(k, half), last = std::min(n, k + half + 1);
    double sum = 0;
    for (size_t l = first; l < last; ++l) sum += values[order_[l]];
    result[order_[k]] = sum / static_cast<double>(last - first);
  }
  return result;
}

std::vector<uint32_t> Neighbourhood::groups(size_t count) const {
  const size_t n = order_.size();
  count = std::min(count, n);
  std::vector<uint32_t> groupOf(n);
  for (size_t k = 0; k < n; ++k) groupOf[order_[k]] = static_cast<uint32_t>(k * count / n);
  return groupOf;
}

std::vector<uint32_t> Neighbourhood::sortedProbes(std::span<const uint32_t> probes) const {
  std::vector<uint32_t> sorted(probes.size());
  std::iota(sorted.begin(), sorted.end(), 0u);
  std::sort(sorted.begin(), sorted.end(), [&](uint32_t a, uint32_t b) { return placeOf_[probes[a]] < placeOf_[probes[b]]; });
  return sorted;
}

}  // namespace farol
