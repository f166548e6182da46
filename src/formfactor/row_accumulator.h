// A row of F from the hemicubes of its patch, whose counts a shader has summed. Internal to this room.
#pragma once

#include "formfactor/form_factors.h"
#include "formfactor/hybrid.h"

namespace farol {

inline constexpr double kFullHemisphere = 4294967295.0;  // 2^32 - 1, the sum of all delta form factors
inline constexpr uint32_t kAllBacks = 0xFFFFFFFFu;  // a position that sees nothing but black backs lies inside a solid

// Weighted counts of the positions seen so far, in order, in double. Bins: the patches, nothing seen, black backs.
struct RowAccumulator {
  std::vector<double> sums;    // [bins]
  double exposed = 0;          // weight of the positions that are not inside a solid
  ContinuedEntries continued;  // hybrid: what paths add, in shares of a position's weight

  void clear(size_t bins);
  void add(const uint32_t* counts, double weight);
  void store(RowStore& store, uint32_t patch, double share) const;

  // A row of what pixels see first and of what paths add, `scale` times.
  static void storeContinued(RowStore& store, uint32_t patch, std::span<const double> first, const ContinuedEntries& more,
                             double scale, const RowShares& shares);
};

}  // namespace farol
