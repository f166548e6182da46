// In which order the settings of a chart are measured: what is predicted to take least comes first, so that where time ends it
// is the costliest that are missing.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace farol {

class Schedule {
 public:
  // The settings of one method at one size, the cheapest first: how much each has to sample [any unit], and a guess at what the
  // first takes [seconds]. Guesses of one kind are taken to be off by one factor, that of the one measured last.
  void add(size_t kind, double guess, std::vector<double> work);

  struct Next {
    size_t queue, setting;  // numbers, in the order of add() and of its work
    double seconds;         // predicted
  };
  std::optional<Next> next() const;  // none: all are measured

  // What measuring next() took [seconds], and how much of it sampled: that grows with the work, the rest does not.
  void took(double seconds, double sampling);

 private:
  struct Queue {
    size_t kind;
    std::vector<double> work;
    double predicted;
    size_t at = 0;
  };
  std::vector<Queue> queues_;
};

}  // namespace farol
