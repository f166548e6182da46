#include "reference/gathering.h"

#include "base/machine.h"
#include "base/sobol.h"
#include "trace/cover.h"

#include <tbb/parallel_for.h>

namespace farol {

HError errorOf(const std::vector<Rgb>& irradiance, const PatchSet& patches, const GatheredIrradiance& truth) {
  Rgb product(0), mean(0), noise(0), spread(0);
  double area = 0;
  for (size_t i = 0; i < patches.size(); ++i) {
    const double a = patches.patches[i].area * truth.exposed[i];
    if (a <= 0) continue;
    const Rgb &first = truth.half[0][i], &second = truth.half[1][i];
    const Rgb variance = 0.5 * (first - second) * (first - second);  // of one half
    product += a * (irradiance[i] - first) * (irradiance[i] - second);
    mean += 0.5 * a * (first + second);
    noise += a * a * variance * variance;
    spread += a * 0.5 * variance;
    area += a;
  }
  HError result;
  for (int c = 0; c < 3; ++c) {
    if (!(mean[c] > 0)) continue;
    const double scale = area / mean[c];
    result.error = std::max(result.error, std::sqrt(std::max(0.0, product[c]) / area) * scale);
    // The mean of squares of variances counts each three times too much: a normal difference's fourth power.
    result.noise = std::max(result.noise, std::sqrt(2 * std::sqrt(noise[c] / 3) / area) * scale);
    result.standardError = std::max(result.standardError, std::sqrt(spread[c] / area) * scale);
  }
  return result;
}

namespace {

struct Sums {
  std::array<std::vector<Rgb>, 2> half;
  std::array<std::vector<double>, 2> exposed;  // area-weighted points
  std::vector<double> all;
};

}  // namespace

std::vector<GatheredIrradiance> gatherIrradiance(const PathGatherer& gatherer, const Tracer& tracer, const FacetSet& facets,
                                                 std::span<const PatchSet* const> sets, double seconds, uint64_t seed,
                                                 const std::function<void(double)>& done) {
  const PatchSet& fine = *sets[0];
  const size_t cells = fine.cells.size();
  constexpr int kCoverSamples = 64;
  const ExposedArea cover = findExposedArea(tracer, facets, fine, kCoverSamples, seed);
  std::vector<Sums> sums(sets.size());
  for (size_t s = 0; s < sets.size(); ++s) {
    for (auto& half : sums[s].half) half.assign(sets[s]->size(), Rgb(0));
    for (auto& exposed : sums[s].exposed) exposed.assign(sets[s]->size(), 0.0);
    sums[s].all.assign(sets[s]->size(), 0.0);
  }
  std::vector<GatherPath> paths(cells);
  std::vector<uint8_t> counts(cells);
  const Stopwatch watch;
  constexpr uint32_t kFewest = 8;
  constexpr size_t kPart = 256;
  uint32_t passes = 0;
  for (; passes < kFewest || watch.seconds() < seconds; ++passes) {
    const uint32_t half = passes % 2;
    const auto x = sobolPoint<kSobolDimensions>(passes / 2);
    tbb::parallel_for(size_t{0}, (cells + kPart - 1) / kPart, [&](size_t part) {
      std::vector<GatherPath> own;
      std::vector<size_t> place;
      for (size_t c = part * kPart; c < std::min(cells, (part + 1) * kPart); ++c) {
        const Cell& cell = fine.cells[c];
        const Facet& facet = facets.facets[cell.facet];
        // A shift of Sobol's points of its own for every cell and half.
        const uint64_t key = mixBits(mixBits(seed + 2 * c + half));
        std::array<double, kSobolDimensions> shifted;
        for (size_t d = 0; d < kSobolDimensions; ++d)
          shifted[d] = static_cast<double>(x[d] ^ static_cast<uint32_t>(mixBits(key + d))) * 0x1p-32 + 0x1p-33;
        double u = shifted[0], v = shifted[1];
        if (!facet.parallelogram && u + v > 1) {
          u = 1 - u;
          v = 1 - v;
        }
        GatherPath& path = paths[c];
        path = {
            cell.facet, cell.back, cellPoint(fine.grids[cell.facet], facet.parallelogram, cell, u, v), {}, mixBits(key ^ passes),
            Rgb(0)};
        std::copy(shifted.begin() + 2, shifted.end(), path.numbers.begin());
        const uint32_t patch = fine.cellMap[c];
        counts[c] = 0;
        if (patch == kNone || cover.share[patch] <= 0 || fine.patches[patch].passesAll()) continue;
        if (cover.share[patch] < 1) {
          const Vec3 point = facets.point(facet, path.uv.x, path.uv.y), normal = cell.back ? -facet.normal : facet.normal;
          if (insideObject(tracer, facets, std::span(&point, 1), normal, 0) != 0) continue;
        }
        counts[c] = 1;
        own.push_back(path);
        place.push_back(c);
      }
      gatherer.gather(own);
      for (size_t k = 0; k < own.size(); ++k) paths[place[k]] = own[k];
    });
    tbb::parallel_for(size_t{0}, sets.size(), [&](size_t s) {
      const PatchSet& set = *sets[s];
      for (size_t c = 0; c < cells; ++c) {
        const GatherPath& path = paths[c];
        const CellGrid& grid = set.grids[path.facet];
        const uint32_t first = path.back ? grid.backCell : grid.frontCell;
        if (first == kNone) continue;
        const uint32_t patch = set.cellMap[first + cellAt(grid, facets.facets[path.facet].parallelogram, path.uv.x, path.uv.y)];
        if (patch == kNone) continue;
        const double area = cellArea(facets, fine.grids[path.facet], path.facet);
        sums[s].all[patch] += area;
        if (counts[c] == 0) continue;
        sums[s].exposed[half][patch] += area;
        sums[s].half[half][patch] += area * path.irradiance;
      }
    });
    done(watch.seconds());
  }
  std::vector<GatheredIrradiance> result(sets.size());
  for (size_t s = 0; s < sets.size(); ++s) {
    GatheredIrradiance& g = result[s];
    const size_t n = sets[s]->size();
    g.paths = passes;
    g.exposed.assign(n, 0.0);
    for (size_t h = 0; h < 2; ++h) g.half[h].assign(n, Rgb(0));
    for (size_t i = 0; i < n; ++i) {
      const auto& e = sums[s].exposed;
      if (e[0][i] <= 0 || e[1][i] <= 0) continue;  // covered, or hardly ever met
      g.exposed[i] = (e[0][i] + e[1][i]) / sums[s].all[i];
      for (size_t h = 0; h < 2; ++h) g.half[h][i] = sums[s].half[h][i] / e[h][i];
    }
  }
  return result;
}

void addFollowed(const PathGatherer& gatherer, const PatchSet& patches, double seconds, uint64_t seed,
                 GatheredIrradiance& gathered) {
  if (!gatherer.leavesOut()) return;
  std::array<std::vector<Rgb>, 2> sums;
  for (auto& sum : sums) sum.assign(patches.size(), Rgb(0));
  const Stopwatch watch;
  uint32_t rounds = 0;
  do {
    for (size_t h = 0; h < 2; ++h) {
      constexpr size_t kRays = size_t{1} << 20;
      const SpecularLight light = gatherer.follow(patches, gathered.exposed, kRays, mixBits(seed + 2 * rounds + h));
      for (size_t i = 0; i < patches.size(); ++i) sums[h][i] += light.irradiance[i];
    }
    ++rounds;
  } while (watch.seconds() < seconds);
  for (size_t h = 0; h < 2; ++h) {
    for (size_t i = 0; i < patches.size(); ++i) gathered.half[h][i] += sums[h][i] / static_cast<double>(rounds);
  }
}

}  // namespace farol
