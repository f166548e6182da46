#include "formfactor/packing.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace farol {

PackedRow packRow(std::span<const float> row) {
  constexpr size_t kListedShare = 64;  // at most one entry of so many is listed
  constexpr double kMost = std::numeric_limits<uint16_t>::max();
  PackedRow packed;
  packed.steps.assign(row.size(), 0);
  if (row.empty()) return packed;

  std::vector<float> ordered(row.begin(), row.end());
  const auto listed = static_cast<std::ptrdiff_t>(row.size() / kListedShare);
  std::nth_element(ordered.begin(), ordered.begin() + listed, ordered.end(), std::greater<>());
  const float threshold = ordered[static_cast<size_t>(listed)];
  if (threshold > 0) packed.step = static_cast<float>(static_cast<double>(threshold) / kMost);

  const auto step = static_cast<double>(packed.step);
  double sum = 0;
  int64_t total = 0;
  std::vector<uint32_t> places;  // of entries that could take one step more
  std::vector<double> remainders(row.size(), 0);
  for (uint32_t j = 0; j < row.size(); ++j) {
    const auto value = static_cast<double>(row[j]);
    if (row[j] > threshold) {
      packed.ids.push_back(j);
      packed.values.push_back(row[j]);
    } else if (value > 0) {
      const double steps = std::min(std::floor(value / step), kMost);
      packed.steps[j] = static_cast<uint16_t>(steps);
      remainders[j] = value / step - steps;
      total += static_cast<int64_t>(steps);
      sum += value;
      if (steps < kMost) places.push_back(j);
    }
  }
  if (step > 0) {
    const auto missing = std::clamp<int64_t>(std::llround(sum / step) - total, 0, static_cast<int64_t>(places.size()));
    std::nth_element(places.begin(), places.begin() + missing, places.end(), [&](uint32_t a, uint32_t b) {
      return remainders[a] != remainders[b] ? remainders[a] > remainders[b] : a < b;
    });
    for (int64_t k = 0; k < missing; ++k) ++packed.steps[places[static_cast<size_t>(k)]];
    for (size_t j = 0; j < row.size(); ++j) {
      if (row[j] <= threshold) packed.error += std::abs(packed.steps[j] * step - static_cast<double>(row[j]));
    }
  }
  return packed;
}

}  // namespace farol
