// Time and memory as the operating system counts them.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace farol {

std::string processorName();      // as the operating system calls it
uint64_t peakMemoryBytes();       // VmHWM of this process [bytes]; 0 where unknown
void returnFreedMemory();         // of the heap, to the system: it keeps it otherwise
uint64_t residentMemoryBytes();   // VmRSS after that [bytes]; 0 where unknown
uint64_t availableMemoryBytes();  // MemAvailable of the machine [bytes]; 0 where unknown

// A file's contents as memory, read when looked at. Throws Error with the file's name and the system's reason.
struct MappedFile {
  std::shared_ptr<const std::byte> bytes;
  size_t size = 0;
};
MappedFile mapFile(const std::string& path);

// Seconds since construction.
class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

struct Stage {
  std::string name;
  double seconds = 0;
  uint64_t peakBytes = 0;  // the process's peak when the stage ended
};

// The stages of a run in order. Time from one `finish` to the next belongs to the stage named, so
// that the stages add up to the whole run.
class StageClock {
 public:
  void finish(const std::string& name);
  const std::vector<Stage>& stages() const { return stages_; }
  double secondsOf(const std::string& name) const;  // 0 when there is no such stage
  double totalSeconds() const;

 private:
  std::vector<Stage> stages_;
  Stopwatch watch_;
  double last_ = 0;
};

}  // namespace farol
