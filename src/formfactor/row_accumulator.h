// A row of F from the hemicubes of its patch, whose counts a shader has summed. Internal to this room.
#pragma once

#include "formfactor/form_factors.h"
#include "formfactor/hybrid.h"

namespace farol {

inline constexpr double kFullHemisphere = 4294967295.0;  // 2^32 - 1, the sum of all delta form factors
inline constexpr uint32_t kAllBacks = 0xFFFFFFFFu;       // a position that sees nothing but black backs lies inside a solid

// What one hemicube sees, in delta form factors.
struct SeenCounts {
  std::span<const uint32_t> counts;  // [patches]; or, as a list,
  std::span<const uint32_t> pairs;   // a patch and its count, one after the other, patches ascending
  bool isList = false;
  uint32_t missed = 0, backs = 0;  // nothing, and black backs

  // From bins: the patches, nothing seen, black backs, others.
  static SeenCounts all(std::span<const uint32_t> bins, size_t patches);
  // From pairs (bin, count) of the bins that hold something, ascending; the first pair is their number.
  static SeenCounts listed(std::span<const uint32_t> pairs, size_t patches);

  bool insideSolid() const { return backs == kAllBacks; }

  // Calls `use(j, count)` for all patches, or those of the list.
  template <typename Use>
  void forEach(Use&& use) const {
    for (size_t j = 0; j < counts.size(); ++j) use(j, counts[j]);
    for (size_t k = 0; k < pairs.size(); k += 2) use(size_t{pairs[k]}, pairs[k + 1]);
  }
};

// Weighted counts of the positions seen so far, in order, in double.
struct RowAccumulator {
  std::vector<double> sums;    // [patches]
  std::vector<uint32_t> seen;  // where all positions are lists: the patches whose sum is not 0
  bool lists = false;
  double missed = 0, backs = 0;
  double exposed = 0;          // weight of the positions that are not inside a solid
  ContinuedEntries continued;  // hybrid: what paths add, in shares of a position's weight

  void clear(size_t patches, bool fromLists);
  void add(const SeenCounts& position, double weight);
  void store(RowStore& store, uint32_t patch, double share);

  // A row of what pixels see first and of what paths add, `scale` times.
  static void storeContinued(RowStore& store, uint32_t patch, std::span<const double> first, const ContinuedEntries& more,
                             double scale, const RowShares& shares);
};

}  // namespace farol
