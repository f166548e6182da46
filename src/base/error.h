// The two kinds of failure a user can cause or meet. Both carry one complete sentence and are
// caught once, in main.
#pragma once

#include <fmt/format.h>
#include <stdexcept>
#include <string>
#include <utility>

namespace farol {

// A file, scene, device or machine that cannot do what was asked. Exit code 1.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& sentence) : std::runtime_error(sentence) {}
  template <typename... Args>
  explicit Error(fmt::format_string<Args...> format, Args&&... args)
      : std::runtime_error(fmt::format(format, std::forward<Args>(args)...)) {}
};

// An option that does not exist or is out of range. Exit code 2.
class UsageError : public Error {
 public:
  using Error::Error;
};

// SIGINT or SIGTERM arrived. Exit code 128 + signal.
class Interrupted : public Error {
 public:
  explicit Interrupted(int signalNumber) : Error("interrupted by signal {}", signalNumber), signal(signalNumber) {}
  int signal;
};

}  // namespace farol
