// The program's commands: load, patch, form factors, solve, view, write; each stage timed.
#pragma once

#include "cli/options.h"

namespace farol {

// Runs a command and returns its exit code: 0 done, 3 not converged. Throws Error for everything else.
int run(const Options& options);

}  // namespace farol
