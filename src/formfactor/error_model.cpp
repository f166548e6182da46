#include "formfactor/error_model.h"

#include <algorithm>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

double sumOfRoots(const FormFactorRow& row, double samples) {
  double sum = 0;
  for (const float f : row.dense) sum += std::sqrt(static_cast<double>(f) / samples);
  static thread_local std::vector<uint32_t> counts;
  counts.resize(std::max(counts.size(), row.patches + 1), 0);
  for (const uint32_t j : row.ids) ++counts[j];
  for (const uint32_t j : row.ids) {
    if (counts[j] > 0 && j < row.patches) sum += std::sqrt(counts[j] * static_cast<double>(row.weight) / samples);
    counts[j] = 0;
  }
  return sum;
}

}  // namespace

double ErrorModel::entryError(double f) const {
  if (!(samples > 0)) return 0;
  const double known = std::clamp(f, 1 / samples, 0.5);
  return entry * std::sqrt(known * (1 - known) / samples);
}

double ErrorModel::rowError(const FormFactorRow& r) const {
  return samples > 0 ? row * sumOfRoots(r, samples) : 0;
}

std::vector<double> ProbeRows::error(const FormFactorMatrix& f, size_t which, uint32_t patch) const {
  const std::vector<float> here = made(f, which)[patch].expanded(), there = reference[0][patch].expanded();
  std::vector<double> d(here.size());
  for (size_t j = 0; j < d.size(); ++j) d[j] = static_cast<double>(here[j]) - static_cast<double>(there[j]);
  return d;
}

std::vector<uint32_t> chooseProbes(const PatchSet& patches, size_t count) {
  const size_t n = patches.size();
  count = std::min(count, n);
  std::vector<uint32_t> chosen;
  for (size_t k = 0; k < count; ++k) chosen.push_back(static_cast<uint32_t>((2 * k + 1) * n / (2 * count)));
  return chosen;
}

ErrorModel fitErrorModel(const FormFactorMatrix& f, const ProbeRows& probes, double samples) {
  ErrorModel model;
  model.samples = samples;
  struct Part {
    double squares = 0, law = 0, row = 0;
  };
  const size_t n = probes.patches.size(), all = n * probes.times();
  std::vector<Part> parts(all);
  tbb::parallel_for(size_t{0}, all, [&](size_t k) {
    const uint32_t p = probes.patches[k % n];
    if (f.shares(p).exposed <= 0) return;
    const std::vector<double> d = probes.error(f, k / n, p);
    const std::vector<float> truth = probes.reference[0][p].expanded();
    double absolute = 0;
    for (size_t j = 0; j < d.size(); ++j) {
      const auto exact = static_cast<double>(truth[j]);
      parts[k].squares += d[j] * d[j];
      parts[k].law += exact * (1 - std::min(exact, 1.0)) / samples;
      absolute += std::abs(d[j]);
    }
    const double roots = sumOfRoots(probes.made(f, k / n)[p], samples);
    parts[k].row = roots > 0 ? absolute / roots : 0;
  });
  double squares = 0, law = 0;
  std::vector<double> rows;
  for (const Part& part : parts) {
    squares += part.squares;
    law += part.law;
    rows.push_back(part.row);
  }
  model.entry = law > 0 ? std::sqrt(squares / law) : 0;
  if (!rows.empty()) {  // three standard deviations above the mean, without the largest of 24
    std::sort(rows.begin(), rows.end());
    rows.resize(rows.size() - rows.size() / 24);
    double sum = 0, spread = 0;
    const auto count = static_cast<double>(rows.size());
    for (const double r : rows) sum += r / count;
    for (const double r : rows) spread += (r - sum) * (r - sum) / count;
    model.row = sum + 3 * std::sqrt(spread);
  }
  model.probes = n;
  return model;
}

}  // namespace farol
