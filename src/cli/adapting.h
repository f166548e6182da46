// --adapt: patches of the sizes that a trial of the scene asks for.
#pragma once

#include "cli/trials.h"

namespace farol {

struct Adapting {
  PatchOptions size;  // of the largest patches
  AdaptedPatches adapted;
  size_t tried = 0;   // patches of the trial
  double order = 1;   // power of the patches' size that their error falls with, there
};

// Deterministic: the options alone decide, and `method` by what rays it follows through mirrors and glass: the trial is made by
// rays. Scenes of more facets than a trial can halve once, or memory holds then, keep a patch per cell.
Adapting adaptTo(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method);

}  // namespace farol
