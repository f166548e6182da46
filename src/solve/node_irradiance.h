// Irradiance at the corners of cells, for smooth display: the mean over the patches that touch a point and share
// its plane (or its smooth shading normal), so that flat and rounded surfaces are smooth and creases stay sharp.
#pragma once

#include "solve/solver.h"

#include <vector>

namespace farol {

class NodeIrradiance {
 public:
  NodeIrradiance(const Scene& scene, const FacetSet& facets, const PatchSet& patches, const FormFactorMatrix* f,
                 const std::vector<Rgb>& irradiance);

  // True when the side of the facet has patches; a side without is black.
  bool has(uint32_t facet, bool back) const { return firstNode_[2 * facet + (back ? 1 : 0)] != kNone; }

  // Irradiance at (u,v): bilinear within a parallelogram's cell, linear within a triangle's.
  Rgb at(uint32_t facet, bool back, double u, double v) const;

 private:
  const FacetSet& facets_;
  const PatchSet& patches_;
  std::vector<uint32_t> firstNode_;  // [2 x facets] front and back of each facet
  std::vector<Rgb> values_;          // per node: parallelogram (nu+1) x (nv+1) by rows, triangle rows of n+1-v
};

}  // namespace farol
