// `farol info`: what a run would take, before anything is computed.
#pragma once

#include "cli/run_state.h"

namespace farol {

void forecast(RunState& run);

}  // namespace farol
