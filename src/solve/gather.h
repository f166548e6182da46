// Sums over rows of F for three channels at once, or one: where the time of a solve goes. Each is made in the same order
// whatever the processor; nothing is allocated. `Number` is what b is read in: of floats, which are half as many bytes and
// twice as many a vector, some hundred products at most are added up before they go to a sum in double, so that sums are good
// to some 1e-7 of that of their absolute values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace farol {

constexpr size_t kRowsAtOnce = 16;  // at most

// sums[r][c] = sum_j rows[r][j] b[c n + j]: dense rows of float or uint16_t, which share every load of b.
template <size_t Channels, typename Factor, typename Number>
void gatherRows(std::span<const Factor* const> rows, const Number* b, size_t n, double (*sums)[Channels]);

// The same for rows that are lists of ids, with values (Weighted) or each counting 1: `b` holds four numbers per patch for
// three channels, one for one, and a last patch of zeros.
struct ListRow {
  const uint32_t* ids;
  const float* values;
  size_t count;
};
template <size_t Channels, bool Weighted, typename Number>
void gatherLists(std::span<const ListRow> rows, const Number* b, double (*sums)[Channels]);

}  // namespace farol
