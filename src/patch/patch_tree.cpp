#include "patch/patch_tree.h"

#include <algorithm>
#include <bit>
#include <unordered_map>

namespace farol {
namespace {

uint64_t keyOf(uint32_t facet, bool back, uint32_t level, uint32_t cell) {
  return uint64_t{level} << 60 | uint64_t{2 * facet + (back ? 1u : 0u)} << 32 | cell;
}

}  // namespace

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

bool PatchTree::isSplit(uint32_t facet, bool back, uint32_t level, uint32_t cell) const {
  return split_.contains(keyOf(facet, back, level, cell));
}

PatchSet buildPatches(const Scene& scene, const FacetSet& facets, PatchOptions options, const PatchTree& tree) {
  if (tree.levels() == 0) return buildPatches(scene, facets, options);
  options.levels = tree.levels();
  PatchSet patches = buildPatches(scene, facets, options);
  mapCells(patches, scene, facets, tree.cellMap(patches, facets, options.levels));
  return patches;
}

std::vector<uint32_t> joinedSiblings(const PatchSet& patches, const FacetSet& facets, uint32_t levels) {
  struct Family {
    uint32_t number, members = 0;
  };
  constexpr uint32_t kWhole = 4;
  std::unordered_map<uint64_t, Family> families;
  std::vector<uint64_t> keys(patches.size());
  for (uint32_t p = 0; p < keys.size(); ++p) {
    const auto halvings = static_cast<uint32_t>(std::countr_zero(patches.cellsOf(p).size())) / 2;
    if (halvings >= levels) continue;  // of the largest: without siblings
    const Cell& cell = patches.cells[patches.cellsOf(p)[0]];
    const uint32_t parent = coarserCell(patches.grids[cell.facet], facets.facets[cell.facet].parallelogram, cell, halvings + 1);
    keys[p] = keyOf(cell.facet, cell.back, levels - halvings, parent);
    ++families.try_emplace(keys[p], Family{kNone}).first->second.members;
  }
  std::vector<uint32_t> joined(patches.size());
  uint32_t next = 0;
  for (uint32_t p = 0; p < keys.size(); ++p) {
    const auto family = families.find(keys[p]);
    if (family == families.end() || family->second.members != kWhole) {
      joined[p] = next++;
      continue;
    }
    if (family->second.number == kNone) family->second.number = next++;
    joined[p] = family->second.number;
  }
  return joined;
}

}  // namespace farol
