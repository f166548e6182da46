// One lighting of a scene on a given F: which emitters go apart, the light that reaches patches without F, the solution,
// and how good it is.
#pragma once

#include "cli/methods.h"
#include "formfactor/error_model.h"
#include "solve/irradiance_error.h"
#include "trace/planar_mirrors.h"

namespace farol {

struct Lighting {
  LampPlan plan;
  DirectLight direct;
  std::vector<Rgb> fromPunctual;  // irradiance per patch by punctual lights; empty: none
  Solution solution;
  std::vector<Rgb> error;  // of H per patch (irradiance_error.h)
};

// What sends direct light, with its images in planar mirrors.
struct Shining {
  std::vector<Lamp> lamps;
  std::vector<PunctualLight> lights;
  std::optional<PlanarMirrors> mirrors;  // that images name
  bool follow = false;                   // mirrors and glass pass on more than images tell
};

// All that lightings of one scene share. The references must outlive this.
class LightingMaker {
 public:
  LightingMaker(const Options& options, const FacetSet& facets, Methods& methods, const Log& log)
      : options_(options), facets_(facets), methods_(methods), log_(log) {}

  // Which emitters go apart, where rows of F are made as `spec` says.
  LampPlan plan(const PatchSet& patches, const MethodSpec& spec) const;

  // `imagesOfLamps`: for those who do not meet lamps in mirrors.
  Shining shining(const LampPlan& plan, const Scene& scene, const PatchSet& patches, bool imagesOfLamps) const {
    return shining(plan, scene, patches, imagesOfLamps, options_.shadowRays);
  }
  // From how many shadow rays on images of lamps and lights serve, and nothing is followed; 0: there are none, or too many.
  size_t imagesWanted(const LampPlan& plan, const Scene& scene, const PatchSet& patches) const;

  // `device`: sweeps run there. Without errors.
  Lighting solve(const Scene& scene, const PatchSet& patches, const Rgb& sky, const FormFactorMatrix& f, const MethodSpec& spec,
                 const gpu::Device* device) const;

  // With errors.
  Lighting make(const Scene& scene, const PatchSet& patches, const Rgb& sky, const FormFactorMatrix& f, const MethodSpec& spec,
                const Replicates& replicates, const gpu::Device* device) const;

  // Without F: emitters as points, or nothing at all.
  Lighting local(const Scene& scene, const PatchSet& patches) const;

 private:
  Shining shining(const LampPlan& plan, const Scene& scene, const PatchSet& patches, bool imagesOfLamps, size_t mostImages) const;
  void addDirect(const Scene& scene, const PatchSet& patches, const FormFactorMatrix& f, Lighting& lighting) const;
  void addFollowed(const PatchSet& patches, std::span<const uint8_t> apart, std::span<const PunctualLight> lights,
                   const std::vector<double>& exposed, DirectLight& direct) const;

  const Options& options_;
  const FacetSet& facets_;
  Methods& methods_;
  const Log& log_;
};

// Rows of some patches once more, by other random numbers or, for hemicubes, by many rays.
Replicates replicatesOf(Methods& methods, const PatchSet& patches, const MethodSpec& spec, const FormFactorMatrix& f,
                        size_t probes);

inline constexpr size_t kProbes = 24;  // rows made better to tell how good the others are; more when methods are compared

// About `count` rows by many rays, `better` times as many as those of `spec`, as a reference; in scenes of few patches also
// rows like F's with other seeds.
ProbeRows makeProbes(Methods& methods, const PatchSet& patches, const MethodSpec& spec, const FormFactorMatrix& f, size_t count,
                     uint32_t better = 16);

// Root of the area-weighted mean square of `error` over the mean of H, of the channel where that is largest; areas are exposed
// areas.
double relativeError(const FormFactorMatrix& f, const PatchSet& patches, const Lighting& lighting);

}  // namespace farol
