#include "cli/plan_rules.h"

namespace farol {

bool mayAdapt(const Options& o) {
  return o.command != Command::factors && o.variants.empty() && !o.gave("--patches") && !o.gave("--patch-size");
}

bool givesSamples(const Options& options, const MethodSpec& spec) {
  using Kind = MethodSpec::Kind;
  return spec.kind == Kind::exact || options.gave(spec.kind == Kind::rays ? "--rays" : "--resolution");
}

bool wantsPicture(const Options& o) { return o.command == Command::render || !o.output.empty(); }

Options adaptingOptions(const Options& given, const Setting& setting) {
  constexpr double kShare = 0.65;  // of the error that patches cost: its square and the samples' are about alike
  Options options = given;
  options.patchSize = 0;
  options.adapt = rounded(kShare * kMargin * given.tolerance, 2);
  options.residual = setting.residual;
  return options;
}

bool isUsable(const Adapting& a, const Options& options, const Scene& scene, const FacetSet& facets) {
  constexpr size_t kMostCells = size_t{1} << 23;  // the grid of the smallest patches is as large as that over all
  const bool deep = buildPatches(scene, facets, a.size).size() << 2 * a.adapted.tree.levels() > kMostCells;
  return !deep && a.adapted.error <= options.adapt && !(wantsPicture(options) && a.adapted.patches < kPicturePatches);
}

std::string patchesText(const TolerancePlan& p, double patches) {
  if (p.adapted)
    return fmt::format("--adapt {} --patch-size {} (about {:.0f} of {} sizes)", p.adapt, p.size.size, patches,
                       p.adapted->adapted.tree.levels() + 1);
  return fmt::format("--patch-size {}{} (about {:.0f})", p.size.size, clusterText(p), patches);
}

std::string clusterText(const TolerancePlan& p) { return p.size.cluster > 0 ? fmt::format(" --cluster {}", p.size.cluster) : ""; }

}  // namespace farol
