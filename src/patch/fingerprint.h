// What form factors depend on, as numbers: a kept F belongs to a scene when all of them agree. Diffuse colours and
// emission are not part of it; nor are position and size of the whole scene, beyond rounding.
#pragma once

#include "patch/patches.h"

namespace farol {

struct Fingerprint {
  uint64_t geometry = 0;  // facets: corners, sides
  uint64_t patches = 0;   // cells and the cell map
  uint64_t specular = 0;  // per patch: what does not scatter

  bool operator==(const Fingerprint&) const = default;
};
Fingerprint fingerprintOf(const FacetSet& facets, const PatchSet& patches);

}  // namespace farol
