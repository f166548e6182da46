// Relighting on kept form factors against a first solve with the same rows, whole processes, beside the time that reading
// F once per sweep takes: farol_relighting [patches...]. Writes into the current folder.
#include "whole_process.h"

#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

namespace {

using farol::benchmark::medianSeconds;

// Bytes per second of a plain read loop over so many bytes on all cores; the best of some passes.
double readBandwidth(size_t bytes) {
  const std::vector<uint64_t> words(bytes / sizeof(uint64_t), 1);
  double best = 0;
  for (int pass = 0; pass < 7; ++pass) {
    const farol::Stopwatch watch;
    const uint64_t sum = tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, words.size(), size_t{1} << 16), uint64_t{0},
        [&](const tbb::blocked_range<size_t>& range, uint64_t part) {
          for (size_t k = range.begin(); k < range.end(); ++k) part += words[k];
          return part;
        },
        std::plus<>());
    if (sum != words.size()) std::exit(1);
    best = std::max(best, static_cast<double>(bytes) / watch.seconds());
  }
  return best;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string scene = FAROL_SCENES "/cornell_box/cornell_box.gltf";
  std::vector<std::string> counts(argv + 1, argv + argc);
  if (counts.empty()) counts = {"4000", "16000"};
  fmt::print("{}; {}\n", farol::processorName(), scene);
  fmt::print("{:>8} {:>9} {:>9} {:>6} {:>9} {:>7} {:>8} {:>10}\n", "patches", "first s", "again s", "ratio", "F MB", "sweeps",
             "GB/s", "allowed s");
  for (const std::string& count : counts) {
    const std::string settings = fmt::format("{} --patches {} --method rays --rays 4096 --quiet", scene, count);
    const double first = medianSeconds(fmt::format("{} solve {} --patches-csv first.csv", FAROL_PROGRAM, settings), 3);
    medianSeconds(fmt::format("{} factors {} -o relight.npz", FAROL_PROGRAM, settings), 1);
    const double again = medianSeconds(
        fmt::format("{} solve {} --factors relight.npz --patches-csv again.csv --report again.json --quiet", FAROL_PROGRAM, scene),
        5);
    std::ifstream stream("again.json");
    const auto report = nlohmann::json::parse(stream);
    const auto bytes = report.at("matrix_bytes").get<double>(), sweeps = report.at("solve").at("sweeps").get<double>();
    const double bandwidth = readBandwidth(static_cast<size_t>(bytes));
    fmt::print("{:>8} {:>9.3f} {:>9.3f} {:>6.2f} {:>9.1f} {:>7.0f} {:>8.1f} {:>10.3f}\n", count, first, again, first / again,
               1e-6 * bytes, sweeps, 1e-9 * bandwidth, 0.1 + 2 * bytes * sweeps / bandwidth);
    std::fflush(stdout);
    std::remove("relight.npz");
  }
}
