#include "cli/patch_size_error.h"

#include "solve/patch_error.h"

#include <algorithm>

namespace farol {
namespace {

// joined(k): for every patch its group, patches of k times the size: first as such patches would be, then in other ways, which
// tell of the order alone.
template <typename Join>
PatchSizeError errorByJoining(const FormFactorMatrix& f, const PatchSet& patches, const Lighting& lighting, Join joined) {
  constexpr double kLow = 1.3, kHigh = 2;  // orders found in rooms with objects; coarse patches show less than they have
  // Where joining shows a lower order, edges of shadows and thin gaps hide in coarse patches, and smaller ones gain less: final
  // gathering finds 1.3 at 450 to 5,000 patches of a box (joining 1.1), 1.1 in an L-shaped room (0.5), 0.95 beside a mirror (0.2).
  // Facets of few cells join no further and show nothing.
  constexpr double kLeast = 0.9, kPerOrder = 0.35, kFewer = 2.5;
  struct Joining {
    double first = 0, mean = 0;  // rms
    double groups = 0;
  };
  const auto joining = [&](uint32_t times) {
    const std::vector<std::vector<uint32_t>> ways = joined(times);
    std::vector<double> errors;
    double squares = 0;
    for (const std::vector<uint32_t>& groups : ways) {
      errors.push_back(joiningError(f, patches, lighting.direct, lighting.solution, groups).relative);
      squares += errors.back() * errors.back();
    }
    return Joining{errors[0], std::sqrt(squares / static_cast<double>(ways.size())),
                   1.0 + *std::max_element(ways[0].begin(), ways[0].end())};
  };
  const Joining twice = joining(2), fourTimes = joining(4);
  const double shown = twice.mean > 0 ? std::log2(std::max(fourTimes.mean / twice.mean - 1, 1.0)) : kHigh;
  const double order = std::clamp(shown, kLow, kHigh);
  const bool hides = shown < kLow && kFewer * fourTimes.groups < twice.groups;
  return {twice.first / (std::pow(2, order) - 1), order, hides ? std::min(kLeast + kPerOrder * shown, kLow) : order};
}

}  // namespace

PatchSizeError patchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting) {
  return errorByJoining(f, patches, lighting, [&](uint32_t times) {
    std::vector<std::vector<uint32_t>> ways;
    for (const uint32_t before : {0u, times / 2}) {
      const std::vector<uint32_t> ofCell = joinedCells(patches, facets, times, before);
      ways.emplace_back(patches.size());
      for (uint32_t p = 0; p < patches.size(); ++p) ways.back()[p] = ofCell[patches.cellsOf(p)[0]];
    }
    return ways;
  });
}

PatchSizeError gatheredPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene, const FacetSet& facets,
                                    const Lighting& lighting, const PatchOptions& size) {
  return errorByJoining(f, patches, lighting, [&](uint32_t times) {
    PatchOptions wider = size;
    wider.size *= times;
    return std::vector<std::vector<uint32_t>>{joinedTo(buildPatches(scene, facets, wider), patches, facets)};
  });
}

double adaptedPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting,
                           const Adapting& adapting) {
  const std::vector<uint32_t> joined = joinedSiblings(patches, facets, adapting.adapted.tree.levels());
  const double seen = joiningError(f, patches, lighting.direct, lighting.solution, joined).relative;
  return seen > 0 ? std::sqrt(adapting.adapted.error * seen / (std::pow(2, adapting.order) - 1)) : adapting.adapted.error;
}

}  // namespace farol
