// Where something opaque touches, cuts or nearly touches a parallelogram: lines at which light ends within less than a patch.
// Patches that lie across such a line take light where it ends and pass it on behind it; divided along it they do not
// (Baum, Mann, Smith and Winget, "Making radiosity usable", SIGGRAPH 1991).
#pragma once

#include "patch/facets.h"

#include <utility>

namespace farol {

struct ContactLine {
  double at = 0;                                 // in (0, 1)
  std::vector<std::pair<double, double>> spans;  // along it: where something is, in [0, 1]
};

// Lines of constant u and of constant v, ascending.
struct ContactLines {
  std::vector<ContactLine> u, v;

  bool empty() const { return u.empty() && v.empty(); }
};

// For every facet the lines along its sides; none for triangles. Only those that pay: of facets that many patches share, along
// a quarter of the side or more, and a few of them.
std::vector<ContactLines> contactLines(const FacetSet& facets);

// Where the parts that lines divide a side into end: 0, the lines, 1.
std::vector<double> endsOf(const std::vector<ContactLine>& lines);

// The parts that the lines divide a facet into, row by row (v), each with the number of its region: between regions something
// stands all along the border. Numbers are those of a region's first part.
std::vector<uint32_t> regionsOf(const ContactLines& lines);

}  // namespace farol
