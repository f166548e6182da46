// Rays, raster with the near-field correction, and closed forms against form_factors.json, each within the error that
// it states itself; and the laws by which the errors of rays fall.
#include "formfactor/analytic.h"
#include "raster_run.h"
#include "truth_cases.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

using nlohmann::json;

std::string caseName(const ::testing::TestParamInfo<size_t>& parameter) { return TruthCase(parameter.param).id(); }

constexpr double kSmallest = 1e-5;  // factors below are for closed forms only

class FormFactors : public ::testing::TestWithParam<size_t> {
 protected:
  TruthCase truth{GetParam()};
  PatchOptions patches(size_t count = 4000) const {
    PatchOptions o;
    o.count = count;
    if (truth.hasElement()) o.size = 100;  // one patch: it stands for a point
    return o;
  }
  int segments() const { return truth.hasSphere() ? 24 : 64; }
};

// The program's defaults for factors: 4,000 patches, 4,096 rays. Within 1 % and three times the stated standard error.
TEST_P(FormFactors, OfRaysAreWithinTheStatedError) {
  RayOptions options;
  options.rays = 4096;
  RayRun run(loadSurfaces(truth.surfaces(segments())), patches(), options);
  RayRun coarse(loadSurfaces(truth.surfaces(12)), patches(), options);
  for (const json& e : truth.json["expected"]) {
    const std::string from = truth.renamed(e["from"]), to = truth.renamed(e["to"]);
    const double value = e["value"];
    if (value < kSmallest) continue;
    double found = run.factor(from, to);
    if (truth.hasSphere()) found += (found - coarse.factor(from, to)) / 3;  // Richardson: the sphere, not its facets
    const double error = run.factorError(run.errorModel(), from, to);
    EXPECT_NEAR(found, value, 0.01 * value + 3 * error) << truth.id() << ": " << from << " -> " << to << " +- " << error;
  }
}

// One hemicube of R = 64 per patch with the near-field correction; the stated error is fitted on rays.
TEST_P(FormFactors, OfRasterWithNearFieldAreWithinTheStatedError) {
  if (truth.hasSphere()) GTEST_SKIP() << "spheres by raster are held above";
  const Scene scene = loadSurfaces(truth.surfaces(segments()));
  RayOptions reference;
  reference.rays = 16384;
  RayRun rays(scene, patches(), reference);
  RasterOptions options;
  RasterRun run(scene, patches(), options);
  const ExposedArea exposed = findExposedArea(rays.tracer, run.facets, run.patches, 64, 1);
  const NearField nearField(rays.tracer, run.facets, run.patches, exposed, 1);
  run.options.nearField = &nearField;
  run.options.exposed = &exposed;
  for (const json& e : truth.json["expected"]) {
    const std::string from = truth.renamed(e["from"]), to = truth.renamed(e["to"]);
    const double value = e["value"], found = run.factor(from, to);
    if (value < kSmallest) continue;
    ProbeRows probes;
    probes.patches = run.probePatches(32);
    probes.reference.emplace_back(run.patches.size());
    rays.maker()->makeRows(probes.patches, probes.reference[0], [](size_t) {});
    const double error = run.factorError(fitErrorModel(run.f, run.patches, probes, 3.0 * 64 * 64), from, to, true);
    EXPECT_NEAR(found, value, 0.01 * value + 3 * error) << truth.id() << ": " << from << " -> " << to << " +- " << error;
  }
}

// Closed forms where nothing can block: 1e-5, factors of any size.
TEST_P(FormFactors, InClosedFormAreExact) {
  const Scene scene = loadSurfaces(truth.surfaces(segments()));
  if (!truth.onlyPolygons()) GTEST_SKIP() << "facets are not the curved surface";
  ExactRun run(scene, patches(60));
  const std::string blocker = whatMayBlock(run.scene, run.facets);
  if (truth.id().starts_with("A15") || truth.id().starts_with("A16")) {
    EXPECT_NE(blocker, "") << "something stands between the squares";
    return;
  }
  ASSERT_EQ(blocker, "");
  for (const json& e : truth.json["expected"]) {
    const double value = e["value"];
    EXPECT_NEAR(run.factor(e["from"], e["to"]), value, 1e-5 * value) << truth.id();
  }
}

INSTANTIATE_TEST_SUITE_P(Truth, FormFactors, ::testing::Range<size_t>(0, truthCases().size()), caseName);

// Occluded pairs at a high setting, 65,536 rays on each of about 400 patches: 1e-3.
TEST(OccludedFormFactors, AreRightToOneInAThousandAtAHighSetting) {
  for (size_t k = 0; k < truthCases().size(); ++k) {
    const TruthCase truth(k);
    if (!truth.id().starts_with("A15")) continue;
    RayOptions options;
    options.rays = 65536;
    RayRun run(loadSurfaces(truth.surfaces(4)), {400, 0}, options);
    for (const json& e : truth.json["expected"]) {
      const double value = e["value"];
      if (value <= 0) continue;
      EXPECT_NEAR(run.factor(e["from"], e["to"]), value, 1e-3 * value) << truth.id();
    }
  }
}

// Root mean square over seeds of the error of a unit square's factors to the 64 patches of the other five faces of a
// cube, per entry.
double rmsError(uint32_t rays, bool spread, SampleTable::Kind kind) {
  auto box = closedBox({1, 1, 1});
  box[4].polygons = {{{0.2, 0.3, 0}, {0.5, 0.3, 0}, {0.5, 0.6, 0}, {0.2, 0.6, 0}}};  // the gathering patch, in z = 0
  double squares = 0;
  size_t entries = 0;
  constexpr int kSeeds = 16;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    RayOptions options;
    options.rays = rays;
    options.spread = spread;
    options.kind = kind;
    options.seed = static_cast<uint64_t>(seed);
    RayRun run(loadSurfaces(box), {0, 0.31}, options);
    const uint32_t i = run.patchesOf("z0").at(0);
    run.makeRowsOf("z0");
    const UnoccludedFactor exact(run.facets, run.patches);
    const Position centre{run.facets.frame.toUnit(run.patches.patches[i].centre), 1};
    for (uint32_t j = 0; j < run.patches.size(); ++j) {
      if (j == i) continue;
      const double truth = spread ? exact(i, j, 8) : exact.from(std::span(&centre, 1), i, j);
      squares += std::pow(run.f[i].at(j) - truth, 2);
      ++entries;
    }
  }
  return std::sqrt(squares / static_cast<double>(entries));
}

double exponent(bool spread, SampleTable::Kind kind) {
  const double few = rmsError(256, spread, kind), many = rmsError(16384, spread, kind);
  return std::log(many / few) / std::log(64.0);
}

TEST(RayLaw, FromOnePointErrorsFallFasterThanRandomOnes) { EXPECT_LT(exponent(false, SampleTable::Kind::lowDiscrepancy), -0.70); }
TEST(RayLaw, WithSpreadOriginsTheIntegralHasFourDimensions) { EXPECT_LT(exponent(true, SampleTable::Kind::lowDiscrepancy), -0.55); }
TEST(RayLaw, RandomDirectionsFallAsTheSquareRoot) {
  const double e = exponent(true, SampleTable::Kind::random);
  EXPECT_GT(e, -0.56);
  EXPECT_LT(e, -0.44);
}

}  // namespace
}  // namespace farol::test
