#include "formfactor/error_model.h"

#include "formfactor/neighbourhood.h"

#include <algorithm>
#include <tbb/parallel_for.h>

namespace farol {
double ErrorModel::entryError(double f) const {
  if (!(samples > 0)) return 0;
  const double known = std::clamp(f, 1 / samples, 0.5);
  return entry * std::sqrt(known * (1 - known) / samples);
}

std::vector<double> ProbeRows::error(const FormFactorMatrix& f, size_t which, uint32_t patch) const {
  const std::vector<float> here = made(f, which)[patch].expanded(), there = reference[0][patch].expanded();
  std::vector<double> d(here.size());
  for (size_t j = 0; j < d.size(); ++j) d[j] = static_cast<double>(here[j]) - static_cast<double>(there[j]);
  return d;
}

std::vector<uint32_t> chooseProbes(const PatchSet& patches, size_t count) {
  std::vector<uint32_t> gathering;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    if (!patches.patches[i].passesAll()) gathering.push_back(i);
  }
  const size_t n = gathering.size();
  count = std::min(count, n);
  std::vector<uint32_t> chosen;
  for (size_t k = 0; k < count; ++k) chosen.push_back(gathering[(2 * k + 1) * n / (2 * count)]);
  return chosen;
}

ErrorModel fitErrorModel(const FormFactorMatrix& f, const PatchSet& patches, const ProbeRows& probes, double samples) {
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
    parts[k].row = absolute;
  });
  double squares = 0, law = 0;
  for (const Part& part : parts) {
    squares += part.squares;
    law += part.law;
  }
  model.entry = law > 0 ? std::sqrt(squares / law) : 0;
  model.probes = n;
  model.row.resize(patches.size());
  constexpr size_t kWindow = 24;
  Neighbourhood(patches).forEachWindow(probes.patches, kWindow, [&](uint32_t i, std::span<const uint32_t> window) {
    // Two and a half standard deviations above the mean.
    double sum = 0, square = 0;
    const auto count = static_cast<double>(window.size() * probes.times());
    for (const uint32_t p : window) {
      for (size_t k = p; k < all; k += n) {
        sum += parts[k].row;
        square += parts[k].row * parts[k].row;
      }
    }
    if (count > 0) {
      const double mean = sum / count;
      model.row[i] = static_cast<float>(mean + 2.5 * std::sqrt(std::max(0.0, square / count - mean * mean)));
    }
  });
  return model;
}

}  // namespace farol
