// What constant patches cost H, told from a trial or a finished run by joining its patches to larger ones.
#pragma once

#include "cli/adapting.h"

#include <cmath>

namespace farol {

// The error of a trial or a finished run by its patches, and the power of their size that it falls with. Joining two by two and
// four by four (joiningError) shows by how much the errors of two and four times the size are larger: e (2^p - 1), e (4^p - 1).
struct PatchSizeError {
  double error = 0, order = 1;
  double finer = 1;  // the power towards smaller patches, at most `order`

  double at(double times) const { return error * std::pow(times, times < 1 ? finer : order); }  // of patches so many times the size
};
PatchSizeError patchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting);

// The same for patches of `size` that gather facets, by joining them to those of two and four times the size.
PatchSizeError gatheredPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene, const FacetSet& facets,
                                    const Lighting& lighting, const PatchOptions& size);

// The same for patches of several sizes: the geometric mean of what their trial foretold and what joining those shows that have
// three siblings of their size, nearly all, by the order that the trial has shown. Joining alone told 0.9 to 1.5 times what final
// gathering finds in five runs of three scenes (rooms at --adapt 0.001 to 0.005), the trial 0.8 to 1.4 times, 1.8 at 0.015, their
// mean 1.0 to 1.4 times.
double adaptedPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting,
                           const Adapting& adapting);

}  // namespace farol
