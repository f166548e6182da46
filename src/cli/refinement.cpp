#include "cli/refinement.h"

#include "cli/plan_rules.h"
#include "cli/sample_counts.h"

namespace farol {
namespace {

// By what some parts of an error must shrink so that the whole is below `target`: the largest alone, or the largest two or
// three by the same factor, where the others leave room for that. What is not to change is 1.
struct Shrink {
  double patches = 1, rows = 1, light = 1;
};
Shrink shrinkTo(double target, const ErrorParts& found, bool patchesFixed, bool rowsFixed, bool lightFixed) {
  constexpr double kRoom = 0.3;  // of the target's square
  Shrink shrink;
  struct Part {
    double error;
    double* factor;
  };
  std::vector<Part> parts;
  if (!patchesFixed) parts.push_back({found.patches, &shrink.patches});
  if (!rowsFixed) parts.push_back({found.rows, &shrink.rows});
  if (!lightFixed) parts.push_back({found.light, &shrink.light});
  std::sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) { return a.error > b.error; });
  double rest = found.total() * found.total(), some = 0;
  for (size_t k = 0; k < parts.size() && parts[k].error > 0; ++k) {
    rest -= parts[k].error * parts[k].error;
    some += parts[k].error * parts[k].error;
    const double left = std::max(target * target - rest, kRoom * target * target);
    for (size_t j = 0; j <= k; ++j) *parts[j].factor = std::min(1.0, std::sqrt(left / some));
    if (target * target - rest >= kRoom * target * target) break;
  }
  return shrink;
}

}  // namespace

TolerancePlan refined(const TolerancePlan& plan, const Options& options, const FacetSet& facets, const ErrorParts& found,
                      bool careful) {
  constexpr double kCareful = 0.65;
  TolerancePlan next = plan;
  const bool rowsFixed = givesSamples(options, plan.setting.spec);
  const bool patchesFixed = !plan.adapted && options.gave("--patches");
  const Shrink shrink =
      shrinkTo((careful ? kCareful : kMargin) * options.tolerance, found, patchesFixed, rowsFixed, options.gave("--shadow-rays"));
  if (shrink.rows < 1) scaleSamples(next.setting.spec, std::pow(shrink.rows, -1 / orderOf(plan.setting.spec)) * 1.1);
  if (shrink.light < 1)
    next.setting.shadowRays =
        evenCount(worthOf(plan.setting.shadowRays) * std::pow(shrink.light, -1 / kSampleOrder) * 1.1, kLeastShadowRays, kMostRays);
  if (plan.adapted && shrink.patches < 1) {
    next.adapt = rounded(plan.adapt * shrink.patches / 1.05, 2);
    next.adapted.reset();
  } else if (shrink.patches < 1) {
    constexpr double kOrder = 1.5;
    const double smaller = std::pow(shrink.patches, 1 / kOrder) / 1.05;
    next.size.size = rounded((plan.size.size > 0 ? plan.size.size : sizeForPatches(facets, plan.size.count)) * smaller);
    next.size.count = 0;
  }
  return next;
}

void adaptInstead(TolerancePlan& next, const TolerancePlan& plan, const Options& options, const Scene& scene,
                  const FacetSet& facets, const ErrorParts& found, size_t patches) {
  if (plan.adapted || plan.size.cluster > 0 || plan.size.size <= next.size.size || !mayAdapt(options)) return;
  const double ofOneSize = static_cast<double>(patches) * std::pow(plan.size.size / next.size.size, 2);
  const Options adapting = adaptingOptions(options, next.setting);
  const AdaptTrial trial = adaptTrialOf(adapting, scene, facets, next.setting.spec);
  if (trial.level == 0 ||
      static_cast<double>(trial.patches) * samplesOf(trial.setting.spec) > kWorthATrial * ofOneSize * samplesOf(next.setting.spec))
    return;
  const Adapting a = adaptTo(adapting, scene, facets, next.setting.spec);
  if (!isUsable(a, adapting, scene, facets) || static_cast<double>(a.adapted.patches) > kWorthAdapting * ofOneSize) return;
  // What these cost their trial has told: samples need not make up for patches that are not known.
  ErrorParts expected = found;
  expected.patches = adapting.adapt;
  next.setting = refined(plan, options, facets, expected).setting;
  next.size = a.size;
  next.adapt = adapting.adapt;
  next.adapted = a;
}

std::vector<Choice> takeRefined(TolerancePlan& plan, const TolerancePlan& before, const ErrorParts& found, size_t patches) {
  std::vector<Choice> changed;
  for (Choice& c : plan.choices) {
    std::string value = c.value;
    double cost = 0;
    if (c.what == "patches" && (plan.size.size != before.size.size || plan.adapt != before.adapt)) {
      value = patchesText(plan, static_cast<double>(patches));
      cost = found.patches;
    } else if (c.what == "method") {
      value = methodText(plan.setting.spec);
      cost = found.rows;
    } else if (c.what == "shadow rays") {
      value = fmt::format("{}", plan.setting.shadowRays);
      cost = found.light;
    }
    if (value == c.value) continue;
    c = {c.what, value, fmt::format("refined: {} cost {:.2g} %", c.value, 100 * cost)};
    changed.push_back(c);
  }
  return changed;
}

}  // namespace farol
