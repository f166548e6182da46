// Sums over rows of F for three channels at once: where the time of a solve goes. Each is made in the same order
// whatever the processor; nothing is allocated.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace farol {

constexpr size_t kRowsAtOnce = 16;  // at most

// sums[r][c] = sum_j rows[r][j] b[c n + j]: dense rows, which share every load of b.
void gatherRows(std::span<const float* const> rows, const double* b, size_t n, double (*sums)[3]);
void gatherRows(std::span<const uint16_t* const> rows, const double* b, size_t n, double (*sums)[3]);

// The same for a row that is a list of hits of one weight, or of ids with values: `packed` holds four doubles per patch
// and a last patch of zeros.
void gatherHits(std::span<const uint32_t> ids, double weight, const double* packed, double* sums);
void gatherEntries(std::span<const uint32_t> ids, std::span<const float> values, const double* packed, double* sums);

}  // namespace farol
