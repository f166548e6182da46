// Patches as small as their light asks for: large where radiosity hardly changes, small at the edges of shadows and near
// walls. Quadtrees over the cells of every facet's side.
#pragma once

#include "solve/solver.h"

#include <unordered_set>

namespace farol {

// Node (l, k) of a side is cell k of its grid at level l, halved l times; what is split has its four parts at level l + 1.
class PatchTree {
 public:
  static constexpr uint32_t kMostLevels = 10;

  uint32_t levels() const { return levels_; }  // of the grid on which the smallest patches are cells
  void split(uint32_t facet, bool back, uint32_t level, uint32_t cell);
  bool isSplit(uint32_t facet, bool back, uint32_t level, uint32_t cell) const {
    return split_.contains(keyOf(facet, back, level, cell));
  }

  // Of patches made with PatchOptions::levels of `levels`, at least levels(). Fronts come first.
  std::vector<uint32_t> cellMap(const PatchSet& cells, const FacetSet& facets, uint32_t levels) const;

 private:
  static uint64_t keyOf(uint32_t facet, bool back, uint32_t level, uint32_t cell) {
    return uint64_t{level} << 60 | uint64_t{2 * facet + (back ? 1u : 0u)} << 32 | cell;
  }
  std::unordered_set<uint64_t> split_;
  uint32_t levels_ = 0;
};

// Patches of the sizes that a tree says; of one size, one per cell, where it splits nothing and `options.levels` is 0. Otherwise
// the tree's levels are those of the grid.
PatchSet buildPatches(const Scene& scene, const FacetSet& facets, PatchOptions options, const PatchTree& tree);

struct AdaptedPatches {
  PatchTree tree;
  double error = 0;    // predicted: rms over area of what constant patches change in H, over its mean
  size_t patches = 0;  // predicted
};

// The tree of the fewest patches that are predicted to meet `error`, from a solution on the grid at `level`, one patch per
// cell. What a node costs is what F gathers of the differences between B and its mean over the node, and a small part of the
// differences of H that it hides; below the grid it falls with the size to the power `order`, above it is seen. `samples` per
// row: their noise is taken off.
AdaptedPatches adaptPatches(const FacetSet& facets, const PatchSet& patches, uint32_t level, const FormFactorMatrix& f,
                            const DirectLight& direct, const Solution& solution, double samples, double order, double error);

}  // namespace farol
