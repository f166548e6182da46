// Two form-factor matrices of the same patches, row by row.
#pragma once

#include "formfactor/error_model.h"

namespace farol {

struct RowDifference {
  double l1 = 0;                        // sum_j |A_ij - B_ij|
  double largest = 0;                   // max_j |A_ij - B_ij|
  uint32_t more = kNone, less = kNone;  // the patches that A sees most more and most less of than B
  double moreBy = 0, lessBy = 0;
  double estimate = 0;  // of l1, from both error models; 0: unknown
};

struct Comparison {
  std::vector<RowDifference> rows;  // [patches]
  double l1Mean = 0, l1Max = 0;     // weighted by exposed area; largest
  double rms = 0;                   // root of the area-weighted mean of l1^2
  double largest = 0;               // entry
  uint32_t worst = 0;               // row with the largest l1 beyond its estimate
  double withinEstimate = 0;        // share of rows whose l1 is at most the estimate; 0 where there is none
};

// Row errors of two independent estimates add as squares.
Comparison compareFactors(const FormFactorMatrix& a, const ErrorModel& errorA, const FormFactorMatrix& b, const ErrorModel& errorB,
                          const PatchSet& patches);

}  // namespace farol
