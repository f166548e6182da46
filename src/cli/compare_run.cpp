#include "cli/compare_run.h"

#include "base/error.h"
#include "formfactor/near_field.h"
#include "output/factor_archive.h"
#include "output/output.h"

#include <algorithm>

namespace farol {
namespace {

bool isFile(const std::string& text) { return text.ends_with(".npy") || text.ends_with(".npz"); }

// Root of the area-weighted mean square of x - y over the mean of both, worst channel; 0 without light.
double relativeDifference(const std::vector<Rgb>& x, const std::vector<Rgb>& y, const PatchSet& patches) {
  Rgb squares(0), total(0);
  double area = 0, worst = 0;
  for (size_t i = 0; i < patches.size(); ++i) {
    const double a = patches.patches[i].area;
    squares += a * (x[i] - y[i]) * (x[i] - y[i]);
    total += a * 0.5 * (x[i] + y[i]);
    area += a;
  }
  for (int c = 0; c < 3; ++c) {
    if (total[c] > 0) worst = std::max(worst, std::sqrt(squares[c] * area) / total[c]);
  }
  return worst;
}

}  // namespace

std::optional<MethodSpec> CompareRun::specOf(const std::string& text) const {
  if (isFile(text)) return std::nullopt;
  std::optional<MethodSpec> spec = parseMethod(text);
  spec->seed = options_.seed;
  requireFollowed(at_, spec->kind);
  const std::string blocker = spec->kind == MethodSpec::Kind::exact ? whatMayBlock(at_.scene, at_.facets) : "";
  if (!blocker.empty()) throw Error("{}: closed forms hold only where nothing can block: {}", options_.scene, blocker);
  return spec;
}

FormFactorMatrix CompareRun::loadFile(const std::string& path) const {
  if (path.ends_with(".npy")) return loadFactorsNpy(path, patches_.size());
  const FactorArchive archive(path);
  archive.requireSame(fingerprintOf(at_.facets, patches_), options_.scene);
  return archive.load(patches_.size(), allowedBytes(options_) / 2);
}

CompareRun::Side CompareRun::makeSide(const std::string& text, const std::optional<MethodSpec>& spec) {
  const Stopwatch watch;
  if (!spec) return {text, loadFile(text), {}, watch.seconds()};
  chooseStorage(at_, *spec);
  Side side{methodText(*spec), FormFactorMatrix(patches_.size(), allowedBytes(options_) / 2), {}, 0};
  const std::unique_ptr<RowMaker> maker = at_.methods.maker(*spec);
  // Every patch has a row on both sides, whatever each method sees; beside a file the patches that the file has.
  makeFormFactors(*maker, patches_, !isFile(options_.methodA) && !isFile(options_.methodB), log_, side.f);
  side.seconds = watch.seconds();
  constexpr size_t kMany = 256;
  side.error = fitErrorModel(side.f, patches_, makeProbes(at_.methods, patches_, *spec, side.f, kMany), samplesOf(*spec));
  if (spec->kind == MethodSpec::Kind::exact) side.error = {};
  return side;
}

ComparisonReport CompareRun::compare() {
  const auto specA = specOf(options_.methodA), specB = specOf(options_.methodB);
  // A method comes before a file: it settles which patches there are.
  std::optional<Side> a, b;
  if (!specA && specB) b = makeSide(options_.methodB, specB);
  a = makeSide(options_.methodA, specA);
  if (!b) b = makeSide(options_.methodB, specB);
  spec_ = specA ? *specA : specB ? *specB : specFrom(options_, MethodSpec::Kind::rays);
  clock_.finish("form factors");
  const Comparison c = compareFactors(a->f, a->error, b->f, b->error, patches_);
  const bool estimated = a->error.samples > 0 || b->error.samples > 0;
  ComparisonReport report{a->name,
                          b->name,
                          c,
                          checkFormFactors(a->f, patches_),
                          checkFormFactors(b->f, patches_),
                          irradianceChange(a->f, b->f),
                          a->seconds,
                          b->seconds,
                          estimated,
                          {}};
  for (const uint32_t p : {c.worst, c.rows[c.worst].more, c.rows[c.worst].less})
    report.worst.push_back(p == kNone ? "" : surfaceNameOf(at_.scene, patches_.patches[p]));
  clock_.finish("compare");
  return report;
}

// Both solved with the same lamps.
double CompareRun::irradianceChange(const FormFactorMatrix& a, const FormFactorMatrix& b) const {
  Replicates none;
  const Lighting lit = lightings_.make(at_.scene, patches_, options_.sky, a, spec_, none, nullptr);
  SolveOptions o;
  o.sky = options_.sky;
  return relativeDifference(lit.solution.irradiance, solveRadiosity(b, patches_, lit.direct, at_.scene, o, log_).irradiance,
                            patches_);
}

void addDifference(const Solution& a, const Solution& b, const PatchSet& patches, SolverComparison& to) {
  for (size_t i = 0; i < patches.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double x = a.radiosity[i][c];
      if (x > 0) to.largest = std::max(to.largest, std::abs(x - b.radiosity[i][c]) / x);
    }
  }
  to.rms = relativeDifference(a.radiosity, b.radiosity, patches);
}

}  // namespace farol
