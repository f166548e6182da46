// What a run writes: pictures, lit scenes, tables, factors, readings.
#pragma once

#include "cli/run_state.h"

namespace farol {

// Of run.lighting: a picture for render, a lit scene for solve; patches and sensors where asked for.
void writeResults(RunState& run);

void writeFactors(RunState& run);

// Where on the surfaces two ways to F differ.
void drawDifference(RunState& run, const Comparison& comparison);

}  // namespace farol
