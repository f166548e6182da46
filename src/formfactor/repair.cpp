#include "formfactor/repair.h"

#include "base/error.h"

#include <tbb/parallel_for.h>

namespace farol {
namespace {

// Rows of the symmetric matrix S: ids ascending.
struct Symmetric {
  std::vector<std::vector<uint32_t>> ids;
  std::vector<std::vector<double>> values;
};

Symmetric symmetrised(const FormFactorMatrix& f, const std::vector<double>& area, double& asymmetry) {
  const size_t n = f.size();
  // Half of every entry goes to its own row and half to its mirror image; rows first gather what others send them.
  std::vector<std::vector<std::pair<uint32_t, double>>> parts(n);
  double total = 0;
  for (uint32_t i = 0; i < n; ++i) {
    if (!f[i].made()) continue;
    f[i].forEach([&](size_t j, double value) {
      const bool other = f[j].made();  // a patch without a row gathers nothing: it has no mirror image to agree with
      const double power = area[i] * value;
      total += power;
      parts[i].emplace_back(static_cast<uint32_t>(j), (other ? 0.5 : 1) * power);
      if (other) parts[j].emplace_back(i, 0.5 * power);
    });
  }
  Symmetric s{std::vector<std::vector<uint32_t>>(n), std::vector<std::vector<double>>(n)};
  std::vector<double> apart(n, 0.0);
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    std::stable_sort(parts[i].begin(), parts[i].end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [j, value] : parts[i]) {
      if (s.ids[i].empty() || s.ids[i].back() != j) {
        s.ids[i].push_back(j);
        s.values[i].push_back(0);
      }
      s.values[i].back() += value;
    }
    parts[i] = {};
    // |A_i F_ij - A_j F_ji| is twice what the mean differs from the entry by.
    std::vector<float> own = f[i].expanded();
    for (size_t k = 0; k < s.ids[i].size(); ++k)
      apart[i] += 2 * std::abs(s.values[i][k] - area[i] * static_cast<double>(own[s.ids[i][k]]));
  });
  asymmetry = 0;
  for (const double a : apart) asymmetry += total > 0 ? a / total : 0;
  return s;
}

}  // namespace

Repair repairRows(FormFactorMatrix& f, const PatchSet& patches) {
  if (patches.anySpecular()) throw Error("rows with mirrors or glass do not add up to 1: --repair is for scenes without");
  const size_t n = f.size();
  std::vector<double> area(n), wanted(n), x(n, 1.0);
  for (size_t i = 0; i < n; ++i) {
    area[i] = patches.patches[i].area * f.shares(i).exposed;
    wanted[i] = area[i] * f.rowSum(i);
  }
  Repair repair;
  const Symmetric s = symmetrised(f, area, repair.asymmetry);
  constexpr size_t kMostSweeps = 1000;
  constexpr double kClosed = 1e-9;
  std::vector<double> sum(n);
  for (; repair.sweeps < kMostSweeps; ++repair.sweeps) {
    tbb::parallel_for(size_t{0}, n, [&](size_t i) {
      sum[i] = 0;
      for (size_t k = 0; k < s.ids[i].size(); ++k) sum[i] += s.values[i][k] * x[s.ids[i][k]];
    });
    repair.closure = 0;
    for (size_t i = 0; i < n; ++i) {
      if (wanted[i] > 0 && sum[i] > 0) repair.closure = std::max(repair.closure, std::abs(x[i] * sum[i] / wanted[i] - 1));
    }
    if (repair.closure < kClosed) break;
    for (size_t i = 0; i < n; ++i) {
      if (wanted[i] > 0 && sum[i] > 0) x[i] = std::sqrt(x[i] * wanted[i] / sum[i]);
    }
  }
  double whole = 0;
  std::vector<double> change(n, 0.0);
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    if (!f[i].made() || area[i] <= 0) return;
    const std::vector<float> before = f[i].expanded();
    std::vector<float> values(s.ids[i].size());
    for (size_t k = 0; k < values.size(); ++k) {
      values[k] = static_cast<float>(x[i] * s.values[i][k] * x[s.ids[i][k]] / area[i]);
      change[i] += std::abs(static_cast<double>(values[k] - before[s.ids[i][k]]));
    }
    f.replace(static_cast<uint32_t>(i), s.ids[i], values);
  });
  for (size_t i = 0; i < n; ++i) {
    repair.meanChange += area[i] * change[i];
    repair.largestChange = std::max(repair.largestChange, change[i]);
    whole += area[i];
  }
  if (whole > 0) repair.meanChange /= whole;
  return repair;
}

}  // namespace farol
