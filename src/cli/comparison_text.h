// What `compare` tells people: a table, and a colour per patch.
#pragma once

#include "cli/report.h"

namespace farol {

// Lines without a break at the end.
std::string comparisonText(const ComparisonReport& report, const Scene& scene, const PatchSet& patches);

// Every patch in the colour of its row's difference, from dark blue (none) over green to yellow (the largest).
std::vector<Rgb> differenceColors(const Comparison& comparison);

}  // namespace farol
