#include "base/error.h"
#include "base/signals.h"
#include "cli/run.h"

#include <cstdio>
#include <fmt/format.h>
#include <new>

// Every failure ends here, as one line and an exit code (listed by --help).
int main(int argc, char** argv) {
  farol::installSignalHandlers();
  try {
    bool handled = false;
    const farol::Options options = farol::parseOptions(argc, argv, handled);
    return handled ? 0 : farol::run(options);
  } catch (const farol::UsageError& e) {
    fmt::print(stderr, "error: {}\n", e.what());
    return 2;
  } catch (const farol::Interrupted& e) {
    fmt::print(stderr, "\n{}\n", e.what());
    return 128 + e.signal;
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "error: out of memory; ask for fewer patches, or a smaller resolution\n");
  } catch (const std::exception& e) {
    fmt::print(stderr, "error: {}\n", e.what());
  }
  return 1;
}
