// Points spread over a patch, with weights, for area averages.
#pragma once

#include "patch/patches.h"

#include <vector>

namespace farol {

struct Position {
  Vec3 point{0};      // [unit coordinates]
  double weight = 0;  // the weights of a patch sum to 1
  Vec3 normal{0};     // unit vector on the patch's side, of the piece
};

// `count` positions over patch i. One is the centroid, or the centre of the piece nearest to it; a square number on a
// patch of one piece is a product Gauss rule (on triangles in collapsed coordinates: Stroud 1971); several pieces get such
// a rule each where there are four positions or more for every one, at most `count` together; anything else is the R2
// sequence (Roberts 2018) spread over the patch's pieces by area, shifted per patch by `seed`.
std::vector<Position> positionsOn(const FacetSet& facets, const PatchSet& patches, uint32_t patch, int count, uint64_t seed);

// Nodes in (0,1) and weights (sum 1) of the n-point Gauss-Legendre rule.
struct GaussRule {
  std::vector<double> nodes, weights;
};
GaussRule gaussLegendre(int n);

}  // namespace farol
