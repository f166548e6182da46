// Rows of F as they are kept: their sums, copies that share lists, and a file of many chunks.
#include "output/factor_archive.h"
#include "test_scene.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

// A list of `count` entries, other ones in every row.
void makeRow(FormFactorMatrix& f, uint32_t i, uint32_t count) {
  const auto n = static_cast<uint32_t>(f.size());
  std::vector<uint32_t> ids;
  std::vector<float> values;
  for (uint32_t k = 0; k < count; ++k) {
    ids.push_back(k * (n / count) + i % (n / count));
    values.push_back(static_cast<float>(unitFromBits(mixBits(i * n + k)) / count));
  }
  f.entries(i, ids, values);
  f.finish(i, {});
}

double added(const FormFactorRow& row) {
  double sum = 0;
  row.forEach([&](size_t, double value) { sum += value; });
  return sum;
}

TEST(FormFactorMatrix, KnowsTheSumsOfRowsThatChange) {
  FormFactorMatrix f(30);
  for (uint32_t i = 0; i < 30; ++i) makeRow(f, i, i % 2 == 0 ? 5 : 15);  // lists and dense rows
  const FormFactorMatrix before = f;
  f.replace(4, std::vector<uint32_t>{1, 2}, std::vector<float>{0.25f, 0.5f});
  EXPECT_EQ(f.rowSum(4), 0.75);
  EXPECT_NEAR(before.rowSum(4), added(before[4]), 1e-7);
  EXPECT_NE(before.rowSum(4), 0.75);
  std::vector<uint32_t> kept;
  for (uint32_t i = 0; i < 30; ++i) {
    if (i % 3 != 1) kept.push_back(i);
  }
  f.keep(kept);
  ASSERT_EQ(f.size(), 20u);
  for (uint32_t i = 0; i < 20; ++i) EXPECT_NEAR(f.rowSum(i), added(f[i]), 1e-7);
}

// Every ray of a row may meet the same patch: 384 times 1/384 is 1, and no more than is possible.
TEST(FormFactorMatrix, AddsUpHitsOfOnePatch) {
  constexpr uint32_t kRays = 384, n = 4 * kRays;
  FormFactorMatrix f(n);
  PatchSet patches;
  patches.patches.resize(n);
  for (uint32_t i = 0; i < n; ++i) {
    patches.patches[i].area = 1;
    f.hits(i, std::vector<uint32_t>(kRays, (i + 3) % n / 3 * 3), 1.0f / kRays);  // those looked at are every third one
    f.finish(i, {});
  }
  EXPECT_NEAR(checkFormFactors(f, patches).largest, 1, 1e-7);
}

// Rows are read in chunks of half a million entries, and lists stay where they were read.
TEST(FactorArchive, ReadsBackRowsOfManyChunks) {
  constexpr uint32_t n = 2500, kEntries = 625;
  FormFactorMatrix f(n);
  PatchSet patches;
  patches.patches.resize(n);
  for (uint32_t i = 0; i < n; ++i) makeRow(f, i, i % 10 == 0 ? n / 2 : kEntries);  // every tenth row is dense
  const TemporaryFolder folder;
  writeFactorsNpz(folder.path("F.npz"), f, patches, {"rays:16", 1, {}, {}}, {}, nullptr);
  const FormFactorMatrix read = FactorArchive(folder.path("F.npz")).load(n, UINT64_MAX);
  EXPECT_EQ(read.bytes(), f.bytes());
  for (uint32_t i = 0; i < n; ++i) {
    EXPECT_EQ(read[i].expanded(), f[i].expanded()) << i;
    EXPECT_EQ(read.rowSum(i), f.rowSum(i));
  }
}

}  // namespace
}  // namespace farol::test
