// Failures of geometry: planes, slivers, coincident faces, leaks, sides, scale, near plane and depth.
#include "failure_table.h"
#include "program.h"
#include "test_scene.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <random>

namespace farol::test {
namespace {

using ::testing::HasSubstr;
using Polygon = std::vector<Vec3>;

Polygon flipped(Polygon p) {
  std::reverse(p.begin(), p.end());
  return p;
}

// Factors between surfaces as the program writes them, and what it said.
struct Factors {
  Factors(const std::vector<TestSurface>& surfaces, const std::string& options, const Placement& placement = {}) {
    const TemporaryFolder folder;
    writeText(folder.path("s.gltf"), gltfOf(surfaces, placement).dump());
    outcome = farol("factors " + folder.path("s.gltf") + " -o " + folder.path("f.csv") + " " + options);
    EXPECT_EQ(outcome.exitCode, 0) << outcome.err;
    const auto lines = readCsv(folder.path("f.csv"));
    for (size_t row = 1; row < lines.size(); ++row) {
      for (size_t k = 2; k < lines[row].size(); ++k) f[{lines[row][0], lines[0].at(k)}] = std::stod(lines[row][k]);
    }
  }
  double operator()(const std::string& from, const std::string& to) const { return f.at({from, to}); }
  std::map<std::pair<std::string, std::string>, double> f;
  Outcome outcome;
};

// Lambert's contour sum in float32 from the centre of one polygon, as a careless program evaluates it.
float naiveContour(const std::vector<glm::vec3>& from, const std::vector<glm::vec3>& to) {
  glm::vec3 centre(0);
  for (const glm::vec3& p : from) centre += p / static_cast<float>(from.size());
  const glm::vec3 n = glm::normalize(glm::cross(from[1] - from[0], from[2] - from[0]));
  float sum = 0;
  for (size_t k = 0; k < to.size(); ++k) {
    const glm::vec3 a = glm::normalize(to[k] - centre), b = glm::normalize(to[(k + 1) % to.size()] - centre);
    const glm::vec3 axis = glm::cross(a, b);
    const float length = glm::length(axis);
    if (length > 0) sum += std::acos(std::clamp(glm::dot(a, b), -1.0f, 1.0f)) * glm::dot(n, axis / length);
  }
  return sum / (2 * static_cast<float>(kPi));
}

// Failure 5. Squares with a common edge whose planes differ by a small angle: F = 0.0775 angle^2, and exactly 0 in one plane.
TEST(Coplanar, FactorsAreZeroAndNeverNegative) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  float lowest = 0;
  for (int k = 0; k < 300; ++k) {  // a million metres from the origin, turned at random
    const Vec3 x = glm::normalize(Vec3(normal(random), normal(random), normal(random))), y = anyPerpendicular(x);
    const Vec3 at = 1e6 * glm::normalize(Vec3(normal(random), normal(random), normal(random)));
    const auto square = [&](double offset) {
      std::vector<glm::vec3> p;
      for (const auto& [s, t] : {std::pair(0.0, 0.0), {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}})
        p.emplace_back(at + (s + offset) * x + t * y);
      return p;
    };
    const float f = naiveContour(square(0), square(1));
    if (std::isfinite(f)) lowest = std::min(lowest, f);
  }
  EXPECT_LT(lowest, -1e-4);
  const Factors flat({{"1", {rectangle(0, 0, 1, 1, 0)}}, {"2", {rectangle(1, 0, 2, 1, 0)}}}, "--patches 50");
  EXPECT_EQ(flat("1", "2"), 0);
  const Factors rays({{"1", {rectangle(0, 0, 1, 1, 0)}}, {"2", {rectangle(1, 0, 2, 1, 0)}}}, "--patches 50 --method rays");
  EXPECT_EQ(rays("1", "2"), 0);
  double worst = 0;
  for (const double angle : {0.1, 0.01, 0.001}) {
    const double c = std::cos(angle), s = std::sin(angle);
    const Factors f({{"1", {rectangle(0, 0, 1, 1, 0)}}, {"2", {{{1, 0, 0}, {1 + c, 0, s}, {1 + c, 1, s}, {1, 1, 0}}}}},
                    "--patches 50");
    const double exact = 0.0775 * angle * angle;
    EXPECT_NEAR(f("1", "2"), exact, 0.02 * exact) << angle;
    worst = std::max(worst, std::abs(f("1", "2") / exact - 1));
  }
  tabulate(5, "coplanar squares; planes at 0.1 to 0.001 rad", fmt::format("{:.2g} (float32 contour, 10^6 m away)", lowest),
           fmt::format("0; {:.2g} % off", 100 * worst), "");
}

// Failure 6. A sliver's normal is noise in float32; triangles without area have none.
TEST(Slivers, AreLeftOutWithTheirNumber) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> shift(-10, 10);
  std::vector<double> errors;
  for (int k = 0; k < 300; ++k) {
    const Vec3 x = glm::normalize(Vec3(normal(random), normal(random), normal(random))), y = anyPerpendicular(x),
               n = glm::cross(x, y);
    const Vec3 at(shift(random), shift(random), shift(random));
    const glm::vec3 a(at), b(at + x), c(at + 0.37 * x + 1e-6 * y);
    const Vec3 found = glm::normalize(glm::cross(Vec3(b) - Vec3(a), Vec3(c) - Vec3(a)));
    errors.push_back(std::acos(std::clamp(glm::dot(found, n), -1.0, 1.0)) * 180 / kPi);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_NEAR(errors[150], 5.7, 2);
  auto box = closedBox({1, 1, 1}, Rgb(0.5));
  box[5].emission = Rgb(1);
  const Factors clean(box, "--patches 100 --method rays --rays 1024");
  box.push_back({"dirt",
                 {{{0.2, 0.2, 0.5}, {0.8, 0.2, 0.5}, {0.8, 0.2, 0.5}},
                  {{0.2, 0.2, 0.5}, {0.5, 0.2, 0.5}, {0.8, 0.2, 0.5}},
                  {{0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}},
                  {{0.2, 0.2, 0.5}, {0.8, 0.2, 0.5}, {0.42, 0.2 + 1e-7, 0.5}}}});
  const Factors dirty(box, "--patches 100 --method rays --rays 1024");
  EXPECT_THAT(dirty.outcome.err, HasSubstr("4 degenerate triangles"));
  EXPECT_THAT(dirty.outcome.err, HasSubstr("[degenerate-triangles]"));
  EXPECT_EQ(clean("x0", "x1"), dirty("x0", "x1"));
  tabulate(6, "slivers 1e-6 thin, triangles without area", fmt::format("normals {:.1f} degrees off (median)", errors[150]),
           "left out; the rest is unchanged", "degenerate-triangles");
}

// The plane of a needle is known to its normal's float32 rounding times its length: rays that start too close to a pane of that
// shape meet it again and again.
TEST(Slivers, DoNotMeetThemselves) {
  const Vec3 a(4.33, 2.318, 4.771), b(2.85, 3.271, 6.448), along = b - a, across = glm::normalize(Vec3(along.y, -along.x, 0));
  double worst = 0;
  for (const double width : {1e-2, 1e-3, 3e-4}) {
    const Factors f({{"ground", {rectangle(0, 0, 10, 10, 0)}},
                     {"needle", {{a, b, a + 0.5 * along + width * across}}, Rgb(0), Rgb(0), true, Rgb(0), Rgb(0.86)}},
                    "--patches 10 --method rays --rays 4096");
    for (const auto& [pair, value] : f.f) {
      if (pair.first.starts_with("needle") && pair.second.starts_with("needle")) worst = std::max(worst, value);
    }
    EXPECT_NEAR(f("needle", "ground"), 0.32, 0.01) << width;
  }
  EXPECT_EQ(worst, 0);
  tabulate(6, "a pane 1e-4 of the scene wide", "2.87 meetings with itself per ray (offset 4e-7)", fmt::format("{}", worst), "");
}

// Failure 7. Two faces in one plane, seen from below: no answer is right, but it must be one answer.
TEST(CoincidentFaces, AreOneAnswerAndAWarning) {
  const Polygon a = {{-.5, -.5, 1}, {-.5, .5, 1}, {.5, .5, 1}, {.5, -.5, 1}},
                b = {{-.5, -.5, 1}, {-.37, .5, 1}, {.5, .41, 1}, {.5, -.5, 1}};
  const Polygon element = rectangle(-.01, -.01, .01, .01, 0);
  const Factors alone({{"1", {element}}, {"A", {a}}}, "--patches 50 --method rays --rays 16384");
  std::set<double> answers;
  for (const char* threads : {"--threads 1", "--threads 2", "--threads 2"}) {
    const Factors both({{"1", {element}}, {"A", {a}}, {"B", {b}}},
                       std::string("--patches 50 --method rays --rays 16384 ") + threads);
    answers.insert(both("1", "B"));
    EXPECT_NEAR(both("1", "A") + both("1", "B"), alone("1", "A"), 2e-3) << threads;
    EXPECT_THAT(both.outcome.err, HasSubstr("surfaces 'A' and 'B' lie in one plane"));
    EXPECT_THAT(both.outcome.err, HasSubstr("[overlapping-faces]"));
  }
  EXPECT_EQ(answers.size(), 1u) << "the same on every run and number of threads";
  EXPECT_EQ(alone.outcome.err.find("overlapping-faces"), std::string::npos);
  tabulate(7, "two faces in one plane", "0 to 100 % of the rays go to either", "one answer on every run; their sum is the union's",
           "overlapping-faces");
}

// Failure 8. A gap between wall and ceiling leaks: the factor through it is real, and small.
TEST(Leaks, ThroughAGapAreFoundAndNamed) {
  const auto room = [](double gap) {
    const double h = 2.7 + gap, top = 10;
    return std::vector<TestSurface>{{"element", {rectangle(1.99, 1.99, 2.01, 2.01, 0)}},
                                    {"wall", {{{0, 0, 0}, {0, 4, 0}, {0, 4, 2.7}, {0, 0, 2.7}}}, Rgb(0.5), Rgb(0), true},
                                    {"ceiling", {flipped(rectangle(0, 0, 4, 4, h))}},
                                    {"far", {{{4, 0, 0}, {4, 0, h}, {4, 4, h}, {4, 4, 0}}}},
                                    {"y0", {{{-0.5, 0, 0}, {-0.5, 0, top}, {4, 0, top}, {4, 0, 0}}}},
                                    {"y1", {flipped({{-0.5, 4, 0}, {-0.5, 4, top}, {4, 4, top}, {4, 4, 0}})}},
                                    {"outside", {{{-0.5, 0, 0}, {-0.5, 4, 0}, {-0.5, 4, top}, {-0.5, 0, top}}}, Rgb(0.5), Rgb(1)}};
  };
  const double known[] = {3.674e-3, 3.763e-4};
  const double gaps[] = {0.1, 0.01};
  double worst = 0;
  for (int k = 0; k < 2; ++k) {
    const Factors f(room(gaps[k]), "--patches 8 --method rays --rays 262144");
    const double error = std::sqrt(known[k] / 262144);  // of independent rays
    EXPECT_NEAR(f("element", "outside"), known[k], 3 * error + 0.01 * known[k]) << "gap " << gaps[k];
    worst = std::max(worst, std::abs(f("element", "outside") / known[k] - 1));
  }
  // The gap that rounding leaves is closed, and one that is left open to nowhere is told.
  auto open = closedBox({1, 1, 1}, Rgb(0.5));
  open[5].polygons = {flipped(rectangle(0, 0, 1, 0.999, 1))};
  const Factors leaking(open, "--patches 300 --method rays --rays 4096");
  EXPECT_THAT(leaking.outcome.err, HasSubstr("[small-leak]"));
  auto touching = closedBox({1, 1, 1}, Rgb(0.5));
  for (Vec3& p : touching[5].polygons[0]) p.z += 3e-7;
  const Factors welded(touching, "--patches 300 --method rays --rays 4096");
  EXPECT_EQ(welded.outcome.err.find("small-leak"), std::string::npos) << welded.outcome.err;
  tabulate(8, "a gap of 0.1 and 0.01 m below the ceiling", "N = 64: +18 % and 0 instead of 3.8e-4",
           fmt::format("{:.2g} % off at most (262,144 rays)", 100 * worst),
           "small-leak where a scene is nearly closed; gaps below 1e-6 of the scene are welded");
}

// Failure 9. A black partition cuts a patch of the floor; only x < 2.6 is lit, uniformly. The centre sees all of it or nothing.
TEST(InterpenetratingGeometry, PatchIsLitByItsLitShare) {
  const auto litShare = [](double partition) {
    nlohmann::json j = gltfOf({{"patch", {rectangle(2, 0, 3, 1, 0)}},
                               {"partition",
                                {{{partition, -50, -1}, {partition, 50, -1}, {partition, 50, 50}, {partition, -50, 50}}},
                                Rgb(0),
                                Rgb(0),
                                true}});
    j["extensionsUsed"] = {"KHR_lights_punctual"};
    j["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "directional"}, {"intensity", 1}}};
    // From the left at 45 degrees: along (1, 0, -1).
    j["nodes"].push_back(
        {{"rotation", {0, std::sin(-kPi / 8), 0, std::cos(kPi / 8)}}, {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
    j["scenes"][0]["nodes"].push_back(j["nodes"].size() - 1);
    const TemporaryFolder folder;
    writeText(folder.path("s.gltf"), j.dump());
    const Outcome o =
        farol("solve " + folder.path("s.gltf") + " --patch-size 1000 --shadow-rays 1024 --patches-csv " + folder.path("p.csv"));
    EXPECT_EQ(o.exitCode, 0) << o.err;
    return std::stod(readCsv(folder.path("p.csv")).at(1).at(18)) / std::cos(kPi / 4);
  };
  const double more = litShare(2.6), less = litShare(2.4);
  EXPECT_NEAR(more, 0.6, 0.01);
  EXPECT_NEAR(less, 0.4, 0.01);
  tabulate(9, "a partition across a patch, at 0.6 and 0.4 of it", "1 and 0 (centre)", fmt::format("{:.3f} and {:.3f}", more, less),
           "");
}

// Failure 10. A one-sided blocker is opaque from both sides, and its back is black.
TEST(OneSidedFaces, BlockFromBothSides) {
  const std::vector<TestSurface> scene = {{"1", {rectangle(0, 0, 1, 1, 0)}},
                                          {"2", {flipped(rectangle(0, 0, 1, 1, 1))}},
                                          {"blocker", {rectangle(0.25, 0.25, 0.75, 0.75, 0.5)}}};
  constexpr double kCulled = 0.19982489569838738, kExact = 0.09950578;
  for (const char* method : {"rays --rays 16384", "raster --resolution 128 --positions 9"}) {
    const Factors f(scene, std::string("--patches 200 --method ") + method);
    EXPECT_NEAR(f("1", "2"), kExact, 0.01 * kExact) << method;
    EXPECT_EQ(f("1", "blocker"), 0) << "its back is not a patch";
    if (std::string(method).starts_with("rays"))
      tabulate(10, "a one-sided blocker from behind", fmt::format("{} (culled)", kCulled),
               fmt::format("{:.4f} ({:.4f} is exact)", f("1", "2"), kExact), "share met from behind");
  }
}

// Failure 14. A fixed offset of ray origins is too small far away and too large in small scenes; F does not depend on scale.
TEST(Scale, DoesNotChangeFactors) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<float> unit;
  int own = 0;
  constexpr int kRays = 2000;
  for (int k = 0; k < kRays; ++k) {  // 10 km from the origin, origins lifted by 1e-4
    const Vec3 x = glm::normalize(Vec3(normal(random), normal(random), normal(random))), y = anyPerpendicular(x),
               n = glm::cross(x, y);
    const Vec3 at = 1e4 * glm::normalize(Vec3(normal(random), normal(random), normal(random)));
    const glm::vec3 corner(at), u(Vec3(glm::vec3(at + x)) - Vec3(corner)), v(Vec3(glm::vec3(at + y)) - Vec3(corner));
    const glm::vec3 origin = corner + unit(random) * u + unit(random) * v + 1e-4f * glm::vec3(n);
    if (glm::dot(glm::vec3(n), origin - corner) <= 0) ++own;
  }
  EXPECT_NEAR(static_cast<double>(own) / kRays, 0.5, 0.1);
  auto box = closedBox({1, 2, 3});
  const Factors plain(box, "--patches 200 --method rays --rays 1024");
  double worst = 0;
  for (const double scale : {1e-6, 1e-3, 1e3, 1e6}) {
    Placement placement;
    placement.scale = scale;
    const Factors scaled(box, "--patches 200 --method rays --rays 1024", placement);
    for (const auto& [pair, value] : plain.f) {
      if (pair.second != "area") worst = std::max(worst, std::abs(scaled.f.at(pair) - value));
    }
  }
  Placement far;
  far.translation = Vec3(1e3, -2e3, 3e3) * 3.7;
  const Factors moved(box, "--patches 200 --method rays --rays 1024", far);
  for (const auto& [pair, value] : plain.f) worst = std::max(worst, std::abs(moved.f.at(pair) - value));
  EXPECT_LT(worst, 2e-3);
  tabulate(14, "scale 1e-6 to 1e6, 1000 sizes away",
           fmt::format("{:.0f} % of rays hit their own plane (offset 1e-4, 10 km away)", 100.0 * own / kRays),
           fmt::format("entries change by {:.1g} at most", worst), "");
}

// Failure 15. An element just in front of a tall wall: what lies before the near plane vanishes.
TEST(NearPlane, DoesNotClipTouchingWalls) {
  constexpr double kDistance = 0.001, kExact = 0.49992, kNear = 0.01;
  // The same element by rays, losing all that is nearer than the near plane of the hemicube face that shows it.
  std::mt19937 random(9);
  std::uniform_real_distribution<double> unit;
  int seen = 0;
  constexpr int kRays = 200000;
  for (int k = 0; k < kRays; ++k) {
    const double r = std::sqrt(unit(random)), angle = 2 * kPi * unit(random);
    const Vec3 d(r * std::cos(angle), r * std::sin(angle), std::sqrt(1 - r * r));
    if (d.x >= 0) continue;
    const Vec3 hit = d * (kDistance / -d.x);
    if (std::abs(hit.y) > 5 || hit.z > 10) continue;
    if (std::max({std::abs(hit.x), std::abs(hit.y), hit.z}) > kNear) ++seen;
  }
  EXPECT_NEAR(static_cast<double>(seen) / kRays, 0.0574, 0.01);
  constexpr double h = 5e-4;
  const std::vector<TestSurface> scene = {{"element", {rectangle(kDistance - h, -h, kDistance + h, h, 0)}},
                                          {"wall", {{{0, -5, 0}, {0, 5, 0}, {0, 5, 10}, {0, -5, 10}}}}};
  for (const char* method : {"raster --resolution 256 --near-field off", "rays --rays 65536"}) {
    const Factors f(scene, std::string("--patch-size 100 --method ") + method);
    EXPECT_NEAR(f("element", "wall"), kExact, 0.005) << method;
    if (std::string(method).starts_with("raster"))
      tabulate(15, "an element 1 mm in front of a wall", fmt::format("{:.3f} (near plane 0.01)", static_cast<double>(seen) / kRays),
               fmt::format("{:.4f} ({} is exact)", f("element", "wall"), kExact), "");
  }
}

// Failure 16. A corridor of 1000 m with a panel 5 mm in front of its end.
TEST(DepthPrecision, TellsAPanelFromTheWallBehindIt) {
  constexpr double kFar = 1000, kGap = 0.005;
  const double steps = std::pow(2.0, 24), nearPlane = 1e-3;
  const double resolved = kFar * kFar / (nearPlane * steps);  // of a 24-bit depth buffer, at the far end
  EXPECT_GT(resolved, kGap);
  const std::vector<TestSurface> scene = {{"element", {rectangle(0, 0, 1, 1, 0)}},
                                          {"panel", {flipped(rectangle(-50, -50, 51, 51, kFar - kGap))}},
                                          {"wall", {flipped(rectangle(-50, -50, 51, 51, kFar))}}};
  for (const char* method : {"raster --resolution 512", "rays --rays 65536"}) {
    const Factors f(scene, std::string("--patch-size 1000 --method ") + method);
    EXPECT_EQ(f("element", "wall"), 0) << method;
    EXPECT_GT(f("element", "panel"), 0.002) << method;
  }
  tabulate(16, "a panel 5 mm in front of a wall 1 km away", fmt::format("mixed: 24 bits resolve {:.0f} m there", resolved),
           "the wall is hidden", "");
}

}  // namespace
}  // namespace farol::test
