// Where something opaque touches, cuts or nearly touches a parallelogram: lines at which light ends within less than a patch.
// Patches that lie across such a line take light where it ends and pass it on behind it; divided along it they do not
// (Baum, Mann, Smith and Winget, "Making radiosity usable", SIGGRAPH 1991).
#pragma once

#include "patch/facets.h"

namespace farol {

// Lines of constant u and of constant v, ascending, in (0, 1).
struct ContactLines {
  std::vector<double> u, v;
};

// For every facet the lines along its sides; none for triangles. Only those that pay: of facets that many patches share, along
// a quarter of the side or more, and a few of them.
std::vector<ContactLines> contactLines(const FacetSet& facets);

}  // namespace farol
