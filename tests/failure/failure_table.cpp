#include "failure_table.h"

#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <map>
#include <vector>

namespace farol::test {
namespace {

std::map<int, std::vector<std::string>>& lines() {
  static std::map<int, std::vector<std::string>> all;
  return all;
}

struct Writer : ::testing::Environment {
  void TearDown() override {
    const char* path = std::getenv("FAROL_FAILURE_TABLE");
    if (path == nullptr) return;
    std::ofstream file(path);
    file << "| | failure | naive | farol | what it says |\n|---|---|---|---|---|\n";
    for (const auto& [entry, texts] : lines()) {
      for (const std::string& text : texts) file << "| " << entry << " | " << text << " |\n";
    }
  }
};

const ::testing::Environment* const kWriter = ::testing::AddGlobalTestEnvironment(new Writer);

}  // namespace

void tabulate(int entry, const std::string& failure, const std::string& naive, const std::string& byDefault,
              const std::string& says) {
  lines()[entry].push_back(failure + " | " + naive + " | " + byDefault + " | " + says);
}

}  // namespace farol::test
