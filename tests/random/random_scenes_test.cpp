// Random valid scenes: whatever the scene, rows account for all light, power is kept, and the answer does not depend on where
// the scene stands, how large it is, or how its surfaces are named and ordered. FAROL_RANDOM_SCENES=N makes N scenes instead of
// 50, FAROL_RANDOM_FIRST=S starts at seed S; a failure names its seed.
#include "specular_cases.h"

#include <cstdlib>
#include <fmt/format.h>
#include <random>

namespace farol::test {
namespace {

class Dice {
 public:
  explicit Dice(uint64_t seed) : engine_(seed) {}
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
  bool chance(double p) { return between(0, 1) < p; }
  int upTo(int most) { return std::uniform_int_distribution<int>(0, most)(engine_); }
  Rgb colour(double most) { return {between(0, most), between(0, most), between(0, most)}; }

 private:
  std::mt19937_64 engine_;
};

void paint(Dice& dice, TestSurface& s) {
  s.reflectance = dice.chance(0.3) ? Rgb(dice.between(0, 0.9)) : dice.colour(0.9);
  if (dice.chance(0.2)) {
    s.mirror = Rgb(dice.between(0, 0.95));  // one F for all channels keeps this quick
    s.reflectance *= 0.99 * (1 - s.mirror.r);
  }
  if (dice.chance(0.15)) s.emission = dice.colour(10);
}

// A box from corner to corner, faces outwards or inwards.
void addBox(Dice& dice, const std::string& name, const Vec3& low, const Vec3& high, bool inwards, std::vector<TestSurface>& scene) {
  auto faces = closedBox(high - low);
  for (TestSurface& face : faces) {
    for (Vec3& p : face.polygons[0]) p += low;
    if (!inwards) std::reverse(face.polygons[0].begin(), face.polygons[0].end());
    face.name = name + face.name;
    paint(dice, face);
    scene.push_back(face);
  }
}

std::vector<TestSurface> randomScene(uint64_t seed) {
  Dice dice(seed);
  std::vector<TestSurface> scene;
  const Vec3 size(dice.between(1, 10), dice.between(1, 10), dice.between(1, 10));
  addBox(dice, "room", Vec3(0), size, true, scene);
  if (dice.chance(0.3)) scene.erase(scene.begin() + dice.upTo(5));  // an open side
  for (int k = dice.upTo(3); k > 0; --k) {  // boxes that may touch walls and each other, and stand in each other
    const Vec3 low = size * Vec3(dice.between(0, 0.7), dice.between(0, 0.7), dice.chance(0.5) ? 0 : dice.between(0, 0.2));
    addBox(dice, fmt::format("box{}", k), low,
           low + size * Vec3(dice.between(0.05, 0.29), dice.between(0.05, 0.29), dice.between(0.05, 0.29)), false, scene);
  }
  // One loose triangle, sometimes a sliver, above the boxes: sheets that pierce boxes or each other have parts that count as
  // covered or not by a few rays.
  for (int k = dice.upTo(1); k > 0; --k) {
    const auto corner = [&] { return size * Vec3(dice.between(0.1, 0.9), dice.between(0.1, 0.9), dice.between(0.5, 0.9)); };
    TestSurface t{fmt::format("triangle{}", k), {{corner(), corner(), corner()}}};
    if (dice.chance(0.3))
      t.polygons[0][2] =
          t.polygons[0][0] + 1e-4 * (t.polygons[0][2] - t.polygons[0][0]) + 0.5 * (t.polygons[0][1] - t.polygons[0][0]);
    t.twoSided = dice.chance(0.5);
    paint(dice, t);
    t.emission = Rgb(0);  // few rays meet a needle: with its light in F nothing but noise would be left
    if (t.twoSided && dice.chance(0.3)) {
      t.reflectance = t.mirror = Rgb(0);
      t.transmission = Rgb(dice.between(0.2, 1));
    }
    scene.push_back(t);
  }
  if (std::none_of(scene.begin(), scene.end(), [](const TestSurface& s) { return maxChannel(s.emission) > 0; }))
    scene[0].emission = Rgb(1);
  return scene;
}

struct Solved {
  Solved(const std::vector<TestSurface>& surfaces, uint64_t seed, const Placement& placement = {})
      : run(loadSurfaces(surfaces, placement), {60, 0}, [&] {
          RayOptions o;
          o.rays = 512;
          o.seed = seed;
          return o;
        }()) {
    run.makeAll();
    SolveOptions options;
    options.residual = 1e-7;
    solution = solveRadiosity(run.f, run.patches, {}, run.scene, options, Log(true));
    for (size_t i = 0; i < run.patches.size(); ++i) {
      const Patch& p = run.patches.patches[i];
      const double a = p.area * run.f.shares(i).exposed;
      auto& [h, area] = bySurface[surfaceNameOf(run.scene, p)];
      h += a * solution.irradiance[i];
      area += a;
    }
  }
  RayRun run;
  Solution solution;
  std::map<std::string, std::pair<Rgb, double>> bySurface;  // sum of A H, A
};

// Area-weighted rms difference of the surfaces' mean irradiances, relative to their mean; areas are scaled by `scale`.
double difference(const Solved& a, const Solved& b, double scale = 1, const std::map<std::string, std::string>& renamed = {}) {
  double squares = 0, area = 0, whole = 0;
  Rgb total(0);
  for (const auto& [name, sums] : a.bySurface) whole += sums.second;
  for (const auto& [name, sums] : a.bySurface) {
    const auto other = renamed.find(name);
    const auto found = b.bySurface.find(other == renamed.end() ? name : other->second);
    if (found == b.bySurface.end()) continue;  // a sliver at the limit of what is left out
    const auto& [h, covered] = found->second;
    if (sums.second <= 0 || covered <= 0) continue;
    const Rgb d = sums.first / sums.second - h / covered;
    squares += sums.second * maxChannel(d * d);
    total += sums.first;
    area += sums.second;
    EXPECT_NEAR(covered / (scale * scale), sums.second, 0.1 * sums.second + 0.01 * whole) << name << ": exposed area";
  }
  return total == Rgb(0) ? 0 : std::sqrt(squares / area) / (maxChannel(total) / area);
}

// A_S F_ST = A_T F_TS for surfaces, to the noise of their rays: a ray of a patch carries a power of A / K.
void expectReciprocal(const Solved& s, const std::string& what) {
  std::map<std::pair<std::string, std::string>, double> power;  // sum of A F
  std::map<std::string, double> perRay;
  for (size_t i = 0; i < s.run.patches.size(); ++i) {
    const Patch& from = s.run.patches.patches[i];
    const std::string name = surfaceNameOf(s.run.scene, from);
    const double a = from.area * s.run.f.shares(i).exposed;
    perRay[name] = std::max(perRay[name], from.area / s.run.options.rays);
    s.run.f[i].forEach([&](size_t j, double f) { power[{name, surfaceNameOf(s.run.scene, s.run.patches.patches[j])}] += a * f; });
  }
  for (const auto& [pair, there] : power) {
    const auto found = power.find({pair.second, pair.first});
    const double back = found == power.end() ? 0 : found->second, ray = perRay[pair.first] + perRay[pair.second];
    constexpr double kSigmas = 6;
    EXPECT_NEAR(there, back, kSigmas * std::sqrt(std::max(there, back) * ray) + 2 * ray)
        << what << ": " << pair.first << " to " << pair.second;
  }
}

TEST(RandomScenes, KeepWhatMustBeKept) {
  const auto number = [](const char* name, uint64_t usual) {
    const char* text = std::getenv(name);
    return text != nullptr ? std::strtoull(text, nullptr, 10) : usual;
  };
  const uint64_t first = number("FAROL_RANDOM_FIRST", 1), count = number("FAROL_RANDOM_SCENES", 50);
  double worstBalance = 0;
  for (uint64_t seed = first; seed < first + count; ++seed) {
    const std::string what = fmt::format("seed {}", seed);
    SCOPED_TRACE(what);
    const std::vector<TestSurface> scene = randomScene(seed);
    const Solved here(scene, seed), again(scene, seed + 1000000);
    expectAccounted(here.run, what);
    for (const Rgb& b : here.solution.radiosity) ASSERT_TRUE(minChannel(b) >= 0 && std::isfinite(maxChannel(b)));
    EXPECT_TRUE(here.solution.converged);
    expectReciprocal(here, what);
    const double noise = std::max(difference(here, again), 0.01);
    const double balance = energyBalance(here.run.f, here.run.patches, here.solution, Rgb(0)).relativeError;
    worstBalance = std::max(worstBalance, balance);
    EXPECT_LT(balance, 8 * noise);

    Dice dice(seed + 1);
    constexpr double kLikely = 5;
    Placement placement;
    placement.rotation = generalRotation();
    placement.translation = Vec3(dice.between(-100, 100), dice.between(-100, 100), dice.between(-100, 100));
    EXPECT_LT(difference(here, Solved(scene, seed, placement)), kLikely * noise) << "moved";
    Placement scaled;
    scaled.scale = std::pow(10, dice.between(-6, 6));
    EXPECT_LT(difference(here, Solved(scene, seed, scaled), scaled.scale), kLikely * noise) << "scaled by " << scaled.scale;
    std::vector<TestSurface> other(scene.rbegin(), scene.rend());
    std::map<std::string, std::string> renamed;
    for (size_t k = 0; k < other.size(); ++k) {
      const std::string name = fmt::format("s{}", k);
      renamed[other[k].name] = name;
      renamed[other[k].name + "~back"] = name + "~back";
      other[k].name = name;
    }
    EXPECT_LT(difference(here, Solved(other, seed), 1, renamed), kLikely * noise) << "renamed and in another order";
    if (::testing::Test::HasFailure()) {
      fmt::print("{}", gltfOf(scene).dump());
      break;
    }
  }
  fmt::print("{} scenes from seed {}: energy balanced within {:.2g} %\n", count, first, 100 * worstBalance);
}

}  // namespace
}  // namespace farol::test
