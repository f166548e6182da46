// Sums over rows of F for three channels at once, or one: where the time of a solve goes. Each is made in the same order
// whatever the processor; nothing is allocated.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace farol {

constexpr size_t kRowsAtOnce = 16;  // at most

// sums[r][c] = sum_j rows[r][j] b[c n + j]: dense rows of float or uint16_t, which share every load of b.
template <size_t Channels, typename Factor>
void gatherRows(std::span<const Factor* const> rows, const double* b, size_t n, double (*sums)[Channels]);

// The same for a row that is a list of hits of one weight, or of ids with values: `b` holds four doubles per patch for
// three channels, one for one, and a last patch of zeros.
template <size_t Channels>
void gatherHits(std::span<const uint32_t> ids, double weight, const double* b, double* sums);
template <size_t Channels>
void gatherEntries(std::span<const uint32_t> ids, std::span<const float> values, const double* b, double* sums);

}  // namespace farol
