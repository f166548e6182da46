// --tolerance: patches, samples and sweeps that are predicted to meet an error of H at the least cost, from trials of the scene
// at hand.
#pragma once

#include "cli/adapting.h"

namespace farol {

// The parts of the error of H, relative to its mean; their squares add.
struct ErrorParts {
  double patches = 0, rows = 0, light = 0, sweeps = 0;
  double total() const { return std::sqrt(patches * patches + rows * rows + light * light + sweeps * sweeps); }
};

// One thing that was chosen.
struct Choice {
  std::string what, value, why;
};

struct TolerancePlan {
  PatchOptions size;
  double adapt = 0;                 // as --adapt takes it; 0: patches of one size
  std::optional<Adapting> adapted;  // the patches of that
  Setting setting;
  std::vector<Choice> choices;
  ErrorParts predicted;
  double seconds = 0;       // predicted, of form factors, light and solve, with the trials
  double rowSeconds = 0;    // of these, for rows of F
  double choosing = 0;      // that the trials took
  std::string limitedBy;    // why no better setting was chosen: memory, time, an option; empty: the tolerance is met
};

// `setting` holds what `options` give; what was not given is chosen. Throws Error where nothing emits light.
TolerancePlan planFor(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method);

// The error of a trial or a finished run by its patches, and the power of their size that it falls with. Joining two by two and
// four by four (joiningError) shows by how much the errors of two and four times the size are larger: e (2^p - 1), e (4^p - 1).
struct PatchSizeError {
  double error = 0, order = 1;
};
PatchSizeError patchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting);

// The same for patches of `size` that gather facets, by joining them to those of two and four times the size.
PatchSizeError gatheredPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene, const FacetSet& facets, const Lighting& lighting,
                                    const PatchOptions& size);

// The same for patches of several sizes, by joining those that have three siblings of their size, nearly all, and the order that
// the trial has shown.
double adaptedPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting, const Adapting& adapting);

// The same plan with samples or patches raised, the largest part of the error `found` first, until the whole is predicted to be
// below the tolerance; patches are to be adapted anew.
TolerancePlan refined(const TolerancePlan& plan, const Options& options, const FacetSet& facets, const ErrorParts& found);

}  // namespace farol
