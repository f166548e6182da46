#include "base/machine.h"

#include "base/error.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <string>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

// jemalloc's, in the program that it is linked to (src/main.cpp); a null pointer in others.
extern "C" int mallctl(const char* name, void* old, size_t* oldLength, void* value, size_t length) __attribute__((weak));

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

uint64_t peakMemoryBytes() { return kilobyteLine("/proc/self/status", "VmHWM:"); }
void returnFreedMemory() {
  if (mallctl == nullptr) return;
  mallctl("thread.tcache.flush", nullptr, nullptr, nullptr, 0);
  mallctl("arena.4096.purge", nullptr, nullptr, nullptr, 0);  // 4096: all of them
}
uint64_t residentMemoryBytes() {
  returnFreedMemory();
  return kilobyteLine("/proc/self/status", "VmRSS:");
}
uint64_t availableMemoryBytes() { return kilobyteLine("/proc/meminfo", "MemAvailable:"); }

MappedFile mapFile(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat about {};
  void* memory = nullptr;
  const bool sized = file >= 0 && fstat(file, &about) == 0;
  const auto size = static_cast<size_t>(about.st_size);
  if (sized && size > 0) memory = mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0);
  const int reason = errno;
  if (file >= 0) close(file);
  if (!sized || memory == MAP_FAILED) throw Error("{}: cannot be read: {}", path, std::strerror(reason));
  if (memory == nullptr) return {};
  madvise(memory, size, MADV_HUGEPAGE);  // what is read from a disk comes in large pages where the system has them
  return {{static_cast<const std::byte*>(memory), [size](const std::byte* m) { munmap(const_cast<std::byte*>(m), size); }}, size};
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

double StageClock::totalSeconds() const { return last_; }

}  // namespace farol
