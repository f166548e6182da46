// Light of lamps apart and of punctual lights that reaches patches over mirrors and through glass, followed from where it starts
// (Arvo 1986): few of the rays that leave a patch meet a lamp there, but most of what a lamp sends to a mirror arrives somewhere.
#pragma once

#include "scene/scene.h"
#include "trace/ray_tree.h"

#include <functional>
#include <span>

namespace farol {

struct SpecularLight {
  std::vector<Rgb> irradiance;  // [patches] over the exposed part [flux per area]; what lamps bring straight is not in it
  std::vector<Rgb> deviation;   // [patches] its standard error, from a few differences: rough by itself
  size_t rays = 0;              // from lamps
};

// At least so many `rays`, and at most 2^32, start by power from the patches that are `apart`, all over them and by the cosine,
// from points and spots, and from a disc that covers the scene for directional lights; the power of what arrives after a first
// mirror or glass is spread over the patch that it meets. A light's range acts on the way to the first one. `exposed` as in
// RowShares, per patch. `done` is called now and then, by the caller's thread, with the share that is done. The same for any
// number of threads.
SpecularLight traceSpecularLight(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const RayTree& tree,
                                 std::span<const uint8_t> apart, std::span<const PunctualLight> lights,
                                 std::span<const double> exposed, size_t rays, uint64_t seed,
                                 const std::function<void(double)>& done);

}  // namespace farol
