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

// The same for rows that are lists of ids, with values (Weighted) or each counting 1: `b` holds four doubles per patch for
// three channels, one for one, and a last patch of zeros. Rows of neighbours are best given together.
struct ListRow {
  const uint32_t* ids;
  const float* values;
  size_t count;
};
template <size_t Channels, bool Weighted>
void gatherLists(std::span<const ListRow> rows, const double* b, double (*sums)[Channels]);

}  // namespace farol
