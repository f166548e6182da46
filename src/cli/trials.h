// One scene cut into patches of one size, and solved in one setting after another: what a chart measures and a tolerance
// chooses from.
#pragma once

#include "cli/lighting.h"
#include "solve/adaptive.h"

namespace farol {

inline constexpr double kSecondsPerEntry = 3e-10;  // of F, per sweep, about

// How F is made and solved.
struct Setting {
  MethodSpec spec;
  bool emittersApart = true;
  uint32_t shadowRays = 64;
  SolverKind solver = SolverKind::conjugateResiduals;
  double residual = 1e-5;
};

struct Trial {
  FormFactorMatrix f;
  Lighting lighting;                                        // without errors
  double rowError = 0, lightError = 0;                      // of H by rows of F and by direct light, relative (relativeError)
  double rowSeconds = 0, lightSeconds = 0, cpuSeconds = 0;  // rows of F; direct light and solve; of all cores, for both

  double seconds() const { return rowSeconds + lightSeconds; }
};

class SizedScene {
 public:
  // The references must outlive this.
  SizedScene(const Options& options, const Scene& scene, const FacetSet& facets, const PatchOptions& size,
             const PatchTree& tree = {});

  // With errors where `probes`, a number of rows to be made again, is not 0.
  Trial solve(const Setting& setting, size_t probes = 0);

  const PatchSet& patches() const { return patches_; }
  Methods& methods() { return methods_; }
  const LightingMaker& lightings() const { return lightings_; }
  const Options& options() const { return options_; }

 private:
  Options options_;  // with the setting of the last trial
  const Scene& scene_;
  const FacetSet& facets_;
  PatchSet patches_;
  Log log_;  // silent: what every trial would say again was said once
  Methods methods_;
  LightingMaker lightings_;
};

}  // namespace farol
