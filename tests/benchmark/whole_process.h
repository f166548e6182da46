// Whole processes, timed as a user would.
#pragma once

#include "base/machine.h"

#include <algorithm>
#include <cstdlib>
#include <fmt/format.h>
#include <string>
#include <vector>

namespace farol::benchmark {

inline double medianSeconds(const std::string& command, int repeats) {
  std::vector<double> seconds;
  for (int k = 0; k < repeats; ++k) {
    const Stopwatch watch;
    if (std::system(command.c_str()) != 0) {
      fmt::print(stderr, "failed: {}\n", command);
      std::exit(1);
    }
    seconds.push_back(watch.seconds());
  }
  std::sort(seconds.begin(), seconds.end());
  return seconds[seconds.size() / 2];
}

}  // namespace farol::benchmark
