#include "patch/patch_tree.h"

#include <algorithm>
#include <unordered_map>

namespace farol {

void PatchTree::split(uint32_t facet, bool back, uint32_t level, uint32_t cell) {
  split_.insert(keyOf(facet, back, level, cell));
  levels_ = std::max(levels_, level + 1);
}

std::vector<uint32_t> PatchTree::cellMap(const PatchSet& cells, const FacetSet& facets, uint32_t levels) const {
  std::vector<uint32_t> map(cells.cells.size());
  std::unordered_map<uint64_t, uint32_t> numbers;
  for (size_t c = 0; c < map.size(); ++c) {
    const Cell& cell = cells.cells[c];
    const bool parallelogram = facets.facets[cell.facet].parallelogram;
    const CellGrid& grid = cells.grids[cell.facet];
    uint32_t level = 0, node = coarserCell(grid, parallelogram, cell, levels);
    while (level < levels && isSplit(cell.facet, cell.back, level, node)) {
      ++level;
      node = coarserCell(grid, parallelogram, cell, levels - level);
    }
    map[c] = numbers.try_emplace(keyOf(cell.facet, cell.back, level, node), static_cast<uint32_t>(numbers.size())).first->second;
  }
  return map;
}

PatchSet buildPatches(const Scene& scene, const FacetSet& facets, PatchOptions options, const PatchTree& tree) {
  if (tree.levels() == 0) return buildPatches(scene, facets, options);
  options.levels = tree.levels();
  PatchSet patches = buildPatches(scene, facets, options);
  mapCells(patches, scene, facets, tree.cellMap(patches, facets, options.levels));
  return patches;
}

}  // namespace farol
