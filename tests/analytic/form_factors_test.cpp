// Raster form factors against the closed forms and converged values of form_factors.json (sources per case there).
#include "raster_run.h"
#include "truth_cases.h"

#include <cmath>
#include <gtest/gtest.h>

namespace farol::test {
namespace {

using nlohmann::json;

class RasterFormFactors : public ::testing::TestWithParam<size_t> {
 protected:
  TruthCase truth{GetParam()};
  bool hasSphere() const { return truth.hasSphere(); }
  bool hasElement() const { return truth.hasElement(); }
};

// 9 hemicubes of R = 128 on each of about 400 patches: within 0.3 % + 1e-5 (factors below 1e-5 are out of reach of
// pixels and fall under the absolute part).
TEST_P(RasterFormFactors, MatchClosedForm) {
  RasterOptions options;
  options.resolution = 128;
  options.positions = hasElement() ? 64 : 9;  // an element is one patch: what other cases have in patches it gets in turns
  PatchOptions patches;
  if (hasElement())
    patches.size = 100;
  else
    patches.count = 400;
  if (hasSphere()) options.positions = 4;  // many small facets need fewer positions each
  RasterRun run(loadSurfaces(truth.surfaces(hasSphere() ? 24 : 64)), patches, options);
  RasterRun coarse(loadSurfaces(truth.surfaces(12)), patches, options);
  for (const json& e : truth.json["expected"]) {
    const std::string id = truth.id(), from = truth.renamed(e["from"]), to = truth.renamed(e["to"]);
    const double value = e["value"];
    double found = run.factor(from, to);
    // A polyhedron differs from its sphere by the square of the facet size: two sizes give the limit (Richardson).
    if (hasSphere()) found += (found - coarse.factor(from, to)) / 3;
    EXPECT_NEAR(found, value, 0.003 * value + 1e-5) << id << ": " << from << " -> " << to;
  }
}

// A rigid motion or a change of scale changes no factor: a general rotation, a shift by 1000 sizes, four scales.
TEST_P(RasterFormFactors, DoNotDependOnPlacement) {
  const auto surfaces = truth.surfaces(hasSphere() ? 8 : 24);
  RasterOptions options;
  options.positions = hasElement() ? 16 : 4;
  PatchOptions patches;
  patches.count = hasElement() ? 1 : 60;
  const json& e = truth.json["expected"][0];
  const std::string from = truth.renamed(e["from"]), to = truth.renamed(e["to"]);
  const double here = RasterRun(loadSurfaces(surfaces), patches, options).factor(from, to);
  const auto there = [&](const Placement& placement) {
    return RasterRun(loadSurfaces(surfaces, placement), patches, options).factor(from, to);
  };
  const double size = 25;  // an upper bound of the cases' sizes

  // Inside, the scene is moved to its centre and scaled to size 1 in double precision: what is left of a shift or a
  // scale is rounding, which may move single pixels at edges (a pixel of R = 64 is 3e-4 of the hemisphere at most).
  for (const double scale : {1e-6, 1e-3, 1e3, 1e6})
    EXPECT_NEAR(there({{0, 0, 0, 1}, Vec3(0), scale}), here, 1e-5 + 1e-4 * here) << "scale " << scale;
  EXPECT_NEAR(there({{0, 0, 0, 1}, Vec3(1000, -700, 500) * size, 1}), here, 1e-5 + 1e-4 * here) << "shift";
  // A rotation turns the pixel grids as well: equal within the sampling error of these settings.
  EXPECT_NEAR(there({generalRotation(), Vec3(0), 1}), here, 1e-4 + 0.01 * here) << "rotation";
}

INSTANTIATE_TEST_SUITE_P(Truth, RasterFormFactors, ::testing::Range<size_t>(0, truthCases().size()),
                         [](const auto& parameter) { return TruthCase(parameter.param).id(); });

// Faceted spheres approach the sphere with the square of the facet size.
TEST(RasterFormFactorsOfSpheres, ErrorFallsWithFacetSizeSquared) {
  const auto capShare = [](int segments) {  // exact: 0.25 from anywhere to a cap of half angle 60 degrees
    RasterOptions options;
    options.resolution = 128;
    options.positions = 4;
    RasterRun run(loadSurfaces(sphereZones("zone", 1, true, {-1, 0.5, 1}, segments)), {400, 0}, options);
    return run.factor("zone0", "zone1");
  };
  const double coarse = std::abs(capShare(12) - 0.25), fine = std::abs(capShare(24) - 0.25);
  EXPECT_GT(coarse / fine, 3.0);  // 4 in the limit
  EXPECT_LT(fine, 0.25 * 0.02);
}

}  // namespace
}  // namespace farol::test
