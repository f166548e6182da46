// --adapt: patches of the sizes that a trial of the scene asks for.
#pragma once

#include "cli/trials.h"

namespace farol {

struct Adapting {
  PatchOptions size;  // of the largest patches
  AdaptedPatches adapted;
  size_t tried = 0;  // patches of the trial
  double order = 1;  // power of the patches' size that their error falls with, there
};

// The trial that tells them: a grid of patches of size / 2^level.
struct AdaptTrial {
  PatchOptions size;   // of the largest patches
  uint32_t level = 0;  // 0: there are more facets than a trial can halve once, or memory holds then
  size_t patches = 0;
  Setting setting;
};
AdaptTrial adaptTrialOf(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method);

// Deterministic: the options alone decide, and `method` by what rays it follows through mirrors and glass: the trial is made by
// rays. Without a trial every cell keeps a patch.
Adapting adaptTo(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method);

}  // namespace farol
