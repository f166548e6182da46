// A row of F in 16 bits per entry.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace farol {

// entry j = steps[j] x step, or, where j is in `ids`, the value there. Steps are chosen by largest remainder, so that the
// row keeps its sum to half a step; the few largest entries stay in float32, so that a step is small: no entry moves by
// more than a step, a 65,535th of the largest entry that is not listed.
struct PackedRow {
  std::vector<uint16_t> steps;  // [patches]
  float step = 0;
  std::vector<uint32_t> ids;  // ascending
  std::vector<float> values;
  double error = 0;  // sum_j |entry - what it was|
};

PackedRow packRow(std::span<const float> row);  // entries of 0 or more

}  // namespace farol
