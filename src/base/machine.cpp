#include "base/machine.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <new>
#include <string>
#include <sys/mman.h>

namespace farol {
namespace {

// The value in bytes of a line such as "VmHWM:    1234 kB"; 0 when there is none.
uint64_t kilobyteLine(const char* file, const std::string& key) {
  std::ifstream in(file);
  std::string word;
  uint64_t value = 0;
  while (in >> word) {
    if (word == key && in >> value) return value * 1024;
  }
  return 0;
}

}  // namespace

std::string processorName() {
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);) {
    const size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "an unknown processor";
}

uint64_t peakMemoryBytes() {
  return kilobyteLine("/proc/self/status", "VmHWM:");
}
uint64_t availableMemoryBytes() {
  return kilobyteLine("/proc/meminfo", "MemAvailable:");
}

std::shared_ptr<std::byte> freshMemory(size_t bytes) {
  constexpr size_t kHugePage = size_t{1} << 21;
  const size_t rounded = (bytes + kHugePage - 1) / kHugePage * kHugePage;
  void* memory = std::aligned_alloc(kHugePage, std::max(rounded, kHugePage));
  if (memory == nullptr) throw std::bad_alloc();
  madvise(memory, rounded, MADV_HUGEPAGE);
  return {static_cast<std::byte*>(memory), [](std::byte* m) { std::free(m); }};
}

void StageClock::finish(const std::string& name) {
  const double now = watch_.seconds();
  stages_.push_back({name, now - last_, peakMemoryBytes()});
  last_ = now;
}

double StageClock::secondsOf(const std::string& name) const {
  double sum = 0;
  for (const Stage& stage : stages_) {
    if (stage.name == name) sum += stage.seconds;
  }
  return sum;
}

double StageClock::totalSeconds() const {
  return last_;
}

}  // namespace farol
