#include "solve/irradiance_error.h"

#include "formfactor/neighbourhood.h"
#include "test_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
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

// Makes all rows gather a quarter of patch `source`, which alone shines, and every tenth again, an eighth more. Nothing reflects.
// kEighth: that eighth, with the standard deviation of what 24 replicates tell.
const double kEighth = 0.125 * (1 + 1 / std::sqrt(48));
Replicates eighthMore(Box& box, uint32_t source) {
  box.solution.radiosity[source] = Rgb(1, 0.5, 0);
  Replicates replicates;
  replicates.rows.emplace(box.f.size());
  for (uint32_t i = 0; i < box.f.size(); ++i) {
    box.patches.patches[i].reflectance = Rgb(0);
    box.f.entries(i, std::vector<uint32_t>{source}, std::vector<float>{0.25f});
    box.f.finish(i, {});
    if (i % 10 != 0) continue;
    replicates.patches.push_back(i);
    replicates.rows->entries(i, std::vector<uint32_t>{source}, std::vector<float>{0.375f});
    replicates.rows->finish(i, {});
  }
  return replicates;
}

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

// All rows gather a quarter of one patch, replicates three eighths: F errs by half of the square of that eighth, by all of it where
// replicates are much better, and one standard deviation of what 24 of them tell is added. Nothing is reflected.
TEST(IrradianceError, IsWhatReplicatesDifferBy) {
  Box box;
  Replicates replicates = eighthMore(box, 300);
  for (const bool better : {false, true}) {
    replicates.better = better;
    const double expected = kEighth * (better ? 1 : std::sqrt(0.5));
    for (const Rgb& e : irradianceError(box.f, box.patches, box.direct, box.solution, replicates, 256, Rgb(0))) {
      ASSERT_NEAR(e.r, expected, 1e-6);
      ASSERT_NEAR(e.g, 0.5 * expected, 1e-6);
      ASSERT_EQ(e.b, 0);
    }
  }
}

// Where that one patch reflects r, what its group of neighbours errs by, as the mean of so many patches, comes back to all groups
// that have replicates: r/4 + (r/4)^2 + ... of it.
TEST(IrradianceError, IsCarriedOnByWhatReflects) {
  Box box;
  constexpr uint32_t kSource = 300;
  const Replicates replicates = eighthMore(box, kSource);
  box.patches.patches[kSource].reflectance = Rgb(0.8);
  const std::vector<uint32_t> groupOf = Neighbourhood(box.patches).groups(96);
  const auto together = static_cast<double>(std::count(groupOf.begin(), groupOf.end(), groupOf[kSource]));
  const double own = 0.5 * kEighth * kEighth, back = 0.2 / (1 - 0.2);
  const std::vector<Rgb> errors = irradianceError(box.f, box.patches, box.direct, box.solution, replicates, 256, Rgb(0));
  size_t told = 0;
  for (const uint32_t p : replicates.patches) {
    for (size_t i = 0; i < errors.size(); ++i) {
      if (groupOf[i] != groupOf[p]) continue;
      ASSERT_NEAR(errors[i].r, std::sqrt(own * (1 + back * back / together)), 1e-6) << i;
      ++told;
    }
  }
  EXPECT_GT(told, errors.size() / 2);
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

// Where rows gather one radiosity their samples do not scatter; where they gather nothing and twice that, or nothing and a sky,
// they do. What replicates show of all is shared out accordingly, but for a fourth.
TEST(IrradianceError, GoesWhereSamplesScatter) {
  Box box;
  constexpr float kChange = 0.01f;
  const Rgb sky(2);
  RowShares half;
  half.missed = 0.5;
  Replicates replicates;
  replicates.rows.emplace(box.patches.size());
  const auto one = static_cast<uint32_t>(box.patches.size() - 3);  // radiosities 1, 0 and 2
  box.solution.radiosity[one] = Rgb(1);
  box.solution.radiosity[one + 2] = Rgb(2);
  for (uint32_t i = 0; i < box.patches.size(); ++i) {
    const uint32_t wall = box.patches.patches[i].surface;
    const RowShares shares = wall == 2 ? half : RowShares{};
    std::vector<uint32_t> ids;
    std::vector<float> values;
    if (wall == 0) ids = {one}, values = {1.0f};
    if (wall == 1) ids = {one + 1, one + 2}, values = {0.5f, 0.5f};
    box.f.entries(i, ids, values);
    box.f.finish(i, shares);
    if (wall < 3) box.solution.irradiance[i] = Rgb(2);  // of the lamps 1
    if (i % 25 != 0) continue;
    replicates.patches.push_back(i);
    if (wall == 0) {
      values[0] += kChange;
    } else {
      ids.insert(ids.begin(), one);
      values.insert(values.begin(), kChange);
    }
    replicates.rows->entries(i, ids, values);
    replicates.rows->finish(i, shares);
  }
  std::array<double, 6> squares{};
  const std::vector<Rgb> errors = irradianceError(box.f, box.patches, box.direct, box.solution, replicates, 256, sky);
  for (size_t i = 0; i < errors.size(); ++i) squares[box.patches.patches[i].surface] += errors[i].r * errors[i].r;
  EXPECT_GT(squares[1], 4 * squares[0]);
  EXPECT_GT(squares[2], 4 * squares[0]);
}
