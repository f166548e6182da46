// --tolerance: patches, samples and sweeps that are predicted to meet an error of H at the least cost, from trials of the scene
// at hand.
#pragma once

#include "cli/adapting.h"
#include "cli/trial_laws.h"

namespace farol {

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
  double seconds = 0;     // predicted, of form factors, light and solve, with the trials
  double rowSeconds = 0;  // of these, for rows of F
  double choosing = 0;    // that the trials took
  std::string limitedBy;  // why no better setting was chosen: memory, time, an option; empty: the tolerance is met
};

// `setting` holds what `options` give; what was not given is chosen. Throws Error where nothing emits light.
TolerancePlan planFor(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method);

// The same plan with samples or patches raised, the largest part of the error `found` first, until the whole is predicted to be
// below the tolerance, `careful`: well below it; patches are to be adapted anew.
TolerancePlan refined(const TolerancePlan& plan, const Options& options, const FacetSet& facets, const ErrorParts& found,
                      bool careful = false);

// Patches of several sizes in place of the smaller ones of one size that the refinement `next` asks for, where they are fewer by
// far. `patches`: of the plan.
void adaptInstead(TolerancePlan& next, const TolerancePlan& plan, const Options& options, const Scene& scene,
                  const FacetSet& facets, size_t patches);

// The choices of a refined plan, whose patches are so many, become what it has changed, with what that cost before. Returns these.
std::vector<Choice> takeRefined(TolerancePlan& plan, const TolerancePlan& before, const ErrorParts& found, size_t patches);

}  // namespace farol
