#include "base/sobol.h"

#include "base/math.h"

#include <bit>
#include <gtest/gtest.h>
#include <set>

using namespace farol;

// Direction numbers of Joe and Kuo, new-joe-kuo-6.21201: the second to fourth points of the first four dimensions.
TEST(Sobol, BeginsAsPublished) {
  constexpr uint32_t kQuarter = 1u << 30;
  EXPECT_EQ(sobolPoint(0), (std::array<uint32_t, 4>{0, 0, 0, 0}));
  EXPECT_EQ(sobolPoint(1), (std::array<uint32_t, 4>{2 * kQuarter, 2 * kQuarter, 2 * kQuarter, 2 * kQuarter}));
  EXPECT_EQ(sobolPoint(2), (std::array<uint32_t, 4>{kQuarter, 3 * kQuarter, 3 * kQuarter, 3 * kQuarter}));
  EXPECT_EQ(sobolPoint(3), (std::array<uint32_t, 4>{3 * kQuarter, kQuarter, kQuarter, kQuarter}));
}

// All ten, as scipy.stats.qmc.Sobol(10, scramble=False) has them, whose order is that of Gray's code, in 64ths.
TEST(Sobol, HasTenDimensions) {
  const auto expect = [](uint32_t number, const std::array<uint32_t, kSobolDimensions>& parts) {
    const auto x = sobolPoint<kSobolDimensions>(number ^ number >> 1);
    for (size_t d = 0; d < parts.size(); ++d) EXPECT_EQ(x[d], parts[d] << 26) << number << ", dimension " << d;
  };
  expect(5, {56, 56, 8, 24, 56, 40, 56, 24, 24, 8});
  expect(19, {22, 46, 46, 26, 2, 46, 18, 38, 14, 26});
  expect(37, {59, 41, 37, 59, 49, 19, 11, 51, 39, 11});
}

// In every byte of the number: a point is the sum modulo 2 of those of its bits.
TEST(Sobol, PointsAddUpBitByBit) {
  for (uint64_t k = 0; k < 1000; ++k) {
    const auto a = static_cast<uint32_t>(mixBits(2 * k)), b = static_cast<uint32_t>(mixBits(2 * k + 1));
    const auto x = sobolPoint(a), y = sobolPoint(b), z = sobolPoint(a ^ b);
    for (size_t d = 0; d < 4; ++d) EXPECT_EQ(z[d], x[d] ^ y[d]) << a << " " << b;
  }
}

// Direction numbers are a triangle with ones on its diagonal: bit b of the number decides bit 31 - b of every dimension, and
// nothing below it.
TEST(Sobol, EveryBitOfANumberHasItsPlace) {
  for (uint32_t b = 0; b < 32; ++b) {
    const auto x = sobolPoint(1u << b);
    for (size_t d = 0; d < 4; ++d) EXPECT_EQ(std::countr_zero(x[d]), 31 - static_cast<int>(b)) << "dimension " << d;
    EXPECT_EQ(x[0], 1u << (31 - b));
  }
}

TEST(Sobol, RunsFillEveryStratum) {
  constexpr uint32_t kRun = 4096;
  for (const uint32_t first : {0u, 3 * kRun, 1u << 20, 0xFFFFF000u}) {
    std::array<std::set<uint32_t>, kSobolDimensions> strata;
    for (uint32_t k = 0; k < kRun; ++k) {
      const auto x = sobolPoint<kSobolDimensions>(first + k);
      for (size_t d = 0; d < x.size(); ++d) strata[d].insert(x[d] >> 20);
    }
    for (const auto& s : strata) EXPECT_EQ(s.size(), kRun) << first;
  }
}
