// Standard errors of H: what sampling F and the direct light contributes.
#pragma once

#include "formfactor/error_model.h"
#include "solve/solver.h"

namespace farol {

// Per patch the standard error of H, worst channel [flux per area]:
//   F: q^2 (sum_j F_ij R_j^2 - (sum_j F_ij R_j)^2) / K, the law of K independent samples of what F carries (R, and the
//      sky where a row misses), with q fitted on the probes;
//   direct light: the deviation of the shadow rays times the factor `direct`;
//   solver: the error that its residual bounds.
// In scenes of at most 256 patches each row's error is carried on to all patches through (I - F rho)^-1; in larger
// ones the errors of many rows average out.
struct IrradianceErrorOptions {
  double direct = 1;  // factor on DirectLight::deviation, from probes
  Rgb sky{0};
};
std::vector<double> irradianceError(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct,
                                    const Solution& solution, const ProbeRows& probes, double samples,
                                    const IrradianceErrorOptions& options);

}  // namespace farol
