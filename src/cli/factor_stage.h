// The stage of a run that makes F, or takes it from a file, and tells how good it is.
#pragma once

#include "cli/run_state.h"

namespace farol {

// By run.spec, for run.patches.
void makeFactors(RunState& run);

// Rows that are made again to tell the error of H.
size_t replicatedRows(size_t patches, bool hemicubes);

// From run.kept.
void loadFactors(RunState& run);

// Which parts of the model the scene asks for, and what mirrors and glass are worth; `metSpecular` is the share of what
// patches see first that is one of these.
void sayModel(RunState& run, double metSpecular);

}  // namespace farol
