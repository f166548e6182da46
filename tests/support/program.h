// Runs the farol program as a user does.
#pragma once

#include <string>

namespace farol::test {

struct Outcome {
  int exitCode = -1;
  std::string out, err;
};

// `arguments` as typed after "farol"; `environment` as typed before it.
Outcome farol(const std::string& arguments, const std::string& environment = "");

}  // namespace farol::test
