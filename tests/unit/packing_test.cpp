// Rows in 16 bits: their sums, their errors, and what they do to a solution.
#include "formfactor/packing.h"

#include "given_system.h"

#include <array>
#include <gtest/gtest.h>
#include <numeric>

namespace farol::test {
namespace {

// A row as rooms have it: many small entries, a few large ones, some zeros.
std::vector<float> roomRow(size_t n) {
  std::vector<float> row(n);
  for (size_t j = 0; j < n; ++j)
    row[j] = j % 3 == 0 ? 0.0f : static_cast<float>(std::pow(unitFromBits(mixBits(j)), 6) / static_cast<double>(n));
  row[n / 2] = 0.3f;
  return row;
}

TEST(PackedRow, KeepsItsSumAndItsLargestEntries) {
  for (const size_t n : {size_t{2}, size_t{63}, size_t{64}, size_t{4000}}) {
    const std::vector<float> row = roomRow(n);
    const PackedRow packed = packRow(row);
    const auto step = static_cast<double>(packed.step);
    double sum = std::accumulate(packed.values.begin(), packed.values.end(), 0.0), error = 0;
    EXPECT_LE(packed.ids.size(), n / 64);
    for (size_t j = 0; j < n; ++j) {
      const auto listed = std::find(packed.ids.begin(), packed.ids.end(), j);
      if (listed != packed.ids.end()) {
        EXPECT_EQ(packed.values[static_cast<size_t>(listed - packed.ids.begin())], row[j]);
        EXPECT_EQ(packed.steps[j], 0);
        continue;
      }
      const double value = packed.steps[j] * step;
      if (row[j] == 0) {
        EXPECT_EQ(value, 0);
      }
      EXPECT_LE(std::abs(value - static_cast<double>(row[j])), step * 1.0001);
      sum += value;
      error += std::abs(value - static_cast<double>(row[j]));
    }
    EXPECT_NEAR(sum, std::accumulate(row.begin(), row.end(), 0.0), 0.51 * step);
    EXPECT_NEAR(packed.error, error, 1e-12);
  }
  EXPECT_EQ(packRow(std::vector<float>(100, 0.0f)).error, 0);
}

// Half the bytes; entries, sums and solution as close as the error that is told.
TEST(Storage, In16BitsMovesTheSolutionByLessThanItTells) {
  constexpr uint32_t n = 500;
  GivenSystem given = randomSystem(n, 0.9);
  FormFactorMatrix packed(n, UINT64_MAX, Storage::bits16);
  for (uint32_t i = 0; i < n; ++i) {
    const std::vector<float> row = given.f[i].expanded();
    std::copy(row.begin(), row.end(), packed.row(i).begin());
    packed.finish(i, given.f.shares(i));
    double difference = 0;
    for (uint32_t j = 0; j < n; ++j) difference += std::abs(packed[i].at(j) - static_cast<double>(row[j]));
    EXPECT_LE(difference, packed.packingError() * 1.0001);
    EXPECT_NEAR(packed.rowSum(i), given.f.rowSum(i), 1e-7);
    EXPECT_EQ(packed[i].expanded()[n - 1], static_cast<float>(packed[i].at(n - 1)));
  }
  EXPECT_EQ(packed.packedRows(), n);
  EXPECT_LT(packed.bytes(), given.f.bytes() * 6 / 10);
  EXPECT_GT(packed.packingError(), 0);
  EXPECT_LT(packed.packingError(), 1e-3);
  for (const SolverKind kind : {SolverKind::gaussSeidel, SolverKind::jacobi}) {
    const Solution exact = given.solve(kind);
    GivenSystem small = given;
    small.f = packed;
    const Solution s = small.solve(kind);
    double most = 0, largest = 0;
    for (size_t i = 0; i < n; ++i) {
      most = std::max(most, std::abs(s.radiosity[i].r - exact.radiosity[i].r));
      largest = std::max(largest, exact.radiosity[i].r);
    }
    EXPECT_LT(most, packed.packingError() * largest / (1 - 0.9));
  }
}

// Rows filled by less than half become lists, where dense ones take 16 bits by less than a third.
TEST(Storage, TakesTheShorterOfListsAndDenseRows) {
  constexpr uint32_t n = 300;
  for (const Storage storage : {Storage::float32, Storage::bits16}) {
    FormFactorMatrix f(n, UINT64_MAX, storage);
    const std::array<uint32_t, 4> filled{90, 120, 149, 160};
    for (uint32_t i = 0; i < filled.size(); ++i) {
      for (uint32_t j = 0; j < filled[i]; ++j) f.row(i)[j] = 0.005f;
      f.finish(i, {});
    }
    EXPECT_EQ(f.denseRows(), storage == Storage::float32 ? 1u : 0u);
    EXPECT_EQ(f.packedRows(), storage == Storage::float32 ? 0u : 3u);
  }
}

// Rows filled by a tenth become lists, whatever the storage.
TEST(Storage, KeepsSparseRowsAsLists) {
  constexpr uint32_t n = 300;
  for (const Storage storage : {Storage::float32, Storage::bits16}) {
    FormFactorMatrix f(n, UINT64_MAX, storage);
    for (uint32_t i = 0; i < n; ++i) {
      for (uint32_t j = i; j < n; j += 10) f.row(i)[j] = 0.01f;
      f.finish(i, {});
    }
    EXPECT_EQ(f.denseRows() + f.packedRows(), 0u);
    EXPECT_EQ(f[5].at(15), static_cast<double>(0.01f));
    EXPECT_EQ(f[5].at(16), 0);
    EXPECT_LE(f.bytes(), n * n / 10 * 8u);
  }
}

}  // namespace
}  // namespace farol::test
