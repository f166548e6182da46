// Patches as small as their light asks for: large where radiosity hardly changes, small at the edges of shadows and near
// walls.
#pragma once

#include "patch/patch_tree.h"
#include "solve/solver.h"

namespace farol {

struct AdaptedPatches {
  PatchTree tree;
  double error = 0;    // predicted: rms over area of what constant patches change in H, over its mean
  size_t patches = 0;  // predicted
};

// The tree of the fewest patches that are predicted to meet `error` (where its depth does not suffice: to come near it), from
// a solution on the grid at `level`, one patch per cell. What a node costs is what F gathers of the differences between B and
// its mean over the node, and a small part of the differences of H that it hides; below the grid it falls with the size to
// the power `order`, above it is seen. `samples` per row: most of their noise is taken off.
AdaptedPatches adaptPatches(const FacetSet& facets, const PatchSet& patches, uint32_t level, const FormFactorMatrix& f,
                            const DirectLight& direct, const Solution& solution, double samples, double order, double error);

}  // namespace farol
