// Patches of different sizes: quadtrees over the cells of every facet's side.
#pragma once

#include "patch/patches.h"

#include <unordered_set>

namespace farol {

// Node (l, k) of a side is cell k of its grid at level l, halved l times; what is split has its four parts at level l + 1.
class PatchTree {
 public:
  static constexpr uint32_t kMostLevels = 8;

  uint32_t levels() const { return levels_; }  // of the grid on which the smallest patches are cells
  void split(uint32_t facet, bool back, uint32_t level, uint32_t cell);
  bool isSplit(uint32_t facet, bool back, uint32_t level, uint32_t cell) const;

  // Of patches made with PatchOptions::levels of `levels`, at least levels(). Fronts come first.
  std::vector<uint32_t> cellMap(const PatchSet& cells, const FacetSet& facets, uint32_t levels) const;

 private:
  std::unordered_set<uint64_t> split_;
  uint32_t levels_ = 0;
};

// Patches of the sizes that a tree says, on a grid of its levels; where it splits nothing, as the options say.
PatchSet buildPatches(const Scene& scene, const FacetSet& facets, PatchOptions options, const PatchTree& tree);

// Joins patches of a tree of so many levels with their three siblings, where all of them are patches: [patches] the number of
// what each becomes part of, from 0 without gaps.
std::vector<uint32_t> joinedSiblings(const PatchSet& patches, const FacetSet& facets, uint32_t levels);

}  // namespace farol
