// Rows of F by rays (Malley's method): directions distributed as the cosine, origins spread over the patch, so that a
// row estimates the area-to-area factors. The error of a row falls with the number of rays K as about K^-0.6 (from one
// origin K^-0.73; random directions K^-0.5).
#pragma once

#include "formfactor/form_factors.h"
#include "formfactor/tile_rays.h"
#include "trace/ray_tree.h"

#include <memory>

namespace farol {

struct RayOptions {
  uint32_t rays = 256;  // K per patch
  uint64_t seed = 1;
  TreeLimits limits = {};  // of paths over mirrors and glass
  bool spread = true;      // origins over the patch; otherwise all at its centre (for comparison)
  SampleTable::Kind kind = SampleTable::Kind::lowDiscrepancy;
};

// Works on all cores through TBB; a row does not depend on the number of threads.
class RayRowMaker : public RowMaker {
 public:
  // The references must outlive the maker.
  RayRowMaker(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const RayOptions& options);
  ~RayRowMaker() override;

  void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace farol
