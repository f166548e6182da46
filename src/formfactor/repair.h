// Balances rows of F: A_i F_ij = A_j F_ji and every row's sum kept, entries not negative, zeros kept.
#pragma once

#include "formfactor/form_factors.h"

namespace farol {

struct Repair {
  double meanChange = 0, largestChange = 0;  // of a row, sum_j |F'_ij - F_ij|: area-weighted mean, and largest
  double asymmetry = 0;                      // before: sum |A_i F_ij - A_j F_ji| over sum A_i F_ij
  double closure = 0;                        // largest difference of a row's sum left, relative
  size_t sweeps = 0;
};

// The mean of A_i F_ij and A_j F_ji is symmetric but its rows have other sums; D S D with a positive diagonal D has those that
// are asked for, and of all matrices with them it is the nearest to S by relative entropy (Sinkhorn 1967; Knight and Ruiz 2013).
// The sums are those of the rows that were made: what they miss stays missed. Areas are exposed areas. Rows become lists or dense
// float32. Throws Error where mirrors or glass pass light: rows do not add up to 1 there.
Repair repairRows(FormFactorMatrix& f, const PatchSet& patches);

}  // namespace farol
