// Measures error against time over methods and settings on one scene.
#pragma once

#include "chart/chart.h"
#include "cli/options.h"
#include "patch/patches.h"

namespace farol {

// Ends after about options.time seconds, but not before a few settings are measured, or by a signal: `interrupted` is then its
// number and what was measured is kept. The reference is taken from `cache` if it was made for the same scene and settings, and
// left there.
struct ChartRun {
  Chart chart;
  int interrupted = 0;
};
ChartRun runChart(const Options& options, const Scene& scene, const FacetSet& facets, const std::string& cache, Log& log);

// The settings that nothing beats and the laws, in lines; where laws depart from what is known of an empty box, that too.
std::string chartText(const Chart& chart);

}  // namespace farol
