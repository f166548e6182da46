#include "gpu/batch_size.h"

#include <gtest/gtest.h>

namespace farol::gpu {
namespace {

TEST(BatchSize, ComesToAQuarterOfASecond) {
  for (const double each : {1e-5, 1e-3, 0.02}) {  // seconds
    BatchSize size(16, 1, 100000);
    for (int k = 0; k < 20; ++k) size.took(size.now(), each * size.now());
    EXPECT_NEAR(each * size.now(), BatchSize::kSeconds, each) << each;
  }
}

TEST(BatchSize, StaysBetweenItsBounds) {
  BatchSize size(16, 4, 128);
  size.took(16, 100);
  EXPECT_EQ(size.now(), 4u);
  for (int k = 0; k < 20; ++k) size.took(size.now(), 0);
  EXPECT_EQ(size.now(), 128u);
}

TEST(BatchSize, GrowsTwofoldAtMost) {
  BatchSize size(16, 1, 1000);
  size.took(16, 1e-9);
  EXPECT_EQ(size.now(), 32u);
  size.took(3, 1e-9);  // a last, short batch says nothing of longer ones
  EXPECT_EQ(size.now(), 64u);
}

}  // namespace
}  // namespace farol::gpu
