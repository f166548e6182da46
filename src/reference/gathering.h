// Mean irradiance of the continuous scene over patches, by paths from random points of every patch (path_gatherer.h), and
// the error of a solution against it.
#pragma once

#include "reference/path_gatherer.h"

#include <functional>

namespace farol {

// In two halves that share no random numbers: their difference tells the noise, and a product of two differences to a
// solution, one to each half, is the square of its error without the noise.
struct GatheredIrradiance {
  std::array<std::vector<Rgb>, 2> half;  // [patches] H* over the exposed part [flux per area]
  std::vector<double> exposed;           // [patches] share of the patch on which nothing stands
  size_t paths = 0;                      // per cell of the finest division
};

struct HError {
  double error = 0;          // sqrt(sum A (H - H*)^2 / sum A) / (sum A H* / sum A), worst channel, over exposed area
  double noise = 0;          // errors below this cannot be told from none
  double standardError = 0;  // of H* itself, the same measure
};
HError errorOf(const std::vector<Rgb>& irradiance, const PatchSet& patches, const GatheredIrradiance& truth);

// Works on all cores for about `seconds`, at least a few passes; every pass starts one path in each cell of the first set,
// whose points count for the patches of all sets. `done` is told the seconds spent. All sets have the same facets.
std::vector<GatheredIrradiance> gatherIrradiance(const PathGatherer& gatherer, const Tracer& tracer, const FacetSet& facets,
                                                 std::span<const PatchSet* const> sets, double seconds, uint64_t seed,
                                                 const std::function<void(double)>& done);

// Adds to both halves what the gatherer has left out (PathGatherer::leaveOutFollowed), followed for about `seconds`. `patches`:
// those of the gatherer, on which `gathered` is.
void addFollowed(const PathGatherer& gatherer, const PatchSet& patches, double seconds, uint64_t seed,
                 GatheredIrradiance& gathered);

}  // namespace farol
