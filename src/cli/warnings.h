// What a run warns of: each with a code, the surfaces concerned and the estimated effect (base/log.h).
#pragma once

#include "base/log.h"
#include "formfactor/error_model.h"
#include "solve/solver.h"

namespace farol {

void warnOfOverlaps(const Scene& scene, const FacetSet& facets, double totalArea, Log& log);  // totalArea [scene units squared]
void warnOfBrokenRules(const FormFactorChecks& c, const FormFactorMatrix& f, const ErrorModel& model, const PatchSet& patches,
                       const Scene& scene, Log& log);
void warnOfDrift(const EnergyBalance& energy, const Solution& solution, Log& log);
void warnOfSlowLight(const Solution& solution, Log& log);

}  // namespace farol
