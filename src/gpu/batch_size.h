// How much one submission holds. Drivers end work that keeps a device busy for seconds, as if it hung: batches start small
// and grow until one takes a quarter of a second.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace farol::gpu {

class BatchSize {
 public:
  static constexpr double kSeconds = 0.25;

  BatchSize(uint32_t first, uint32_t least, uint32_t most) : least_(least), most_(most), now_(std::clamp(first, least, most)) {}

  uint32_t now() const { return now_; }

  // `count` took so many seconds. Grows twofold at most: the next ones may be dearer.
  void took(uint32_t count, double seconds) {
    if (count == 0) return;
    const double wanted = count * kSeconds / std::max(seconds, 1e-9);
    now_ = static_cast<uint32_t>(
        std::clamp(std::floor(std::min(wanted, 2.0 * now_)), static_cast<double>(least_), static_cast<double>(most_)));
  }

 private:
  uint32_t least_, most_, now_;
};

}  // namespace farol::gpu
