#include "base/error.h"
#include "base/signals.h"
#include "cli/run.h"

#include <cstdio>
#include <fmt/format.h>
#include <new>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace {

// Software drivers take and give back memory for every batch that they draw. Left to itself the C library returns it to the
// system each time, and every page is a fault again: a fifth of a run's time.
void keepFreedMemory() {
#ifdef __GLIBC__
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
#endif
}

}  // namespace

// Every failure ends here, as one line and an exit code (listed by --help).
int main(int argc, char** argv) {
  keepFreedMemory();
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
