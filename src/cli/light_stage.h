// The stage of a run that lights the scene on its F.
#pragma once

#include "cli/run_state.h"

namespace farol {

// Direct light, solve and errors of the scene as it stands, into run.lighting; without F, emitters as points.
void light(RunState& run);
void sayLight(const RunState& run);

// The figures of run.lighting, into the report.
void reportSolution(RunState& run);

// What a device that failed has left is solved on the CPU, and so is all that follows.
void leaveFailedDevice(RunState& run, const Solution& solution);

}  // namespace farol
