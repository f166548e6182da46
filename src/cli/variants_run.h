// --variants in a run.
#pragma once

#include "cli/run_state.h"

namespace farol {

// Every variant's results, on the F at hand.
void solveVariants(RunState& run);

}  // namespace farol
