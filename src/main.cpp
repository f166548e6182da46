#include "base/error.h"
#include "base/signals.h"
#include "cli/run.h"

#include <cstdio>
#include <cstdlib>
#include <fmt/format.h>
#include <new>

// jemalloc reads it. Memory lies in large pages where the system has them: every page that is touched first is a fault, a tenth to
// a third of a run's time in virtual machines. What is freed stays for what comes next, of any size, of any thread: software
// drivers take and give back memory for every batch that they draw.
extern "C" const char* malloc_conf;
const char* malloc_conf =
    "thp:always,metadata_thp:always,narenas:1,lg_extent_max_active_fit:24,dirty_decay_ms:-1,oversize_threshold:0";

namespace {

// The heap grows in pieces from 2 MiB on, which begin where large pages seldom do. This one does, and is touched where it is used.
void beginHeap() {
  void* volatile piece = std::malloc(size_t{64} << 20);
  std::free(piece);
}

}  // namespace

// Every failure ends here, as one line and an exit code (listed by --help).
int main(int argc, char** argv) {
  beginHeap();
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
