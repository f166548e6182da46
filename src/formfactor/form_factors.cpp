#include "formfactor/form_factors.h"

#include "base/error.h"

#include <algorithm>
#include <atomic>
#include <numeric>
#include <tbb/parallel_for.h>

namespace farol {

std::span<float> FormFactorMatrix::row(uint32_t patch) {
  const uint64_t rowBytes = rows_.size() * sizeof(float);
  if (rows_[patch].empty() && (std::atomic_ref(bytes_) += rowBytes) > maxBytes_) {
    throw Error(
        "form factors of {} patches do not fit: more than {} rows of {} bytes would exceed the {} bytes allowed; "
        "ask for fewer patches, or allow more with --memory",
        rows_.size(), maxBytes_ / rowBytes, rowBytes, maxBytes_);
  }
  rows_[patch].resize(rows_.size());
  return rows_[patch];
}

double FormFactorMatrix::rowSum(size_t patch) const {
  return std::accumulate(rows_[patch].begin(), rows_[patch].end(), 0.0);
}

void FormFactorMatrix::keep(const std::vector<uint32_t>& patches) {
  std::vector<std::vector<float>> rows;
  std::vector<RowShares> shares;
  rows.reserve(patches.size());
  for (const uint32_t p : patches) {
    std::vector<float> row;
    if (!rows_[p].empty()) {
      row.reserve(patches.size());
      for (const uint32_t q : patches) row.push_back(rows_[p][q]);
    }
    rows_[p] = {};
    rows.push_back(std::move(row));
    shares.push_back(shares_[p]);
  }
  rows_ = std::move(rows);
  shares_ = std::move(shares);
}

void makeFormFactors(RowMaker& maker, PatchSet& patches, bool sky, const Log& log, FormFactorMatrix& f) {
  std::vector<bool> active(patches.size(), false);
  std::vector<uint32_t> all, next;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    if (!patches.patches[i].back || patches.patches[i].emits() || sky) next.push_back(i);
  }
  Progress progress(log, "form factors", "rows", next.size());
  while (!next.empty()) {
    for (const uint32_t i : next) active[i] = true;
    const size_t before = all.size();
    maker.makeRows(next, f, [&](size_t rows) { progress.update(before + rows); });
    all.insert(all.end(), next.begin(), next.end());
    if (all.size() == patches.size()) break;
    // Whatever the new rows see and nobody has asked for yet comes next.
    std::vector<uint32_t> found;
    for (const uint32_t i : next) {
      const auto row = f[i];
      for (uint32_t j = 0; j < row.size(); ++j) {
        if (row[j] > 0 && !active[j]) {
          active[j] = true;
          found.push_back(j);
        }
      }
    }
    std::sort(found.begin(), found.end());
    progress.growTotal(found.size());
    next = std::move(found);
  }
  if (all.size() < patches.size()) {
    std::sort(all.begin(), all.end());
    f.keep(all);
    keepPatches(patches, all);
  }
}

FormFactorChecks checkFormFactors(const FormFactorMatrix& f, const PatchSet& patches) {
  FormFactorChecks c;
  const size_t n = f.size();
  std::vector<double> sums(n), difference(n), size(n);
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    sums[i] = f.rowSum(i);
    if (f[i].empty()) return;
    for (size_t j = 0; j < n; ++j) {
      if (f[j].empty()) continue;
      const double ij = patches.patches[i].area * static_cast<double>(f[i][j]);
      const double ji = patches.patches[j].area * static_cast<double>(f[j][i]);
      difference[i] += (ij - ji) * (ij - ji);
      size[i] += ij * ij;
    }
  });
  c.rowSumMin = 1e300;
  c.rowSumMax = -1e300;
  double area = 0, exposedArea = 0;
  for (size_t i = 0; i < n; ++i) {
    const RowShares& s = f.shares(i);
    const double a = patches.patches[i].area * s.exposed;
    area += patches.patches[i].area;
    exposedArea += a;
    c.missed += a * s.missed;
    c.backs += a * s.backs;
    c.rowSumMean += a * sums[i];
    if (s.exposed > 0) {
      c.rowSumMin = std::min(c.rowSumMin, sums[i]);
      c.rowSumMax = std::max(c.rowSumMax, sums[i]);
    }
  }
  if (exposedArea > 0) {
    c.missed /= exposedArea;
    c.backs /= exposedArea;
    c.rowSumMean /= exposedArea;
  } else {
    c.rowSumMin = c.rowSumMax = 0;
  }
  c.covered = area > 0 ? 1 - exposedArea / area : 0;
  const double total = std::accumulate(size.begin(), size.end(), 0.0);
  if (total > 0) c.reciprocityRms = std::sqrt(std::accumulate(difference.begin(), difference.end(), 0.0) / total);
  return c;
}

}  // namespace farol
