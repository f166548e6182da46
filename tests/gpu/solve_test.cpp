// The solve on a device against the solve on the CPU.
#include "base/error.h"
#include "given_system.h"
#include "raster_run.h"
#include "solve/gpu_jacobi.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

double largestDifference(const Solution& a, const Solution& b) {
  double most = 0;
  for (size_t i = 0; i < a.radiosity.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      if (a.radiosity[i][c] > 0) most = std::max(most, std::abs(a.radiosity[i][c] - b.radiosity[i][c]) / a.radiosity[i][c]);
    }
  }
  return most;
}

// Around a workgroup's rows, and past one block of rows: 6,500 patches have 85 MB in half precision, a block 64.
TEST(SolveOnDevice, AgreesWithTheCpuAtEverySize) {
  for (const uint32_t n : {1u, 2u, 15u, 16u, 17u, 63u, 64u, 65u, 1000u, 4000u, 6500u}) {
    const GivenSystem given = randomSystem(n, 0.9);
    const Solution here = given.solve(SolverKind::gaussSeidel, 1e-6),
                   there = given.solve(SolverKind::jacobi, 1e-6, 100000, &device());
    EXPECT_TRUE(there.converged) << n;
    EXPECT_LT(largestDifference(here, there), 1e-5) << n;
    for (size_t i = 0; i < n; i += 1 + n / 10)
      EXPECT_NEAR(there.irradiance[i].r, here.irradiance[i].r, 1e-5 * here.irradiance[i].r);
  }
}

// The difference grows no faster than 1 / (1 - rho), and black patches, lists and 16-bit rows are served too.
TEST(SolveOnDevice, AgreesWithTheCpuWhereLittleIsAbsorbed) {
  for (const double rho : {0.99, 0.999}) {
    const GivenSystem given = randomSystem(300, rho);
    const Solution here = given.solve(SolverKind::gaussSeidel, 1e-6),
                   there = given.solve(SolverKind::jacobi, 1e-6, 100000, &device());
    EXPECT_LT(largestDifference(here, there), 1e-6 / (1 - rho)) << rho;
  }
  GivenSystem given = randomSystem(300, 0.8);
  FormFactorMatrix packed(300, UINT64_MAX, Storage::bits16);
  for (uint32_t i = 0; i < 300; ++i) {
    const std::vector<float> row = given.f[i].expanded();
    for (uint32_t j = 0; j < 300; ++j) packed.row(i)[j] = i % 3 == 0 && j % 5 != 0 ? 0 : row[j];
    packed.finish(i, given.f.shares(i));
    if (i % 11 == 0) given.patches.patches[i].reflectance = Rgb(0);
  }
  EXPECT_EQ(packed.packedRows(), 200u);
  given.f = packed;
  EXPECT_LT(largestDifference(given.solve(SolverKind::gaussSeidel, 1e-12), given.solve(SolverKind::jacobi, 1e-12, 1000, &device())),
            1e-9);
}

TEST(SolveOnDevice, RefusesADivergingSystem) {
  GivenSystem grows({{0, 1.2}, {1.2, 0}}, {0.97, 0.97}, {1, 0});
  EXPECT_THROW(grows.solve(SolverKind::jacobi, 1e-5, 100000, &device()), Error);
}

TEST(SolveOnDevice, IsMeasuredBesideTheCpu) {
  const GivenSystem given = randomSystem(500, 0.5);
  const SweepSeconds seconds = measureSweeps(given.f, given.patches, device());
  EXPECT_GT(seconds.host, 0);
  EXPECT_GT(seconds.device, 0);
  EXPECT_GT(seconds.upload, 0);
}

}  // namespace
}  // namespace farol::test
