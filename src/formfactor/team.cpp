#include "formfactor/team.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

namespace farol {
namespace {

struct Stopped {};  // thrown through a maker when another one has failed

// What the threads of one call share.
class Work {
 public:
  Work(std::span<const uint32_t> patches, size_t chunk, RowStore& store) : patches_(patches), chunk_(chunk), store_(store) {}

  // Takes chunks until none is left; `report` hears of progress. The first failure is kept and stops everybody.
  void run(RowMaker& maker, const std::function<void()>& report) {
    try {
      for (size_t first = 0; (first = next_.fetch_add(chunk_)) < patches_.size();) {
        size_t counted = 0;
        maker.makeRows(patches_.subspan(first, std::min(chunk_, patches_.size() - first)), store_, [&](size_t rows) {
          done_ += rows - counted;
          counted = rows;
          if (stop_) throw Stopped();
          report();
        });
      }
    } catch (const Stopped&) {
    } catch (...) {
      fail(std::current_exception());
    }
  }

  void fail(const std::exception_ptr& failure) {
    const std::lock_guard lock(mutex_);
    if (!failure_) failure_ = failure;
    stop_ = true;
  }

  void rethrow() const {
    if (failure_) std::rethrow_exception(failure_);
  }

  size_t done() const { return done_; }

 private:
  std::span<const uint32_t> patches_;
  size_t chunk_;
  RowStore& store_;
  std::atomic<size_t> next_{0}, done_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::exception_ptr failure_;
};

}  // namespace

TeamRowMaker::TeamRowMaker(std::vector<std::unique_ptr<RowMaker>> makers, size_t chunk)
    : makers_(std::move(makers)), chunk_(std::max<size_t>(1, chunk)) {}

void TeamRowMaker::makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) {
  Work work(patches, chunk_, store);
  std::mutex mutex;
  std::condition_variable finished;
  size_t running = makers_.size() - 1;
  std::vector<std::thread> threads;
  for (size_t k = 1; k < makers_.size(); ++k) {
    threads.emplace_back([&, k] {
      work.run(*makers_[k], [] {});
      const std::lock_guard lock(mutex);
      --running;
      finished.notify_one();
    });
  }
  work.run(*makers_[0], [&] { done(work.done()); });
  try {
    std::unique_lock lock(mutex);
    while (!finished.wait_for(lock, std::chrono::milliseconds(100), [&] { return running == 0; })) done(work.done());
  } catch (...) {  // `done` throws when a signal has arrived
    work.fail(std::current_exception());
  }
  for (std::thread& thread : threads) thread.join();
  work.rethrow();
  done(patches.size());
}

}  // namespace farol
