// Covered area: the part of a patch on which an object stands neither gathers nor emits.
#pragma once

#include "trace/tracer.h"

namespace farol {

// True when `point` on a surface with this normal lies inside an object that stands there: everything seen from it,
// in eight directions, is seen from behind. `black` asks for one-sided surfaces; otherwise double-sided ones count too.
bool insideObject(const Tracer& tracer, const FacetSet& facets, const Vec3& point, const Vec3& normal, bool black);

// Per patch: the share of its area that is exposed, from `samples` points spread over it, and for partly covered
// patches the exposed point nearest to the mean of all exposed ones [unit coordinates].
struct ExposedArea {
  std::vector<float> share;  // [patches]
  std::vector<Vec3> point;   // [patches] the centroid where nothing is covered
};
ExposedArea findExposedArea(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, int samples,
                            uint64_t seed);

}  // namespace farol
