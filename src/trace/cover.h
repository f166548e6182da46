// Covered area: the part of a patch on which an object stands neither gathers nor emits.
#pragma once

#include "patch/positions.h"
#include "trace/tracer.h"

#include <span>

namespace farol {

// Bit k: the k-th of at most kPacketSize points on a surface with this normal lies inside an object that stands there:
// everything seen from it, in eight directions, is seen from behind. Bit k of `black` asks for one-sided surfaces;
// otherwise double-sided ones count too.
uint32_t insideObject(const Tracer& tracer, const FacetSet& facets, std::span<const Vec3> points, const Vec3& normal,
                      uint32_t black);

// The positions of one patch on which nothing stands, their weights adding up to 1 again.
std::vector<Position> exposedPositions(const Tracer& tracer, const FacetSet& facets, std::span<const Position> all,
                                       const Vec3& normal);

// Per patch: the share of its area that is exposed, from `samples` points spread over it, and for partly covered
// patches the exposed point nearest to the mean of all exposed ones [unit coordinates].
struct ExposedArea {
  std::vector<float> share;  // [patches]
  std::vector<Vec3> point;   // [patches] the centroid where nothing is covered
};
ExposedArea findExposedArea(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, int samples, uint64_t seed);

}  // namespace farol
