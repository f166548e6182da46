#include "base/log.h"

#include "base/signals.h"

#include <algorithm>
#include <cstdio>
#include <fmt/format.h>
#include <unistd.h>
#include <utility>

namespace farol {

Log::Log(bool quiet) : quiet_(quiet) {}

Log Log::silent() {
  Log log(true);
  log.silent_ = true;
  return log;
}

void Log::warn(const Warning& warning) {
  const auto same = [&](const Warning& w) { return w.code == warning.code && w.sentence == warning.sentence; };
  if (std::any_of(warnings_.begin(), warnings_.end(), same)) return;
  warnings_.push_back(warning);
  if (!silent_) fmt::print(stderr, "warning: {} [{}]\n", warning.sentence, warning.code);
}

void Log::note(const std::string& sentence) {
  if (!quiet_) fmt::print(stderr, "{}\n", sentence);
}

Progress::Progress(const Log& log, std::string what, std::string unit, size_t total)
    : what_(std::move(what)),
      unit_(std::move(unit)),
      total_(total),
      quiet_(log.quiet()),
      terminal_(isatty(STDERR_FILENO) != 0),
      start_(std::chrono::steady_clock::now()),
      last_(start_) {}

Progress::~Progress() {
  if (!printed_) return;
  print(std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
  if (terminal_) fmt::print(stderr, "\n");
}

void Progress::update(size_t done) {
  throwIfInterrupted();
  done_ = done;
  if (quiet_) return;
  const auto now = std::chrono::steady_clock::now();
  const double interval = terminal_ ? 0.1 : 2.0;  // seconds between lines: a bar may be lively, a log file not
  if (std::chrono::duration<double>(now - last_).count() < interval) return;
  last_ = now;
  printed_ = true;
  print(std::chrono::duration<double>(now - start_).count());
}

void Progress::print(double seconds) {
  const double rate = seconds > 0 ? static_cast<double>(done_) / seconds : 0;
  const double left = rate > 0 ? static_cast<double>(total_ - std::min(done_, total_)) / rate : 0;
  const double share = total_ > 0 ? static_cast<double>(done_) / static_cast<double>(total_) : 1;
  std::string bar;
  if (terminal_) bar = "\r\033[K";
  if (terminal_ && total_ > 0) {
    const auto filled = static_cast<size_t>(std::clamp(share, 0.0, 1.0) * 24);
    bar += fmt::format("[{}{}] ", std::string(filled, '#'), std::string(24 - filled, '.'));
  }
  const std::string counts = total_ > 0
                                 ? fmt::format("{} of {} {}, {:.0f} {}/s, {:.0f} s left", done_, total_, unit_, rate, unit_, left)
                                 : fmt::format("{} {}, {:.1f} {}/s", done_, unit_, rate, unit_);
  fmt::print(stderr, "{}{}: {}{}", bar, what_, counts, terminal_ ? "" : "\n");
  std::fflush(stderr);
}

}  // namespace farol
