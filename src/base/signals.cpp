#include "base/signals.h"

#include "base/error.h"

#include <csignal>

namespace farol {
namespace {

volatile std::sig_atomic_t arrivedSignal = 0;

void remember(int signalNumber) {
  if (arrivedSignal != 0) std::_Exit(128 + signalNumber);  // asked twice: leave at once
  arrivedSignal = signalNumber;
}

}  // namespace

void installSignalHandlers() {
  std::signal(SIGINT, remember);
  std::signal(SIGTERM, remember);
}

void throwIfInterrupted() {
  if (arrivedSignal != 0) throw Interrupted(arrivedSignal);
}

}  // namespace farol
