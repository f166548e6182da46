// How large the errors of F are: laws for independent samples, times factors fitted on probe rows of the scene at hand.
#pragma once

#include "formfactor/form_factors.h"

namespace farol {

// Errors fall with the number of low-discrepancy rays to this power: 0.56 to 0.61 measured, 0.625 in theory, where origins are
// spread and the integral has four dimensions.
inline constexpr double kSampleOrder = 0.6;

// An entry estimated by K independent samples has the standard error sqrt(F (1 - F) / K). Samples of rays and pixels
// are not independent but spread evenly, and a single centre point is biased: probe rows tell by what factor the truth
// is smaller or larger.
struct ErrorModel {
  double samples = 0;      // K: rays or pixels per row
  double entry = 0;        // factor on sqrt(F (1 - F) / K), rms over the probes' entries
  std::vector<float> row;  // [patches] L1 error of a row, sum_j |dF_ij|, exceeded by about 1 row in 20
  size_t probes = 0;

  double entryError(double f) const;  // standard error of one entry; 1 / K at least is assumed for F
  double rowError(size_t patch) const { return row.empty() ? 0 : static_cast<double>(row[patch]); }
};

// Rows of a few patches made by many more samples, and made again as F's were with other random numbers: scenes of few
// patches have few rows to learn from. (Two rows of equal quality would not do instead: where patches get about one
// ray each, their difference is up to 1.4 times too small.)
struct ProbeRows {
  std::vector<uint32_t> patches;
  std::vector<FormFactorMatrix> reference;  // one matrix, or none: errors of 0 are then assumed
  std::vector<FormFactorMatrix> again;

  size_t times() const { return reference.empty() ? 0 : 1 + again.size(); }
  const FormFactorMatrix& made(const FormFactorMatrix& f, size_t which) const { return which == 0 ? f : again[which - 1]; }
  // Error of a probe's row, [patches]: of F's own (0) or of one made again.
  std::vector<double> error(const FormFactorMatrix& f, size_t which, uint32_t patch) const;
};

// An even choice of at most `count` patches.
std::vector<uint32_t> chooseProbes(const PatchSet& patches, size_t count);

// The errors of rows are two and a half standard deviations above the mean of the 24 nearest probes.
ErrorModel fitErrorModel(const FormFactorMatrix& f, const PatchSet& patches, const ProbeRows& probes, double samples);

}  // namespace farol
