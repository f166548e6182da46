// Runs the farol program as a user does.
#pragma once

#include <string>

namespace farol::test {

struct Outcome {
  int exitCode = -1;
  std::string out, err;
  size_t peakBytes = 0;  // largest resident set, as the operating system counted it
};

// `arguments` as typed after "farol"; `environment` as typed before it.
Outcome farol(const std::string& arguments, const std::string& environment = "");

}  // namespace farol::test
