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

}  // namespace farol
