// Collects what tests of failures found: one line each of the table in README.md, which
// FAROL_FAILURE_TABLE=FILE makes the test program write.
#pragma once

#include <string>

namespace farol::test {

// `entry`: number in the list of failures. What the naive setting gives, what the program gives, and what it says.
void tabulate(int entry, const std::string& failure, const std::string& naive, const std::string& byDefault,
              const std::string& says);

}  // namespace farol::test
