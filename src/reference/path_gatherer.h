// Irradiance of the continuous scene at a point, by paths: no patches, no form factors, no mesh error. Light of lamps apart, of
// punctual lights and of their images in planar mirrors is sampled at every point of a path by a shadow ray, where no lamp is
// close; everything else is met. What glass and mirrors of other shapes pass on of punctual lights is missing: no path meets them.
#pragma once

#include "base/sobol.h"
#include "light/lamp_images.h"
#include "light/specular_light.h"
#include "trace/ray_tree.h"

#include <optional>
#include <span>

namespace farol {

// Where a path starts, and what came of it.
struct GatherPath {
  uint32_t facet = 0;
  bool back = false;
  Vec2 uv{0};
  // In [0,1): the first direction, then what is chosen first along the path (lamps, their points, the next direction).
  std::array<double, kSobolDimensions - 2> numbers{};
  uint64_t seed = 0;  // of everything else
  Rgb irradiance{0};  // an unbiased estimate of H [flux per area]
};

class PathGatherer {
 public:
  // The references must outlive this. `patches` says which sides exist and which of them are mirrors or glass.
  PathGatherer(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const Scene& scene, const LampPlan& lamps,
               const Rgb& sky, const TreeLimits& limits);

  // Final gathering: from here on paths end at the first surface that is met: light of lamps is sampled there too, and in place
  // of what follows comes what this irradiance H of the patch there has besides. Far less noise; what a good solution errs by
  // reaches the start as a mean over all directions only, and shadows keep their edges within its patches. `exposed` as in
  // RowShares, per patch. `patches` must outlive this.
  void endWith(const PatchSet& patches, std::span<const Rgb> irradiance, const std::vector<double>& exposed);

  // From here on, what mirrors and glass pass on of lamps apart and of punctual lights straight to where a path starts is left out,
  // unless by images: few paths meet it. It is to be added as it is followed from the lamps, to `patches`, those of the
  // constructor; `exposed` as in RowShares.
  void leaveOutFollowed() { leaveOutFollowed_ = true; }
  SpecularLight follow(const PatchSet& patches, std::span<const double> exposed, size_t rays, uint64_t seed) const;
  bool leavesOut() const {
    return leaveOutFollowed_ && patchesSpecular_ && ((!lamps_.empty() && !imagesOfLamps_) || missesLights_);
  }

  // Whether there are punctual lights whose way over mirrors and through glass is missing.
  bool missesLights() const { return missesLights_; }

  // Fills `irradiance` of each path, sixteen at a time.
  void gather(std::span<GatherPath> paths) const;

 private:
  struct Lane;
  struct ShadowRays;
  void start(GatherPath& path, Lane& lane) const;
  bool close(const Vec3& point, const Vec3& onLamp, uint32_t facet) const;
  bool closeToLamps(const Vec3& point) const;
  std::pair<size_t, double> chooseLamp(const Lane& lane, double& s) const;
  void light(Lane& lane, uint32_t k, ShadowRays& toLamps, ShadowRays& toPunctual) const;
  void lightPunctual(Lane& lane, uint32_t k, ShadowRays& toPunctual) const;
  void meet(const HitPacket& hits, const RayPacket& rays, uint32_t k, Lane& lane) const;
  Optics opticsAt(uint32_t facet, double u, double v) const;

  const Tracer& tracer_;
  const FacetSet& facets_;
  const Scene& scene_;
  const LampPlan& plan_;
  std::optional<PlanarMirrors> mirrors_;  // where they show images
  std::vector<Lamp> lamps_;               // and their images
  std::vector<PunctualLight> lights_;     // and their images
  bool imagesOfLamps_ = false;            // are all among the lamps
  bool missesLights_ = false;
  bool leaveOutFollowed_ = false, patchesSpecular_ = false;
  Rgb sky_;
  HitPatches hitPatches_;
  std::optional<HitPatches> knownPatches_;
  std::vector<Rgb> known_;  // [its patches] irradiance without that of lamps
  RayTree tree_;
  std::vector<uint8_t> varies_;   // [surfaces] optics depend on the place
  std::vector<Optics> constant_;  // [surfaces] of those that do not
};

}  // namespace farol
