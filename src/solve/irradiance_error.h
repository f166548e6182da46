// Standard errors of H: what sampling F and the direct light contributes.
#pragma once

#include "formfactor/error_model.h"
#include "solve/solver.h"

#include <optional>

namespace farol {

// Rows of some patches, made again: the difference tells the error.
struct Replicates {
  std::vector<uint32_t> patches;
  std::optional<FormFactorMatrix> rows;  // [all patches], those of `patches` made; none: F has no sampling error
  // The rows are much better than F's and show its bias; otherwise they differ from F's in their random numbers only, and
  // half of the squared difference is F's.
  bool better = false;
  double seconds = 0;  // that the rows took
};

// Per patch and channel the standard error of H [flux per area]. Squares of three parts are added:
//   F: (sum_j F_ij R_j^2 - (sum_j F_ij R_j)^2) / K, the variance of K independent samples of what F carries (R, and the
//      sky where a row misses);
//   direct light: what the rounds of its shadow rays show, smoothed over neighbours;
//   solver: the error that its residual bounds.
// Samples of F are not independent: their part is smoothed over neighbours and scaled by what the replicates of the 24
// nearest patches show. Then what the errors of other rows bring is added, through (I - F rho)^-1 between at most 96
// groups of neighbours. Two standard errors cover the true error of about 95 patches of 100.
std::vector<Rgb> irradianceError(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct,
                                 const Solution& solution, const Replicates& replicates, double samples, const Rgb& sky);

}  // namespace farol
