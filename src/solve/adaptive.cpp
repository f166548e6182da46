#include "solve/adaptive.h"

#include "solve/patch_error.h"

#include <cmath>
#include <numeric>
#include <queue>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace farol {
namespace {

struct Node {
  uint32_t facet, level, cell;
  bool back;
  double cost = 0;  // mean square of the change of H, over the square of its mean
};

// The patches of one level: nodes, and which of them each patch of the grid lies in.
struct Level {
  std::vector<Node> nodes;
  std::vector<uint32_t> nodeOf;  // [patches]
};

Level levelOf(const FacetSet& facets, const PatchSet& patches, uint32_t steps, uint32_t level) {
  Level result;
  result.nodeOf.resize(patches.size());
  std::unordered_map<uint64_t, uint32_t> known;
  for (uint32_t p = 0; p < patches.size(); ++p) {
    const Cell& cell = patches.cells[patches.cellsOf(p)[0]];
    const uint32_t number = coarserCell(patches.grids[cell.facet], facets.facets[cell.facet].parallelogram, cell, steps);
    const uint64_t key = uint64_t{2 * cell.facet + (cell.back ? 1u : 0u)} << 32 | number;
    const auto [place, isNew] = known.try_emplace(key, static_cast<uint32_t>(result.nodes.size()));
    if (isNew) result.nodes.push_back({cell.facet, level, number, cell.back});
    result.nodeOf[p] = place->second;
  }
  return result;
}

// What every node of a level costs: sum_i A_i (sum_{k in node} F_ik (B_k - mean))^2, per channel over its mean H, largest
// channel; without what noise in F adds, sum_k A_k (B_k - mean)^2 / samples by reciprocity.
void addCosts(const FormFactorMatrix& f, const PatchSet& patches, const std::vector<Rgb>& b, const Rgb& meanH, double samples,
              Level& level) {
  const size_t n = patches.size(), count = level.nodes.size();
  std::vector<double> area(n), nodeArea(count, 0.0);
  std::vector<Rgb> mean(count, Rgb(0)), change(n), noise(count, Rgb(0));
  double total = 0;
  for (size_t i = 0; i < n; ++i) {
    area[i] = patches.patches[i].area * f.shares(i).exposed;
    nodeArea[level.nodeOf[i]] += area[i];
    mean[level.nodeOf[i]] += area[i] * b[i];
    total += area[i];
  }
  for (size_t i = 0; i < n; ++i) {
    const uint32_t g = level.nodeOf[i];
    change[i] = nodeArea[g] > 0 ? (b[i] - mean[g] / nodeArea[g]) / glm::max(meanH, Rgb(1e-300)) : Rgb(0);
    noise[g] += area[i] * change[i] * change[i] / samples;
  }
  // In parts that do not depend on threads: the least difference may decide what is split.
  constexpr size_t kParts = 32;
  std::vector<std::vector<Rgb>> ofPart(kParts, std::vector<Rgb>(count, Rgb(0)));
  tbb::parallel_for(size_t{0}, kParts, [&](size_t part) {
    std::vector<Rgb> row(count, Rgb(0));
    for (size_t i = part * n / kParts; i < (part + 1) * n / kParts; ++i) {
      f[i].forEach([&](size_t k, double value) { row[level.nodeOf[k]] += value * change[k]; });
      for (size_t g = 0; g < count; ++g) {
        ofPart[part][g] += area[i] * row[g] * row[g];
        row[g] = Rgb(0);
      }
    }
  });
  std::vector<Rgb> squares(count, Rgb(0));
  for (const std::vector<Rgb>& sums : ofPart) {
    for (size_t g = 0; g < count; ++g) squares[g] += sums[g];
  }
  for (size_t g = 0; g < count; ++g)
    level.nodes[g].cost = std::max(0.0, maxChannel(squares[g] - noise[g])) / std::max(total, 1e-300);
}

// H varies across a patch, and its mean hides that from whoever looks at a picture, which is smooth between patches and so
// brings most of it back: a hundredth of the mean square counts. What is hidden falls with the size; what is seen of it lacks
// that of the grid, `steps` halvings below.
void addHidden(const FormFactorMatrix& f, const PatchSet& patches, const Solution& solution, const Rgb& meanH, uint32_t steps,
               Level& level) {
  constexpr double kCounts = 0.01;
  std::vector<double> area(level.nodes.size(), 0.0);
  std::vector<Rgb> sum(level.nodes.size(), Rgb(0)), squares = sum;
  double total = 0;
  for (size_t i = 0; i < patches.size(); ++i) {
    const double a = patches.patches[i].area * f.shares(i).exposed;
    const Rgb h = solution.irradiance[i] / glm::max(meanH, Rgb(1e-300));
    area[level.nodeOf[i]] += a;
    sum[level.nodeOf[i]] += a * h;
    squares[level.nodeOf[i]] += a * h * h;
    total += a;
  }
  const double seen = 1 - std::pow(4.0, -static_cast<double>(steps));
  for (size_t g = 0; g < level.nodes.size(); ++g) {
    if (area[g] > 0)
      level.nodes[g].cost += kCounts / seen * std::max(0.0, maxChannel(squares[g] - sum[g] * sum[g] / area[g])) / total;
  }
}

}  // namespace

AdaptedPatches adaptPatches(const FacetSet& facets, const PatchSet& patches, uint32_t level, const FormFactorMatrix& f,
                            const DirectLight& direct, const Solution& solution, double samples, double order, double error) {
  std::vector<Rgb> b = solution.radiosity;
  Rgb meanH(0);
  double area = 0;
  for (size_t i = 0; i < b.size(); ++i) {
    if (direct.isApart(i)) b[i] -= patches.patches[i].emission;
    const double a = patches.patches[i].area * f.shares(i).exposed;
    meanH += a * solution.irradiance[i];
    area += a;
  }
  meanH /= std::max(area, 1e-300);

  std::vector<Level> levels;
  for (uint32_t l = 0; l < level; ++l) {
    levels.push_back(levelOf(facets, patches, level - l, l));
    addCosts(f, patches, b, meanH, samples, levels.back());
  }
  // Nodes err together: what joining all of them does tells by how much more than each alone. What is seen of a node's cost
  // lacks that of the grid itself.
  double sum = 0;
  for (const Node& node : levels.back().nodes) sum += node.cost;
  const double together = joiningError(f, patches, direct, solution, levels.back().nodeOf).relative;
  const double scale = sum > 0 ? together * together / sum : 1;
  for (uint32_t l = 0; l < level; ++l) {
    const double seen = 1 - std::pow(2.0, -order * (level - l));
    for (Node& node : levels[l].nodes) node.cost *= scale / (seen * seen);
  }
  for (uint32_t l = 0; l < level; ++l) addHidden(f, patches, solution, meanH, level - l, levels[l]);
  std::vector<std::vector<std::vector<uint32_t>>> parts(level);  // of a node, in the next level
  for (uint32_t l = 0; l + 1 < level; ++l) {
    parts[l].resize(levels[l].nodes.size());
    std::vector<bool> seen(levels[l + 1].nodes.size(), false);
    for (size_t p = 0; p < patches.size(); ++p) {
      const uint32_t part = levels[l + 1].nodeOf[p];
      if (!seen[part]) parts[l][levels[l].nodeOf[p]].push_back(part);
      seen[part] = true;
    }
  }

  // What a node's parts cost, the node costs.
  for (uint32_t l = level - 1; l-- > 0;) {
    for (size_t g = 0; g < levels[l].nodes.size(); ++g) {
      double ofParts = 0;
      for (const uint32_t part : parts[l][g]) ofParts += levels[l + 1].nodes[part].cost;
      levels[l].nodes[g].cost = std::max(levels[l].nodes[g].cost, ofParts);
    }
  }

  // Splits what costs most until little enough is left.
  struct Leaf {
    Node node;
    uint32_t place;  // in its level, above the grid
    bool operator<(const Leaf& o) const { return node.cost < o.node.cost; }
  };
  std::priority_queue<Leaf> leaves;
  AdaptedPatches result;
  const double belowGrid = std::pow(2.0, -2 * order);  // cost of all four parts, over that of the whole
  double left = 0;
  const auto add = [&](const Node& node, uint32_t place) {
    leaves.push({node, place});
    left += node.cost;
    ++result.patches;
  };
  for (uint32_t k = 0; k < levels[0].nodes.size(); ++k) add(levels[0].nodes[k], k);
  while (!leaves.empty() && left > error * error) {
    const Leaf leaf = leaves.top();
    leaves.pop();
    if (leaf.node.level >= PatchTree::kMostLevels) continue;  // its cost stays
    result.tree.split(leaf.node.facet, leaf.node.back, leaf.node.level, leaf.node.cell);
    left -= leaf.node.cost;
    --result.patches;
    if (leaf.node.level + 1 < level) {
      for (const uint32_t part : parts[leaf.node.level][leaf.place]) add(levels[leaf.node.level + 1].nodes[part], part);
      continue;
    }
    CellGrid grid = patches.grids[leaf.node.facet];  // at the node's level
    for (uint32_t* side : {&grid.nu, &grid.nv}) *side = *side >> level << leaf.node.level;
    for (const uint32_t part : finerCells(grid, facets.facets[leaf.node.facet].parallelogram, leaf.node.cell))
      add({leaf.node.facet, leaf.node.level + 1, part, leaf.node.back, 0.25 * belowGrid * leaf.node.cost}, 0);
  }
  result.error = std::sqrt(std::max(left, 0.0));
  return result;
}

}  // namespace farol
