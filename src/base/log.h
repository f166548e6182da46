// What the program says while it works: warnings, which are also kept for the report, and progress.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace farol {

struct Warning {
  std::string code;  // fixed: what kind of warning this is
  std::string sentence;
  std::vector<std::string> surfaces = {};  // concerned, as far as they are known
  std::optional<double> effect = {};       // estimated, as the sentence says in words
};

// Writes to standard error. Quiet prints warnings and errors only.
class Log {
 public:
  explicit Log(bool quiet = false);
  static Log silent();  // keeps warnings, prints nothing

  void warn(const Warning& warning);       // printed once and kept
  void note(const std::string& sentence);  // printed unless quiet

  const std::vector<Warning>& warnings() const { return warnings_; }
  bool quiet() const { return quiet_; }

 private:
  bool quiet_, silent_ = false;
  std::vector<Warning> warnings_;
};

// Progress of one stage of counted work: a bar with rate and time left on a terminal, a plain line
// every few seconds elsewhere, nothing when quiet. A total of 0 means that the end is not known. Every update also ends
// the work with Interrupted when a signal has arrived.
class Progress {
 public:
  Progress(const Log& log, std::string what, std::string unit, size_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void update(size_t done);
  void growTotal(size_t more) { total_ += more; }

 private:
  void print(double seconds);

  std::string what_, unit_;
  size_t total_, done_ = 0;
  bool quiet_, terminal_, printed_ = false;
  std::chrono::steady_clock::time_point start_, last_;
};

}  // namespace farol
