// --tolerance and --adapt in a run: the patches and settings that they choose, taken.
#pragma once

#include "cli/run_state.h"

namespace farol {

// Patches as small as their light asks for (--adapt).
void adapt(RunState& run);

// Plans and takes the plan's options and patches; computes nothing.
void choosePlan(RunState& run);

// Plans, makes F, lights, and refines where the estimate of what was reached says so.
void meetTolerance(RunState& run);

}  // namespace farol
