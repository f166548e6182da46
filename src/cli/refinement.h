// What a plan becomes where the estimates of its errors are above the tolerance.
#pragma once

#include "cli/tolerance.h"

namespace farol {

// The same plan with samples or patches raised, the largest part of the error `found` first, until the whole is predicted to be
// below the tolerance, `careful`: well below it; patches are to be adapted anew.
TolerancePlan refined(const TolerancePlan& plan, const Options& options, const FacetSet& facets, const ErrorParts& found,
                      bool careful = false);

// Patches of several sizes in place of the smaller ones of one size that the refinement `next` asks for, where they are fewer by
// far. `patches`: of the plan, whose errors were `found`.
void adaptInstead(TolerancePlan& next, const TolerancePlan& plan, const Options& options, const Scene& scene,
                  const FacetSet& facets, const ErrorParts& found, size_t patches);

// The choices of a refined plan, whose patches are so many, become what it has changed, with what that cost before. Returns these.
std::vector<Choice> takeRefined(TolerancePlan& plan, const TolerancePlan& before, const ErrorParts& found, size_t patches);

}  // namespace farol
