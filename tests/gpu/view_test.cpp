#include "view/view.h"

#include "raster_run.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

// Emitting squares in front of a camera at the origin that looks along -z: red upper left, green upper right, blue
// lower left, nothing lower right. Radiance E / pi.
std::vector<TestSurface> quadrants() {
  const auto square = [](const char* name, double x, double y, const Rgb& e) {
    return TestSurface{name, {{{x, y, -2}, {x + 1, y, -2}, {x + 1, y + 1, -2}, {x, y + 1, -2}}}, Rgb(0), e};
  };
  return {square("red", -1, 0, {kPi, 0, 0}), square("green", 0, 0, {0, 2 * kPi, 0}), square("blue", -1, -1, {0, 0, 3 * kPi})};
}

struct Drawn {
  Drawn(const std::vector<TestSurface>& surfaces, const Camera& camera, uint32_t width, uint32_t height, double irradiance = 0)
      : run(loadSurfaces(surfaces), {100, 0}, {}) {
    const std::vector<Rgb> h(run.patches.size(), Rgb(irradiance));
    const NodeIrradiance nodes(run.scene, run.facets, run.patches, nullptr, h);
    ViewOptions options;
    options.width = width;
    options.height = height;
    options.sky = Rgb(0.25 * kPi);
    const Tracer tracer(run.facets);
    const RayTree tree(tracer, run.facets, run.patches, {});
    options.tree = &tree;
    options.patches = &run.patches;
    image = renderView(device(), run.scene, run.facets, nodes, camera, options, Log(true));
  }
  Rgb at(double x, double y) const {  // shares of the picture, from the upper left
    const float* p = image.pixel(static_cast<uint32_t>(x * image.width), static_cast<uint32_t>(y * image.height));
    return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
  }
  RasterRun run;
  Image image;
};

void expectQuadrants(const Drawn& d) {
  EXPECT_NEAR(glm::distance(d.at(0.3, 0.3), Rgb(1, 0, 0)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(d.at(0.7, 0.3), Rgb(0, 2, 0)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(d.at(0.3, 0.7), Rgb(0, 0, 3)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(d.at(0.7, 0.7), Rgb(0.25)), 0, 1e-5);  // the sky
}

TEST(View, PutsThingsWhereTheCameraSeesThem) {
  Camera camera;
  camera.verticalFov = 2 * std::atan(0.5);  // the squares fill the picture
  expectQuadrants(Drawn(quadrants(), camera, 40, 40));
  // Larger than a tile, and not a multiple of one.
  const Drawn large(quadrants(), camera, 1100, 700);
  const Rgb left = large.at(0.5 - 0.25 / (1100.0 / 700), 0.3), right = large.at(0.5 + 0.25 / (1100.0 / 700), 0.3);
  EXPECT_NEAR(glm::distance(left, Rgb(1, 0, 0)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(right, Rgb(0, 2, 0)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(large.at(0.05, 0.5), Rgb(0.25)), 0, 1e-5);  // beyond the squares, which end at 1/2 -+ 0.318
}

TEST(View, KnowsOrthographicCameras) {
  Camera camera;
  camera.orthographic = true;
  expectQuadrants(Drawn(quadrants(), camera, 40, 40));
}

TEST(View, AveragesSamplesAtEdges) {
  Camera camera;
  camera.verticalFov = 2 * std::atan(0.5);
  const Drawn d(quadrants(), camera, 41, 41);  // the middle pixel sees a quarter of each
  const Rgb middle = d.at(0.5, 0.5);
  EXPECT_NEAR(middle.r, (1 + 0.25) / 4, 1e-5);
  EXPECT_NEAR(middle.g, (2 + 0.25) / 4, 1e-5);
  EXPECT_NEAR(middle.b, (3 + 0.25) / 4, 1e-5);
}

TEST(View, DrawsBacksBlackOrNotAtAll) {
  auto surfaces = quadrants();
  for (TestSurface& s : surfaces) std::reverse(s.polygons[0].begin(), s.polygons[0].end());
  Camera camera;
  camera.verticalFov = 2 * std::atan(0.5);
  EXPECT_EQ(Drawn(surfaces, camera, 40, 40).at(0.3, 0.3), Rgb(0));
  camera.frontFacesOnly = true;
  EXPECT_NEAR(glm::distance(Drawn(surfaces, camera, 40, 40).at(0.3, 0.3), Rgb(0.25)), 0, 1e-5);
}

// The second pass. Squares beside the camera, seen in a mirror that reflects half: as bright as half, upright, and left
// where they are left; what misses them is half the sky. And through a sheet of clear glass.
TEST(View, ShowsWhatMirrorsAndGlassPassOn) {
  Camera camera;
  camera.verticalFov = 2 * std::atan(0.5);
  const std::vector<std::vector<Vec3>> plate = {{{-3, -3, -1}, {3, -3, -1}, {3, 3, -1}, {-3, 3, -1}}};
  auto surfaces = quadrants();
  for (TestSurface& s : surfaces) {
    for (Vec3& p : s.polygons[0]) p.z = 0;
    std::reverse(s.polygons[0].begin(), s.polygons[0].end());
  }
  surfaces.push_back({"mirror", plate, Rgb(0)});
  surfaces.back().mirror = Rgb(0.5);
  const Drawn mirror(surfaces, camera, 40, 40);
  EXPECT_NEAR(glm::distance(mirror.at(0.3, 0.3), Rgb(0.5, 0, 0)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(mirror.at(0.7, 0.3), Rgb(0, 1, 0)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(mirror.at(0.3, 0.7), Rgb(0, 0, 1.5)), 0, 1e-5);
  EXPECT_NEAR(glm::distance(mirror.at(0.7, 0.7), Rgb(0.125)), 0, 1e-5);

  surfaces = quadrants();
  surfaces.push_back({"sheet", plate, Rgb(0)});
  surfaces.back().transmission = Rgb(1);
  const Drawn glass(surfaces, camera, 400, 400);
  double through = 0;
  const double reflected = fresnel(1, 1.5, through), sheet = 2 * reflected / (1 + reflected);
  const Rgb seen = glass.at(0.49, 0.49);  // nearly straight
  EXPECT_NEAR(seen.r, 1 - sheet + 0.25 * sheet, 1e-4);
  EXPECT_NEAR(seen.g, 0.25 * sheet, 1e-4);
}

// Inside a white furnace every pixel shows B / pi, whatever it sees.
TEST(View, SeesTheSameRadianceEverywhereInAFurnace) {
  Camera camera;
  camera.position = {0.4, 0.3, 0.9};
  camera.verticalFov = 1.5;
  const Drawn d(closedBox({1, 1, 1}, Rgb(0.5), Rgb(1)), camera, 64, 48, 2.0);
  for (const float v : d.image.rgb) ASSERT_NEAR(static_cast<double>(v), 2 / kPi, 1e-6);
}

}  // namespace
}  // namespace farol::test
