// The hemicube at one point against the point's exact factors: its error falls with resolution.
#include "formfactor/analytic.h"
#include "raster_run.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

// Root mean square over many turned hemicubes of the row error sum_j |F_ij - exact_ij| from one receiver in a box whose
// walls are cut into patches.
double rowError(uint32_t resolution, Projection projection) {
  auto surfaces = closedBox({1.0, 1.3, 0.9});
  surfaces.erase(surfaces.begin() + 4);  // the receiver takes the place of the floor z0
  const Vec3 p(0.37, 0.52, 0.0);
  constexpr double h = 1e-4;
  surfaces.push_back({"receiver", {{p + Vec3(-h, -h, 0), p + Vec3(h, -h, 0), p + Vec3(h, h, 0), p + Vec3(-h, h, 0)}}});
  double squares = 0;
  constexpr int kTurns = 24;
  for (int seed = 1; seed <= kTurns; ++seed) {
    RasterOptions options;
    options.resolution = resolution;
    options.projection = projection;
    options.seed = static_cast<uint64_t>(seed);
    RasterRun run(loadSurfaces(surfaces), {600, 0}, options);
    const uint32_t receiver = run.patchesOf("receiver").at(0);
    RasterRowMaker(device(), run.facets, run.patches, options).makeRows(std::vector<uint32_t>{receiver}, run.f, [](size_t) {});
    const Vec3 eye = run.facets.frame.toUnit(run.patches.patches[receiver].centre), normal = run.patches.patches[receiver].normal;
    double error = 0;
    for (uint32_t j = 0; j < run.patches.size(); ++j) {
      const Cell& cell = run.patches.cells[run.patches.cellsOf(j)[0]];
      const Facet& facet = run.facets.facets[cell.facet];
      std::vector<Vec3> polygon;
      for (const Vec2 corner : {Vec2(0, 0), Vec2(1, 0), Vec2(1, 1), Vec2(0, 1)}) {
        const Vec2 uv = cellPoint(run.patches.grids[cell.facet], true, cell, corner.x, corner.y);
        polygon.push_back(run.facets.point(facet, uv.x, uv.y));
      }
      error += std::abs(run.f[receiver].at(j) - (j == receiver ? 0 : pointToPolygon(eye, normal, polygon)));
    }
    squares += error * error;
  }
  return std::sqrt(squares / kTurns);
}

// Measured law in such a box: row error 0.31 s^-0.57 with s pixels per visible patch, so R^-1.14; twice the
// resolution must take off between 2^0.9 and 2^1.4.
TEST(HemicubeRow, ErrorFallsWithResolutionAsExpected) {
  double last = rowError(32, Projection::hemicube);
  EXPECT_LT(last, 0.31 * std::pow(3 * 32 * 32 / 600.0, -0.57) * 1.6);  // the law's constant depends on the scene
  for (const uint32_t resolution : {64u, 128u, 256u}) {
    const double next = rowError(resolution, Projection::hemicube);
    EXPECT_GT(last / next, std::pow(2, 0.9)) << "R = " << resolution;
    EXPECT_LT(last / next, std::pow(2, 1.4)) << "R = " << resolution;
    last = next;
  }
}

// The tetrahedron's faces have half as many useful pixels (R = 128: 25k against 49k) and about the same error.
TEST(TetrahedronRow, NeedsFewerPixelsThanTheHemicube) {
  EXPECT_LT(rowError(128, Projection::tetrahedron), 1.25 * rowError(128, Projection::hemicube));
  EXPECT_LT(rowError(128, Projection::tetrahedron), 0.7 * rowError(64, Projection::tetrahedron));
}

}  // namespace
}  // namespace farol::test
