// Facets of one plane that face the same way and cover each other: which of them is seen there is nobody's to say.
#pragma once

#include "patch/facets.h"

namespace farol {

struct Overlap {
  uint32_t first = 0, second = 0;  // facets
  double area = 0;                 // that both cover [unit coordinates squared]
};

// At most `most` pairs, those of the largest area first. Planes closer than the welding tolerance are one.
std::vector<Overlap> findOverlaps(const FacetSet& facets, size_t most);

}  // namespace farol
