#include "cli/warnings.h"

#include "patch/overlaps.h"

#include <fmt/format.h>
#include <map>

namespace farol {
namespace {

// The surfaces that miss most, at most four.
std::vector<std::string> leakingSurfaces(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene) {
  std::map<std::string, double> missed;
  for (size_t i = 0; i < patches.size(); ++i)
    missed[surfaceNameOf(scene, patches.patches[i])] += patches.patches[i].area * f.shares(i).missed;
  std::vector<std::pair<double, std::string>> sorted;
  sorted.reserve(missed.size());
  for (const auto& [name, share] : missed) sorted.emplace_back(share, name);
  std::sort(sorted.rbegin(), sorted.rend());
  std::vector<std::string> names;
  for (size_t k = 0; k < std::min<size_t>(4, sorted.size()); ++k) {
    if (sorted[k].first > 0) names.push_back(sorted[k].second);
  }
  return names;
}

}  // namespace

// Pairs of surfaces once each.
void warnOfOverlaps(const Scene& scene, const FacetSet& facets, double totalArea, Log& log) {
  constexpr size_t kMost = 1000, kNamed = 8;
  std::map<std::pair<std::string, std::string>, double> area;
  for (const Overlap& o : findOverlaps(facets, kMost)) {
    const auto nameOf = [&](uint32_t facet) { return scene.surfaces[facets.facets[facet].surface].name; };
    area[{nameOf(o.first), nameOf(o.second)}] += o.area * facets.frame.size * facets.frame.size;
  }
  size_t named = 0;
  for (const auto& [pair, both] : area) {
    if (++named > kNamed) break;
    log.warn(
        {"overlapping-faces",
         pair.first == pair.second
             ? fmt::format(
                   "faces of surface '{}' lie on each other over {:.3g} square units: which of them is seen there is arbitrary",
                   pair.first, both)
             : fmt::format("surfaces '{}' and '{}' lie in one plane, face one way and overlap over {:.3g} square units: which of "
                           "them is seen there is "
                           "arbitrary",
                           pair.first, pair.second, both),
         pair.first == pair.second ? std::vector{pair.first} : std::vector{pair.first, pair.second}, both / totalArea});
  }
}

void warnOfBrokenRules(const FormFactorChecks& c, const FormFactorMatrix& f, const ErrorModel& model, const PatchSet& patches,
                       const Scene& scene, Log& log) {
  if (c.correctionMin < 0.8 || c.correctionMax > 1.25) {
    log.warn({"near-field",
              fmt::format("the near-field correction scaled entries by {:.3f} to {:.3f}: outside 0.8 to 1.25 one "
                          "position does not do; use --positions or --method rays",
                          c.correctionMin, c.correctionMax),
              {},
              std::max(c.correctionMax - 1, 1 - c.correctionMin)});
  }
  if (c.smallest < 0 || c.largest > 1 + 1e-6) {
    log.warn(
        {"impossible-factor", fmt::format("form factors reach from {:.6g} to {:.6g}; 0 to 1 is possible", c.smallest, c.largest)});
  }
  // Rows of a closed scene miss nothing; a little is a gap between surfaces, where light leaks.
  constexpr double kLeast = 1e-6, kLeak = 0.01;
  if (c.missed > kLeast && c.missed < kLeak) {
    log.warn({"small-leak",
              fmt::format(
                  "{:.2g} % of what patches see lies outside the scene: where it should be closed, there are gaps between surfaces",
                  100 * c.missed),
              leakingSurfaces(f, patches, scene), c.missed});
  }
  if (c.worstArea <= 1) return;
  const Patch &from = patches.patches[c.worstFrom], &to = patches.patches[c.worstTo];
  const double entry = f[c.worstFrom].at(c.worstTo), spread = 4 * model.entryError(entry);
  if (entry > 0 && c.worstArea * (1 - spread / entry) > 1 + 1e-6) {
    log.warn(
        {"too-much-sent",
         fmt::format("patch {} on '{}' sends {:.3g} times what can reach patch {} on '{}': more than the estimated error explains",
                     c.worstFrom, surfaceNameOf(scene, from), c.worstArea, c.worstTo, surfaceNameOf(scene, to)),
         {surfaceNameOf(scene, from), surfaceNameOf(scene, to)},
         c.worstArea - 1});
  }
}

// A reciprocal F keeps power; what is lost or gained tells of one that is not.
void warnOfDrift(const EnergyBalance& energy, const Solution& solution, Log& log) {
  constexpr double kDrift = 0.02;
  if (energy.relativeError > kDrift && solution.converged) {
    log.warn({"energy-drift",
              fmt::format(
                  "absorbed, lost and emitted power differ by {:.2g} %: F is not reciprocal enough; use more --rays or --positions",
                  100 * energy.relativeError),
              {},
              energy.relativeError});
  }
}

// What little is absorbed decides the solution: errors of F are multiplied.
void warnOfSlowLight(const Solution& solution, Log& log) {
  constexpr double kRoom = 0.02;
  const double bound = solution.bound;
  if (bound > 1 - kRoom && bound < 1) {
    log.warn({"slow-light",
              fmt::format("reflectance times row sum reaches {:.4f}: light is reflected {:.0f} times on average there, and "
                          "so often errors of F come back",
                          bound, 1 / (1 - bound)),
              {},
              1 / (1 - bound)});
  }
}

}  // namespace farol
