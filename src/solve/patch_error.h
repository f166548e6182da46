// What constant radiosity per patch costs.
#pragma once

#include "solve/solver.h"

#include <span>

namespace farol {

// Joining patches (joined[j]: the number of what patch j becomes part of) changes H: to first order by what F gathers of the
// differences between B and its means over what is joined, reflected on. Same F, so that its noise does not hide the change.
struct JoiningError {
  double relative = 0;         // rms over area of the change of H, over the mean of H, worst channel
  std::vector<double> change;  // per joined patch, rms over channels [flux per area]
};
JoiningError joiningError(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Solution& solution,
                          std::span<const uint32_t> joined);

}  // namespace farol
