#include "light/lamps.h"

#include <algorithm>
#include <fmt/format.h>
#include <map>
#include <numeric>

namespace farol {
namespace {

constexpr double kLargestShare = 0.05;  // of all area, apart
constexpr size_t kMostLamps = 256;
constexpr double kSecondsPerLamp = 1e-6;  // closed form at the points of one patch
constexpr double kSecondsPerRay = 3e-8;
// What a shadow ray leaves of the square of a lamp's irradiance, on average over patches of which few see it partly, and
// the variance of R over a row relative to the square of its mean: both only weigh terms that are small wherever the
// choice is clear.
constexpr double kPenumbra = 0.02, kReflectedVariance = 0.1;

Lamp lampOf(std::vector<Vec3> polygon, const Vec3& normal, const Rgb& emission, const std::pair<uint32_t, bool>& side) {
  const bool back = side.second;
  if (back) std::reverse(polygon.begin(), polygon.end());
  Lamp lamp;
  lamp.normal = back ? -normal : normal;
  lamp.emission = emission;
  lamp.facet = side.first;
  for (const Vec3& p : polygon) lamp.centre += p / static_cast<double>(polygon.size());
  for (size_t k = 1; k + 1 < polygon.size(); ++k)
    lamp.area += 0.5 * glm::length(glm::cross(polygon[k] - polygon[0], polygon[k + 1] - polygon[0]));
  for (const Vec3& p : polygon) lamp.radius = std::max(lamp.radius, glm::distance(p, lamp.centre));
  lamp.polygon = std::move(polygon);
  return lamp;
}

struct Emitter {
  std::vector<Lamp> lamps;
  std::vector<uint32_t> patches;
  double area = 0, squares = 0;  // sum of A, of A E^2 (luminance) [scene units]
  double flux = 0;               // sum of A E
  double brightest = 0;
};

// One emitter per side of a facet that has emission; one lamp, or one per cell where emission varies.
std::vector<Emitter> findEmitters(const FacetSet& facets, const PatchSet& patches) {
  std::map<std::pair<uint32_t, bool>, std::vector<uint32_t>> bySide;
  for (uint32_t p = 0; p < patches.size(); ++p) {
    if (!patches.patches[p].emits()) continue;
    for (const uint32_t c : patches.cellsOf(p)) bySide[{patches.cells[c].facet, patches.cells[c].back}].push_back(c);
  }
  std::vector<Emitter> emitters;
  for (const auto& [side, cells] : bySide) {
    const Facet& facet = facets.facets[side.first];
    const CellGrid& grid = patches.grids[side.first];
    Emitter e;
    const Rgb first = patches.patches[patches.cellMap[cells[0]]].emission;
    bool uniform = cells.size() == grid.count(facet.parallelogram);
    for (const uint32_t c : cells) {
      const uint32_t p = patches.cellMap[c];
      const Rgb emission = patches.patches[p].emission;
      const double area = cellArea(facets, grid, side.first), bright = luminance(emission);
      uniform = uniform && maxChannel(glm::abs(emission - first)) <= 1e-9 * maxChannel(first);
      e.patches.push_back(p);
      e.area += area;
      e.squares += area * bright * bright;
      e.flux += area * bright;
      e.brightest = std::max(e.brightest, bright);
    }
    if (uniform) {
      std::vector<Vec3> polygon;
      for (size_t k = 0; k < facet.cornerCount(); ++k) polygon.push_back(facets.points[facet.corners[k]]);
      e.lamps.push_back(lampOf(std::move(polygon), facet.normal, first, side));
    } else {
      for (const uint32_t c : cells) {
        const auto corner = [&](double s, double t) {
          const Vec2 uv = cellPoint(grid, facet.parallelogram, patches.cells[c], s, t);
          return facets.point(facet, uv.x, uv.y);
        };
        std::vector<Vec3> polygon = {corner(0, 0), corner(1, 0)};
        if (facet.parallelogram) polygon.push_back(corner(1, 1));
        polygon.push_back(corner(0, 1));
        e.lamps.push_back(lampOf(std::move(polygon), facet.normal, patches.patches[patches.cellMap[c]].emission, side));
      }
    }
    emitters.push_back(std::move(e));
  }
  std::stable_sort(emitters.begin(), emitters.end(), [](const Emitter& a, const Emitter& b) { return a.brightest > b.brightest; });
  return emitters;
}

}  // namespace

LampPlan chooseLamps(const FacetSet& facets, const PatchSet& patches, const LampBudget& budget) {
  LampPlan plan;
  plan.apart.assign(patches.size(), 0);
  std::vector<Emitter> emitters = findEmitters(facets, patches);
  for (const Emitter& e : emitters) plan.emitters += e.lamps.size();
  if (emitters.empty()) {
    plan.why = "no surface emits";
    return plan;
  }
  double area = 0, reflectance = 0, flux = 0, squares = 0;
  for (const Patch& p : patches.patches) {
    if (p.back && !p.emits()) continue;
    area += p.area;
    reflectance += p.area * luminance(p.reflectance);
  }
  for (const Emitter& e : emitters) {
    flux += e.flux / area;
    squares += e.squares / area;
  }
  const double rho = std::min(reflectance / area, 0.95), reflected = flux * rho / (1 - rho);
  const double background = kReflectedVariance * reflected * reflected;
  double leftFlux = flux, leftSquares = squares, share = 0, apartVariance = 0;
  size_t lamps = 0, best = 0;
  const double before = (squares - flux * flux + background) * budget.secondsPerRow;
  double lowest = before;
  for (size_t k = 0; k < emitters.size(); ++k) {
    const Emitter& e = emitters[k];
    share += e.area / area;
    lamps += e.lamps.size();
    if (share > kLargestShare || lamps > kMostLamps) break;
    leftFlux -= e.flux / area;
    leftSquares -= e.squares / area;
    apartVariance += (e.flux / area) * (e.flux / area) * kPenumbra * budget.samplesPerRow / budget.shadowRays;
    const double left = std::max(0.0, leftSquares - leftFlux * leftFlux);
    const double product =
        (left + background + apartVariance) *
        (budget.secondsPerRow + static_cast<double>(lamps) * kSecondsPerLamp + budget.shadowRays * kSecondsPerRay);
    // Emitters of one brightness go together: a set that ends between two of them is not a better choice.
    const bool endsGroup = k + 1 == emitters.size() || emitters[k + 1].brightest < 0.99 * e.brightest;
    if (endsGroup && product < lowest) {
      lowest = product;
      best = k + 1;
    }
  }
  double apartArea = 0;
  for (size_t k = 0; k < best; ++k) {
    apartArea += emitters[k].area;
    for (const uint32_t p : emitters[k].patches) plan.apart[p] = 1;
    for (Lamp& lamp : emitters[k].lamps) plan.lamps.push_back(std::move(lamp));
  }
  plan.why = best > 0 ? fmt::format("{} of {} emitters apart ({:.2g} % of the area): predicted variance x time {:.2g} of all in F",
                                    plan.lamps.size(), plan.emitters, 100 * apartArea / area, lowest / before)
                      : fmt::format("all {} emitters in F: {:.2g} % of the area emits, which rows sample well", plan.emitters,
                                    100 * std::accumulate(emitters.begin(), emitters.end(), 0.0, [](double a, const Emitter& e) {
                                      return a + e.area;
                                    }) / area);
  return plan;
}

}  // namespace farol
