#include "solve/irradiance_error.h"

#include "test_scene.h"

#include <gtest/gtest.h>

using namespace farol;
using namespace farol::test;

namespace {

// A box of patches, nothing in F, and direct light that is known to an error.
struct Box {
  Log log = Log::silent();
  Scene scene = loadSurfaces(closedBox({1, 1, 1}));
  FacetSet facets = buildFacets(scene, log);
  PatchSet patches = buildPatches(scene, facets, {600, 0});
  FormFactorMatrix f{patches.size()};
  DirectLight direct;
  Solution solution;

  Box() {
    direct.irradiance.assign(patches.size(), Rgb(1));
    direct.deviation.assign(patches.size(), Rgb(0));
    direct.apart.assign(patches.size(), 0);
    solution.radiosity.assign(patches.size(), Rgb(0));
    solution.irradiance.assign(patches.size(), Rgb(1));
    for (uint32_t i = 0; i < patches.size(); ++i) f.finish(i, {});
  }
  std::vector<Rgb> errors() const { return irradianceError(f, patches, direct, solution, {}, 256, Rgb(0)); }
};

}  // namespace

// Variances of nine neighbours are averaged, channel by channel.
TEST(IrradianceError, OfDirectLightIsSmoothedAndKeepsItsChannels) {
  Box box;
  box.direct.deviation[100] = Rgb(3, 0.3, 0);
  Rgb squares(0);
  for (const Rgb& e : box.errors()) squares += e * e;
  EXPECT_NEAR(squares.r, 9, 1e-9);
  EXPECT_NEAR(squares.g, 0.09, 1e-9);
  EXPECT_EQ(squares.b, 0);
  EXPECT_NEAR(box.errors()[100].r, 1, 1e-9);
}

// Of a patch that is nearly covered few shadow rays count: its neighbours do not err with it.
TEST(IrradianceError, OfLittleExposedPatchesStaysTheirs) {
  Box box;
  constexpr double kExposed = 0.01;
  RowShares shares;
  shares.exposed = kExposed;
  box.f.finish(100, shares);
  box.direct.deviation[100] = Rgb(3);
  const std::vector<Rgb> errors = box.errors();
  EXPECT_NEAR(errors[100].r, 1, 1e-9);
  for (size_t i = 0; i < errors.size(); ++i) {
    if (i != 100) {
      EXPECT_LE(errors[i].r, std::sqrt(kExposed) + 1e-9) << i;
    }
  }
}
