#include "formfactor/near_patches.h"

#include <gtest/gtest.h>

namespace farol {
namespace {

// What the tree finds is what looking at all patches finds, whatever their sizes.
TEST(NearPatches, AreThoseWithTheLargestPredictedErrors) {
  const auto random = [](uint64_t k) { return unitFromBits(mixBits(k)); };
  std::vector<Vec3> centres;
  std::vector<double> sizes;
  for (uint64_t k = 0; k < 700; ++k) {
    centres.push_back({random(5 * k), 0.3 * random(5 * k + 1), k % 3 == 0 ? 0.0 : 0.5 * random(5 * k + 2)});
    sizes.push_back(0.002 + 0.1 * std::pow(random(5 * k + 3), 6));
  }
  const NearPatches tree(centres, sizes);
  for (const double least : {1e-6, 1e-3}) {
    for (uint32_t i = 0; i < centres.size(); i += 7) {
      const auto factorTo = [&](uint32_t j) {
        const Vec3 d = centres[j] - centres[i];
        return sizes[j] * sizes[j] / (kPi * glm::dot(d, d) + sizes[j] * sizes[j]) * random(1000 * i + j);
      };
      std::vector<NearPatches::Near> all, found;
      for (uint32_t j = 0; j < centres.size(); ++j) {
        const Vec3 d = centres[j] - centres[i];
        const double error = NearPatches::errorOf(factorTo(j), sizes[i], glm::dot(d, d));
        if (j != i && error > least) all.push_back({error, factorTo(j), j});
      }
      std::sort(all.begin(), all.end());
      all.resize(std::min<size_t>(all.size(), 16));
      tree.find(i, 16, least, factorTo, found);
      ASSERT_EQ(found.size(), all.size()) << i;
      for (size_t k = 0; k < all.size(); ++k) EXPECT_EQ(found[k].patch, all[k].patch) << i;
    }
  }
}

TEST(NearPatches, OfOnePatchAreNone) {
  const std::vector<Vec3> centre = {Vec3(0)};
  const std::vector<double> size = {1.0};
  std::vector<NearPatches::Near> found;
  NearPatches(centre, size)
      .find(
          0, 16, 1e-6, [](uint32_t) { return 1.0; }, found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace farol
