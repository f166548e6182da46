#include "formfactor/projection.h"

#include "formfactor/analytic.h"

#include <gtest/gtest.h>
#include <numeric>

namespace farol {
namespace {

TEST(DeltaFormFactors, SumToOne) {
  for (const Projection p : {Projection::hemicube, Projection::tetrahedron}) {
    for (const uint32_t r : {8u, 10u, 64u, 256u}) {
      const auto factors = deltaFormFactors(p, r);
      EXPECT_NEAR(std::accumulate(factors.begin(), factors.end(), 0.0), 1.0, 1e-12) << r;
    }
  }
}

TEST(DeltaFormFactors, QuantisedSumToExactlyTwoToThe32MinusOne) {
  for (const Projection p : {Projection::hemicube, Projection::tetrahedron}) {
    for (const uint32_t r : {8u, 34u, 64u, 256u, 1024u}) {
      const auto factors = quantisedFormFactors(p, r);
      EXPECT_EQ(std::accumulate(factors.begin(), factors.end(), uint64_t{0}), 0xFFFFFFFFull) << r;
    }
  }
}

// Every pixel of the hemicube against the contour sum of its own rectangle.
TEST(DeltaFormFactors, AreThePixelsOwnFactors) {
  constexpr uint32_t kR = 16;
  const ProjectionLayout layout = layoutOf(Projection::hemicube, kR);
  const auto factors = deltaFormFactors(Projection::hemicube, kR);
  for (const ProjectionFace& face : layout.faces) {
    for (uint32_t j = 0; j < face.height; ++j) {
      for (uint32_t i = 0; i < face.width; ++i) {
        const auto point = [&](uint32_t x, uint32_t y) {
          return (face.low + (1 - face.low) * x / face.width) * face.right +
                 (face.bottom + (1 - face.bottom) * y / face.height) * face.up + face.forward;
        };
        // right x up = forward: seen from the origin these run clockwise around the direction of sight, as
        // pointToPolygon wants.
        const std::vector<Vec3> pixel = {point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)};
        EXPECT_NEAR(factors[(face.y + j) * layout.width + face.x + i], pointToPolygon(Vec3(0), Vec3(0, 0, 1), pixel), 1e-14);
      }
    }
  }
}

// Largest pixel: 4 / (pi N^2) at the top's centre (2e-3 relative at N = 64: the factor falls off within the pixel).
TEST(DeltaFormFactors, HaveTheKnownLargestValue) {
  const auto factors = deltaFormFactors(Projection::hemicube, 64);
  EXPECT_NEAR(*std::max_element(factors.begin(), factors.end()), 4 / (kPi * 64 * 64), 2e-3 * 3.1e-4);
}

TEST(ProjectionFaces, AreRightHandedAndFillTheAtlas) {
  for (const Projection p : {Projection::hemicube, Projection::tetrahedron}) {
    const ProjectionLayout layout = layoutOf(p, 32);
    uint32_t pixels = 0;
    for (const ProjectionFace& f : layout.faces) {
      EXPECT_NEAR(glm::distance(glm::cross(f.right, f.up), f.forward), 0, 1e-15);
      EXPECT_LE(f.x + f.width, layout.width);
      EXPECT_LE(f.y + f.height, layout.height);
      pixels += f.width * f.height;
    }
    EXPECT_EQ(pixels, layout.width * layout.height);
  }
}

}  // namespace
}  // namespace farol
