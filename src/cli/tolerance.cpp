#include "cli/tolerance.h"

#include "base/error.h"
#include "base/machine.h"
#include "cli/choices.h"
#include "cli/plan_rules.h"
#include "cli/sample_counts.h"

namespace farol {
namespace {

using Kind = MethodSpec::Kind;

constexpr size_t kProbes = 192;
constexpr size_t kFewTried = 450, kMostTried = 12000;  // patches of a trial
constexpr double kUsualTolerance = 0.05;               // that a trial of few patches and rays is for
constexpr double kTight = 0.03;                        // below it a trial is larger
constexpr uint32_t kPictureRays = 256;                 // grain of every patch, and edges of shadows

class Planner {
 public:
  Planner(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method)
      : options_(options), scene_(scene), facets_(facets), tolerance_(options.tolerance) {
    plan_.setting.spec = method;
    plan_.setting.emittersApart = options.emittersApart;
    plan_.setting.solver = options.solver;
    plan_.setting.shadowRays = options.shadowRays;
    plan_.setting.residual = options.residual;
    if (!options.gave("--residual")) plan_.setting.residual = rounded(std::clamp(0.03 * tolerance_, 1e-5, 1e-2));
    given_ = plan_.setting;
  }

  TolerancePlan plan() {
    // Coarser trials cannot see shadows; finer ones cost more than they tell.
    const size_t count = tolerance_ >= kTight ? kFewTried : tolerance_ >= 0.004 ? 1000 : 2500;
    considerClusters(count);
    if (!triedEnough(count)) chooseFrom(count);
    if (!plan_.adapted) considerAdapting();
    plan_.choosing = watch_.seconds();
    // Rows made again to tell the error, and what no scene is too small for.
    constexpr double kAgain = 1.1, kLeastSeconds = 0.006;
    plan_.seconds = plan_.choosing + kAgain * plan_.seconds + kLeastSeconds;
    plan_.rowSeconds = kAgain * patches_ * samplesOf(plan_.setting.spec) * trial_.perSample;
    explain();
    return plan_;
  }

 private:
  bool fixedPatches() const { return options_.gave("--patches"); }
  double givenPatches() const {
    return static_cast<double>(options_.patches > kMostTried ? std::max(options_.patches, trial_.patches) : trial_.patches);
  }
  bool fixedSamples() const { return givesSamples(options_, plan_.setting.spec); }
  bool fixedShadow() const { return options_.gave("--shadow-rays"); }

  // Whether facets are so many and small that gathering them leaves much fewer patches. A hemicube takes a bent patch for flat, an
  // error that nothing tells: by rays only.
  void considerClusters(size_t count) {
    constexpr size_t kMany = 1500;
    constexpr double kTurn = 15, kWorth = 0.7;  // [degrees]; of the patches without
    cluster_ = options_.cluster;
    if (cluster_ > 0 || plan_.setting.spec.kind != Kind::rays || options_.gave("--cluster") || fixedPatches() ||
        options_.patchSize > 0 || facets_.facets.size() < kMany)
      return;
    const auto patches = [&](double turn) {
      return static_cast<double>(buildPatches(scene_, facets_, {count, 0, 0, turn}).size());
    };
    if (patches(kTurn) < kWorth * patches(0)) cluster_ = kTurn;
  }

  // A trial of few patches and rays before a larger one: whether that shows light so even that it errs far less than asked for, or
  // what it chooses costs less than the larger one.
  bool triedEnough(size_t count) {
    constexpr double kEasily = 0.2;
    if (tolerance_ >= kTight || cluster_ > 0 || fixedPatches() || options_.patchSize > 0) return false;
    measure(kFewTried, kUsualTolerance);
    choose();
    return trial_.errorFor(static_cast<double>(trial_.patches), trial_.setting).total() < kEasily * tolerance_ ||
           plan_.seconds < trial_.secondsFor(static_cast<double>(count), trialFor(tolerance_));
  }

  // From a trial of so many patches, and of more where many more are wanted than were tried, unless that takes long beside patches
  // of several sizes.
  void chooseFrom(size_t count) {
    constexpr size_t kFar = 6;
    constexpr double kLong = 0.12;
    for (int round = 0; round < 3; ++round) {
      measure(count, tolerance_);
      choose();
      const auto wanted = static_cast<size_t>(patches_);
      if (fixedPatches() || wanted < kFar * trial_.patches || trial_.patches >= kMostTried) break;
      count = std::min(kMostTried, wanted / 2);
      const double more = trial_.secondsFor(static_cast<double>(count), trial_.setting);
      if (considerAdapting() && more > kLong * plan_.seconds) break;
    }
  }

  double sizeFor(double n) const {
    return cluster_ > 0 ? trialSize_ * std::pow(n / static_cast<double>(trial_.patches), -1 / trial_.perSize)
                        : sizeForPatches(facets_, static_cast<size_t>(n));
  }

  // Samples for a trial, by what a tolerance is likely to need.
  Setting trialFor(double tolerance) const {
    Setting trial = given_;
    constexpr double kUsualRays = 64;
    const double rays = std::clamp(kUsualRays * kUsualTolerance / tolerance, 32.0, 1024.0);
    if (!fixedSamples()) {
      trial.spec.rays = evenCount(rays / 1.5, 32, 1024);
      trial.spec.resolution = tolerance < 0.005 ? 64 : 32;
      if (!options_.gave("--positions")) trial.spec.positions = 1;
    }
    if (!fixedShadow()) trial.shadowRays = std::max(16u, trial.spec.rays / 4);
    return trial;
  }

  // A trial of so many patches.
  void measure(size_t count, double tolerance) {
    const auto sized = [&](size_t patches) {
      return cluster_ > 0 ? sizeForClusters(facets_, patches) : sizeForPatches(facets_, patches);
    };
    PatchOptions size{count, 0, 0, cluster_};
    if (fixedPatches()) {
      size.count = std::min(options_.patches, kMostTried);
    } else if (options_.patchSize > 0) {
      size.size = std::min(options_.patchSize, sized(count));
    }
    if (cluster_ > 0 && size.size == 0) size.size = sized(size.count);
    const Setting trial = trialFor(tolerance);
    if (!fixedPatches()) {  // no more than memory holds
      constexpr double kRoom = 0.5, kLeast = 50;
      double held = static_cast<double>(count);
      while (held > kLeast && trial_.bytesFor(held, trial) > kRoom * static_cast<double>(allowedBytes(options_))) held /= 1.5;
      if (held < static_cast<double>(count))
        size.size = std::min(size.size > 0 ? size.size : 1e300, sized(static_cast<size_t>(held)));
    }
    SizedScene scene(options_, scene_, facets_, size);
    trial_.channels = scene.patches().colouredSpecular() ? 3 : 1;
    const Trial t = scene.solve(trial, kProbes);
    trial_.setting = trial;
    trial_.images = scene.lightings().imagesWanted(t.lighting.plan, scene_, scene.patches());
    trial_.patches = scene.patches().size();
    trial_.rowError = t.rowError;
    trial_.lightError = t.lightError;
    lampsWhy_ = t.lighting.plan.why;
    trial_.sweeps = t.lighting.solution.sweeps;
    if (cluster_ > 0) {
      trialSize_ = size.size;
      PatchOptions half = size;
      half.size /= 2;
      trial_.perSize = std::clamp(std::log2(static_cast<double>(buildPatches(scene_, facets_, half).frontPatchCount) /
                                            static_cast<double>(scene.patches().frontPatchCount)),
                                  0.2, 2.0);
      trial_.patchError = gatheredPatchErrorOf(t.f, scene.patches(), scene_, facets_, t.lighting, size);
    } else {
      trial_.patchError = patchErrorOf(t.f, scene.patches(), facets_, t.lighting);
    }
    trial_.fronts = static_cast<double>(scene.patches().frontPatchCount) / static_cast<double>(trial_.patches);
    trial_.learnCosts(t);
  }

  // The cheapest of some numbers of patches, each with the samples that its error leaves room for: its seconds, and `patches_`; -1
  // where memory holds none that meets the target.
  double cheapest(const std::vector<double>& counts, double target, Setting& cheapestSetting) {
    double best = -1;
    for (const double n : counts) {
      Setting s = trial_.setting;
      const double left = target * target - std::pow(trial_.errorFor(n, s).patches, 2) - s.residual * s.residual;
      const bool last = n == counts.back();
      if (left <= 0.05 * target * target && !last) continue;
      setSamples(s, std::sqrt(std::max(left, 0.05 * target * target)));
      if (!fits(n, s)) continue;
      const double seconds = trial_.secondsFor(n, s);
      const bool meets = trial_.errorFor(n, s).total() <= std::max(tolerance_, target) || fixedSamples() || fixedShadow() || last;
      if (meets && (best < 0 || seconds < best)) {
        best = seconds;
        cheapestSetting = s;
        patches_ = n;
      }
    }
    return best;
  }

  void choose() {
    // What is given may cost more than the tolerance: the rest need not be much better then.
    constexpr double kAboveGiven = 1.1;
    const ErrorParts now = trial_.errorFor(fixedPatches() ? givenPatches() : static_cast<double>(trial_.patches), trial_.setting);
    const double given = std::sqrt((fixedSamples() ? now.rows * now.rows : 0) + (fixedShadow() ? now.light * now.light : 0) +
                                   (fixedPatches() ? now.patches * now.patches : 0));
    const double target = std::max(kMargin * tolerance_, kAboveGiven * given);
    const double smallest = static_cast<double>(buildCount(1));
    std::vector<double> counts;
    if (fixedPatches()) {
      counts = {givenPatches()};
    } else {
      // Coarser than the trial nothing is known about edges, and little is saved, unless patches cost next to nothing.
      constexpr double kCoarser = 0.5, kNothing = 0.35;
      const auto tried = static_cast<double>(trial_.patches);
      const bool coarser = trial_.errorFor(kCoarser * tried, trial_.setting).patches < kNothing * target;
      const double floor = std::max(
          {smallest, coarser ? kCoarser * tried : tried, wantsPicture(options_) ? static_cast<double>(kPicturePatches) : 100.0});
      const double largest = 2e6;
      const double least = options_.patchSize > 0 ? static_cast<double>(trial_.patches) : floor;
      counts.push_back(std::max(least, floor));
      while (counts.back() * 1.2 <= largest) counts.push_back(counts.back() * 1.2);
    }
    // Where memory does not hold what meets the target: the least error that it holds, or nearly.
    constexpr double kNext = 1.1, kMost = 1;
    Setting bestSetting;
    double best = -1, aim = target;
    while ((best = cheapest(counts, aim, bestSetting)) < 0 && aim < kMost) aim *= kNext;
    plan_.limitedBy.clear();
    plan_.adapted.reset();
    plan_.adapt = 0;
    if (best < 0) {  // not even the trial's patches fit
      patches_ = std::max(smallest, 100.0);
      bestSetting = trial_.setting;
      while (fits(patches_ * 1.2, bestSetting) && patches_ < 1e6) patches_ *= 1.2;
      best = trial_.secondsFor(patches_, bestSetting);
    }
    if (options_.time > 0) limitTime(bestSetting, best);
    plan_.setting = bestSetting;
    plan_.seconds = best;
    plan_.predicted = trial_.errorFor(patches_, bestSetting);
    if (plan_.limitedBy.empty() && plan_.predicted.total() > tolerance_)
      plan_.limitedBy = aim > target ? "memory" : "the options given";
    plan_.size =
        fixedPatches() ? PatchOptions{options_.patches, 0, 0, cluster_} : PatchOptions{0, rounded(sizeFor(patches_)), 0, cluster_};
  }

  // Patches as small as their light asks for, where they are predicted to cost so much less that a trial of them pays.
  bool considerAdapting() {
    const bool limited = plan_.limitedBy == "memory" || plan_.limitedBy == "time";  // what was chosen does not meet the tolerance
    const double whole = limited ? allowedSeconds() : plan_.seconds, most = limited ? whole : kWorthAdapting * whole;
    if (!mayAdapt(options_) || cluster_ > 0) return false;
    const Options options = adaptingOptions(options_, plan_.setting);
    const AdaptTrial trial = adaptTrialOf(options, scene_, facets_, plan_.setting.spec);
    if (trial.level == 0 || trial_.secondsFor(static_cast<double>(trial.patches), trial.setting) > kWorthATrial * whole)
      return false;
    if (!adapting_) adapting_ = adaptTo(options, scene_, facets_, plan_.setting.spec);
    if (!isUsable(*adapting_, options, scene_, facets_)) return false;
    const auto n = static_cast<double>(adapting_->adapted.patches);
    Setting s = trial_.setting;
    s.residual = plan_.setting.residual;
    setSamples(s, std::sqrt(std::pow(kMargin * tolerance_, 2) - std::pow(options.adapt, 2) - s.residual * s.residual));
    const double seconds = trial_.secondsFor(n, s);
    ErrorParts predicted = trial_.errorFor(n, s);
    predicted.patches = options.adapt;
    if (seconds > most || predicted.total() > tolerance_ || !fits(n, s)) return false;
    ofOneSize_ = patches_;
    patches_ = n;
    plan_.size = adapting_->size;
    plan_.adapt = options.adapt;
    plan_.adapted = adapting_;
    plan_.setting = s;
    plan_.seconds = seconds;
    plan_.predicted = predicted;
    plan_.limitedBy.clear();
    return true;
  }

  // Rows and shadow rays share what the patches leave of the error so that time for more of either is worth the same.
  void setSamples(Setting& s, double left) const {
    if (wantsPicture(options_) && !fixedSamples() && s.spec.kind == Kind::rays) s.spec.rays = kPictureRays;
    const double rows = trial_.errorFor(1, s).rows, light = trial_.errorFor(1, s).light;
    if (!fixedSamples() && rows > 0) {
      const double perRay = std::max(trial_.perShadowRay * trial_.shadowWork(s.shadowRays) / s.shadowRays, 0.1 * trial_.perSample);
      const double a = std::pow(rows, 2) * samplesOf(s.spec) * trial_.perSample, b = std::pow(light, 2) * s.shadowRays * perRay;
      const double share =
          fixedShadow() || b <= 0 ? std::max(0.1, 1 - std::pow(light / left, 2)) : std::sqrt(a) / (std::sqrt(a) + std::sqrt(b));
      const double allowed = left * std::sqrt(std::clamp(share, 0.1, 1.0));
      const double factor = std::pow(rows / allowed, 1 / orderOf(s.spec));
      MethodSpec scaled = s.spec;
      scaleSamples(scaled, factor);
      const bool picture = wantsPicture(options_) && s.spec.kind == Kind::rays;
      if (!picture || scaled.rays > s.spec.rays) s.spec = scaled;
    }
    if (!fixedShadow() && light > 0) {
      const double now = trial_.errorFor(1, s).rows;
      const double allowed = std::sqrt(std::max(left * left - now * now, 0.1 * left * left));
      s.shadowRays = evenCount(worthOf(s.shadowRays) * std::pow(light / allowed, 1 / kSampleOrder), kLeastShadowRays, kMostRays);
    }
  }

  // With room for what grids of whole cells add to the patches asked for, and entries too large for 16 bits.
  bool fits(double n, const Setting& s) const {
    constexpr double kMore = 1.25;
    return kMore * trial_.bytesFor(n, s) <= static_cast<double>(allowedBytes(options_));
  }

  double allowedSeconds() const {
    constexpr double kShare = 0.8, kLeast = 0.2;  // loading, errors and files take their part, and the trials took theirs
    return options_.time > 0 ? std::max(kLeast * options_.time, kShare * options_.time - watch_.seconds()) : 1e300;
  }

  // Less of everything until the time is enough.
  void limitTime(Setting& s, double& seconds) {
    const double allowed = allowedSeconds();
    const MethodSpec whole = s.spec;
    for (double less = 1; seconds > allowed && patches_ > 50; less /= 1.1) {
      if (!fixedPatches()) patches_ /= 1.1;
      if (!fixedSamples()) {
        s.spec = whole;
        scaleSamples(s.spec, less / 1.1);
      }
      const double before = seconds;
      seconds = trial_.secondsFor(patches_, s);
      plan_.limitedBy = "time";
      if (seconds > before || (fixedPatches() && fixedSamples())) break;
    }
  }

  size_t buildCount(size_t count) const { return cluster_ > 0 ? count : std::max(count, facets_.facets.size()); }

  void explain() {
    const ErrorParts& e = plan_.predicted;
    const Setting& s = plan_.setting;
    const auto percent = [](double x) { return fmt::format("{:.2g} %", 100 * x); };
    plan_.choices.clear();
    const char* given = "given";
    if (plan_.adapted) {
      plan_.choices.push_back(
          {"patches", patchesText(plan_, patches_),
           fmt::format("constant patches cost {}; of one size it would take about {:.0f}", percent(e.patches), ofOneSize_)});
    } else {
      plan_.choices.push_back(
          {"patches", fixedPatches() ? fmt::format("{}{}", options_.patches, clusterText(plan_)) : patchesText(plan_, patches_),
           fixedPatches()
               ? given
               : fmt::format("constant patches cost {} of H's mean, from {} at {} patches{}", percent(e.patches),
                             percent(trial_.patchError.error), trial_.patches,
                             wantsPicture(options_) && patches_ < 1.01 * kPicturePatches ? "; a picture wants 4000 or more" : "")});
    }
    plan_.choices.push_back({"method", methodText(s.spec),
                             fixedSamples() ? given
                                            : fmt::format("sampling rows costs {}, from {} by {}", percent(e.rows),
                                                          percent(trial_.rowError), methodText(trial_.setting.spec))});
    if (trial_.lightError > 0) {
      plan_.choices.push_back({"shadow rays", fmt::format("{}", s.shadowRays),
                               fixedShadow() ? given
                                             : fmt::format("direct light costs {}, from {} by {}", percent(e.light),
                                                           percent(trial_.lightError), trial_.setting.shadowRays)});
    }
    if (s.spec.hemicubes()) {
      plan_.choices.push_back(
          {"positions", fmt::format("{}", s.spec.positions),
           options_.gave("--positions") ? given : "beyond 128 pixels an edge more points of a patch tell more than more pixels"});
      plan_.choices.push_back({"near field", s.spec.nearField && s.spec.positions == 1 ? "on" : "off",
                               options_.gave("--near-field") ? given
                               : s.spec.positions == 1       ? "seen from one point, near patches are most of a row's error"
                                                             : "several points see near patches well enough"});
    }
    plan_.choices.push_back({"emitters", s.emittersApart ? "apart" : "matrix", options_.gave("--emitters") ? given : lampsWhy_});
    plan_.choices.push_back(
        {"solver", solverName(s.solver),
         options_.gave("--solver") ? given : fmt::format("{} sweeps in the trial; no other takes fewer", trial_.sweeps)});
    plan_.choices.push_back(
        {"residual", fmt::format("{:.2g}", s.residual), options_.gave("--residual") ? given : "far below the other parts"});
  }

  const Options& options_;
  const Scene& scene_;
  const FacetSet& facets_;
  double tolerance_;
  Stopwatch watch_;
  TolerancePlan plan_;
  Setting given_;
  TrialLaws trial_;
  std::optional<Adapting> adapting_;    // where patches of several sizes were tried
  double cluster_ = 0, trialSize_ = 0;  // as --cluster; the trial's cell size where that is not 0
  double patches_ = 0, ofOneSize_ = 0;
  std::string lampsWhy_;
};

}  // namespace

TolerancePlan planFor(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method) {
  return Planner(options, scene, facets, method).plan();
}

}  // namespace farol
