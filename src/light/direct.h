// Direct irradiance of every patch from lamps apart and from punctual lights.
#pragma once

#include "formfactor/form_factors.h"
#include "light/shadow_packet.h"
#include "trace/planar_mirrors.h"

#include <functional>

namespace farol {

struct DirectOptions {
  // S per patch; four times as many where neighbours see a lamp partly, a fourth (16 or more) where they agree. Where something
  // stands on a patch, up to 16 times as many are drawn, so that about as many start on what is exposed.
  uint32_t shadowRays = 64;
  uint64_t seed = 1;
  const PlanarMirrors* mirrors = nullptr;  // that images among the lamps name
};

// Light that reaches patches without F.
struct DirectLight {
  std::vector<Rgb> irradiance;  // [patches] D [flux per area]; empty: none
  std::vector<Rgb> deviation;   // [patches] standard error by shadow rays, from a few differences: rough by itself
  std::vector<uint8_t> apart;   // [patches] 1: the patch's own emission is in D, so that F carries what it reflects
  size_t rays = 0;              // shadow rays traced

  bool present() const { return !irradiance.empty(); }
  bool isApart(size_t patch) const { return !apart.empty() && apart[patch] != 0; }
};

// D_i = sum over sources of U x sum(k V) / sum(k): U the unoccluded irradiance, the mean of the closed form (Lambert's
// contour sum; the inverse square law for punctual lights) over Gauss points of the patch; k the point-to-point kernel
// and V the visibility of S low-discrepancy pairs of points on patch and source, shared out by U. A visible share not
// weighted by k would count the horizon twice. To an image of a lamp V is along the way over its mirrors. Where an object stands on
// a patch only its exposed part counts.
class DirectIrradiance {
 public:
  DirectIrradiance(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, std::span<const Lamp> lamps,
                   std::span<const PunctualLight> lights, const DirectOptions& options);

  // `exposed` as in RowShares, per patch. `done` is called now and then, by the caller's thread, with a number that rises to
  // twice that of patches: penumbras are looked at again.
  DirectLight compute(
      const std::vector<double>& exposed, const std::function<void(size_t)>& done = [](size_t) {}) const;

  struct Estimate {
    Rgb irradiance{0};
    Rgb deviation{0};
    bool partly = false;  // some rays were blocked and some were not
    uint32_t rays = 0;
  };
  // At a point with a normal, unit coordinates: for sensors.
  Estimate at(const Vec3& point, const Vec3& normal, uint32_t rays, uint64_t seed) const;

 private:
  struct Receiver;
  struct Source;
  class Visibility;
  Estimate gather(const Receiver& receiver, uint32_t rays) const;
  Receiver receiverOf(uint32_t patch, double exposed) const;
  std::vector<uint32_t> neighboursOf(uint32_t patch) const;       // in the cells of its facet, near enough to share a penumbra
  std::vector<Source> sourcesOf(const Receiver& receiver) const;  // that reach it unless something stands between

  const Tracer& tracer_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  std::span<const Lamp> lamps_;
  std::span<const PunctualLight> lights_;
  DirectOptions options_;
  ShadowPoints points_;
};

// Irradiance from a punctual light, nothing in between, by KHR_lights_punctual: candela over distance squared times
// cosine, or lux times cosine. Point in scene units.
Rgb unoccludedIrradiance(const PunctualLight& light, const Vec3& point, const Vec3& normal);

// Its parts: how a light's range and a spot's cone lessen it, by KHR_lights_punctual, at a distance [scene units] and at an angle
// to the light's direction.
double rangeShare(const PunctualLight& light, double distance);
double coneShare(const PunctualLight& light, double cosine);

// From a point to a punctual light, or out of the scene towards one that is infinitely far [unit coordinates].
Vec3 wayTo(const PunctualLight& light, const Vec3& point, const Frame& frame);

}  // namespace farol
