#include "chart/schedule.h"

namespace farol {

void Schedule::add(size_t kind, double guess, std::vector<double> work) { queues_.push_back({kind, std::move(work), guess}); }

std::optional<Schedule::Next> Schedule::next() const {
  std::optional<Next> cheapest;
  for (size_t k = 0; k < queues_.size(); ++k) {
    const Queue& q = queues_[k];
    if (q.at < q.work.size() && (!cheapest || q.predicted < cheapest->seconds)) cheapest = {k, q.at, q.predicted};
  }
  return cheapest;
}

void Schedule::took(double seconds, double sampling) {
  Queue& own = queues_[next()->queue];
  if (own.at == 0) {
    const double off = seconds / own.predicted;
    for (Queue& q : queues_) {
      if (q.at == 0 && q.kind == own.kind) q.predicted *= off;
    }
  }
  if (++own.at < own.work.size()) own.predicted = seconds + sampling * (own.work[own.at] / own.work[own.at - 1] - 1);
}

}  // namespace farol
