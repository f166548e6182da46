#include "view/tone.h"

#include <cmath>
#include <gtest/gtest.h>

namespace farol {
namespace {

TEST(Tone, IsSrgbBelowTheShoulderAndNeverWraps) {
  Image image{4, 1, {0, 0, 0, 0.5f, 0.5f, 0.5f, 1000, 1000, 1000, 0.0031f, 0.0031f, 0.0031f}};
  const auto out = toSrgb(image, 1);
  EXPECT_EQ(out[0], 0);
  EXPECT_EQ(out[3], 188);  // sRGB code of 0.5
  EXPECT_EQ(out[6], 255);
  EXPECT_EQ(out[9], 10);
}

TEST(Tone, BringsTheMeanToMiddleGrey) {
  const Image image{2, 1, {10, 10, 10, 1000, 1000, 1000}};
  EXPECT_NEAR(automaticScale(image) * std::sqrt(10.0 * 1000.0), 0.18, 1e-6);
  EXPECT_EQ(automaticScale(Image{1, 1, {0, 0, 0}}), 1.0);
}

}  // namespace
}  // namespace farol
