#include "cli/patch_size_error.h"

#include "solve/patch_error.h"

namespace farol {
namespace {

// joined(k): for every patch its group, patches of k times the size.
template <typename Join>
PatchSizeError errorByJoining(const FormFactorMatrix& f, const PatchSet& patches, const Lighting& lighting, Join joined) {
  constexpr double kLow = 1.3, kHigh = 2;  // orders found in rooms with objects; coarse patches show less than they have
  const auto joining = [&](uint32_t times) {
    return joiningError(f, patches, lighting.direct, lighting.solution, joined(times)).relative;
  };
  const double twice = joining(2), fourTimes = joining(4);
  const double order = twice > 0 ? std::clamp(std::log2(std::max(fourTimes / twice - 1, 1.0)), kLow, kHigh) : kHigh;
  return {twice / (std::pow(2, order) - 1), order};
}

}  // namespace

PatchSizeError patchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting) {
  return errorByJoining(f, patches, lighting, [&](uint32_t times) {
    const std::vector<uint32_t> ofCell = joinedCells(patches, facets, times);
    std::vector<uint32_t> joined(patches.size());
    for (uint32_t p = 0; p < joined.size(); ++p) joined[p] = ofCell[patches.cellsOf(p)[0]];
    return joined;
  });
}

PatchSizeError gatheredPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene, const FacetSet& facets,
                                    const Lighting& lighting, const PatchOptions& size) {
  return errorByJoining(f, patches, lighting, [&](uint32_t times) {
    PatchOptions wider = size;
    wider.size *= times;
    return joinedTo(buildPatches(scene, facets, wider), patches, facets);
  });
}

double adaptedPatchErrorOf(const FormFactorMatrix& f, const PatchSet& patches, const FacetSet& facets, const Lighting& lighting,
                           const Adapting& adapting) {
  const std::vector<uint32_t> joined = joinedSiblings(patches, facets, adapting.adapted.tree.levels());
  const double seen = joiningError(f, patches, lighting.direct, lighting.solution, joined).relative;
  return seen > 0 ? std::sqrt(adapting.adapted.error * seen / (std::pow(2, adapting.order) - 1)) : adapting.adapted.error;
}

}  // namespace farol
