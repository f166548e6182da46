// A radiosity system whose F is given, not computed.
#pragma once

#include "solve/solver.h"

#include <cmath>
#include <vector>

namespace farol::test {

struct GivenSystem {
  GivenSystem(const std::vector<std::vector<double>>& rows, const std::vector<double>& rho, const std::vector<double>& emission)
      : f(rows.size()), replaced(rows.size()) {
    scene.path = "given";
    scene.surfaces.push_back({"surface", 0, {}, {}, {}, {}, {}});
    for (uint32_t i = 0; i < rows.size(); ++i) {
      const auto row = f.row(i);
      double sum = 0;
      for (size_t j = 0; j < rows[i].size(); ++j) {
        row[j] = static_cast<float>(rows[i][j]);
        sum += rows[i][j];
      }
      f.finish(i, {1 - sum < 1e-7 ? 0 : 1 - sum, 0, 1});
      Patch p;
      p.area = 1;
      p.reflectance = Rgb(rho[i]);
      p.emission = Rgb(emission[i], 0, 2 * emission[i]);  // green stays dark, blue is twice red
      patches.patches.push_back(p);
    }
  }
  Solution solve(SolverKind kind, double residual = 1e-10, size_t maxSweeps = 100000, const gpu::Device* device = nullptr) const {
    SolveOptions o;
    o.kind = kind;
    o.residual = residual;
    o.maxSweeps = maxSweeps;
    o.device = device;
    return solveRadiosity(f, patches, {}, scene, o, Log(true));
  }
  Scene scene;
  PatchSet patches;
  FormFactorMatrix f, replaced;  // `replaced`: an empty matrix of the same size
};

// Rows of random entries between patches of random sizes, reciprocal, closed: the largest sums to 1.
inline GivenSystem randomSystem(uint32_t n, double rho) {
  std::vector<double> size(n);
  for (uint32_t i = 0; i < n; ++i) size[i] = 0.5 + unitFromBits(mixBits(i));
  GivenSystem given(std::vector<std::vector<double>>(n, std::vector<double>()), std::vector<double>(n, rho),
                    std::vector<double>(n, 0));
  double most = 0;
  std::vector<std::vector<float>> rows(n, std::vector<float>(n));
  for (uint32_t i = 0; i < n; ++i) {
    double sum = 0;
    for (uint32_t j = 0; j < n; ++j) {
      const uint64_t pair = uint64_t{std::min(i, j)} * n + std::max(i, j);
      rows[i][j] = static_cast<float>(std::pow(unitFromBits(mixBits(pair)), 4) * size[j]);
      sum += static_cast<double>(rows[i][j]);
    }
    most = std::max(most, sum);
  }
  for (uint32_t i = 0; i < n; ++i) {
    const auto to = given.f.row(i);
    for (uint32_t j = 0; j < n; ++j) to[j] = rows[i][j] / static_cast<float>(most);
    given.f.finish(i, {1 - given.f.rowSum(i), 0, 1});
    Patch& p = given.patches.patches[i];
    p.area = size[i];
    p.reflectance = Rgb(rho, 0.5 * rho, i % 7 == 0 && n > 1 ? 0 : rho);
    p.emission = Rgb(i % 50 == 0 ? 1 : 0, 0.1, 0.3);
  }
  return given;
}

}  // namespace farol::test
