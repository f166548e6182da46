#include "formfactor/hemicube_rows.h"

#include "formfactor/near_field.h"

#include <algorithm>
#include <cmath>
#include <tbb/parallel_for.h>

namespace farol {

HemicubePose poseOf(const Hemicube& h, const Vec3& normal) {
  const Vec3 t = anyPerpendicular(normal), b = glm::cross(normal, t);
  const double c = std::cos(h.turn), s = std::sin(h.turn);
  return {h.point, c * t + s * b, c * b - s * t, normal};
}

HemicubeRows::HemicubeRows(const FacetSet& facets, const PatchSet& patches, const RasterOptions& options,
                           const ProjectionLayout& layout, uint32_t bins, uint32_t mostListed)
    : patches_(patches), options_(options), pixels_(layout.width * layout.height), bins_(bins), mostListed_(mostListed) {
  if (options.tree != nullptr)
    paths_.emplace(*options.tree, facets, patches, layout, quantisedFormFactors(options.projection, options.resolution));
}

SeenCounts HemicubeRows::countsOf(const SeenBatch& batch, size_t k) const {
  if (mostListed_ == 0) return SeenCounts::all(batch.counts.subspan(k * bins_, bins_), patches_.size());
  const size_t words = 2 * (size_t{1} + mostListed_);
  return SeenCounts::listed(batch.counts.subspan(k * words, words), patches_.size());
}

// Exposed share of a patch: measured beforehand, or what its positions say.
double HemicubeRows::exposedShare(uint32_t patch, double positions) const {
  return options_.exposed != nullptr ? std::min(static_cast<double>(options_.exposed->share[patch]), positions > 0 ? 1.0 : 0.0)
                                     : positions;
}

// Adds what paths find from the batch's k-th hemicube; `factors` as for PixelPaths.
void HemicubeRows::addPaths(const SeenBatch& batch, size_t k, double weight, std::span<const double> factors,
                            ContinuedEntries& to) const {
  const Hemicube& h = batch.hemicubes[k];
  paths_->follow(batch.items.data() + k * pixels_, poseOf(h, patches_.patches[h.patch].normal), weight, factors,
                 options_.tree->mediumBehind(h.patch), to);
}

// Adds what the images of the batch's k-th hemicube show. A mirror's pixels of which there is no image are cut.
void HemicubeRows::addImages(const SeenBatch& batch, size_t k, double weight, std::span<const double> factors,
                             ContinuedEntries& to) const {
  const std::vector<uint32_t>& mirrorOf = options_.images->mirrorOfPatch();
  const auto hemicubes = batch.hemicubes;
  size_t end = k + 1;
  while (end < hemicubes.size() && hemicubes[end].isImage) ++end;
  // Where the near field changes what is seen of a mirror first, all that it shows is as much more or less.
  std::vector<double> before(options_.images->mirrorCount(), 0.0), after = before;
  const auto countsAt = [&](size_t l) { return batch.counts.data() + l * bins_; };
  for (size_t j = 0; j < mirrorOf.size(); ++j) {
    if (mirrorOf[j] == kNone) continue;
    const double seen = countsAt(k)[j] / kFullHemisphere;
    before[mirrorOf[j]] += seen;
    after[mirrorOf[j]] += seen * (factors.empty() ? 1.0 : factors[j]);
  }
  for (const double seen : after) to.specular += weight * seen;
  std::vector<uint8_t> shown(options_.images->mirrorCount());
  for (size_t l = k; l < end; ++l) {
    const Hemicube& h = hemicubes[l];
    const uint32_t* counts = countsAt(l);
    const uint32_t root = h.image.root;
    const double change = h.isImage && before[root] > 0 ? after[root] / before[root] : 1.0;
    const Rgb carried = weight * change / kFullHemisphere * (h.isImage ? h.image.weight : Rgb(1));
    std::fill(shown.begin(), shown.end(), uint8_t{0});
    for (size_t c = k + 1; c < end; ++c) {
      if (hemicubes[c].parent == l) shown[hemicubes[c].image.mirror] = 1;
    }
    for (size_t j = 0; j < mirrorOf.size(); ++j) {
      if (counts[j] == 0) continue;
      if (h.isImage) to.met({0, static_cast<uint32_t>(j), false, 0, 0, carried * static_cast<double>(counts[j])});
      if (mirrorOf[j] == kNone || shown[mirrorOf[j]] != 0) continue;
      const double first = h.isImage || factors.empty() ? 1.0 : factors[j];
      to.ends.cut += carried * (first * counts[j]) * patches_.patches[j].mirror;
    }
    if (!h.isImage) continue;
    const size_t nothing = patches_.size();
    to.ends.missed += carried * static_cast<double>(counts[nothing]);
    to.ends.backs += carried * static_cast<double>(counts[nothing + 1]);
  }
}

// With paths or images: where the near field changes what is seen first, paths from there carry as much more or less.
void HemicubeRows::storeSingleHybrid(const SeenBatch& batch, size_t k, RowStore& store) {
  const uint32_t patch = batch.hemicubes[k].patch;
  const SeenCounts seen = countsOf(batch, k);
  const uint32_t* counts = batch.counts.data() + k * bins_;
  const double share = seen.insideSolid() ? 0 : exposedShare(patch, 1);
  RowAccumulator& scratchRow = scratch_.local();
  scratchRow.continued.clear(patches_.size(), store.channel(1) != nullptr ? 3 : 1);
  std::vector<float> row(patches_.size(), 0.0f);
  RowShares shares{0, 0, 0};
  if (share > 0) {
    for (size_t j = 0; j < row.size(); ++j) row[j] = static_cast<float>(counts[j] / kFullHemisphere);
    shares = {seen.missed / kFullHemisphere, seen.backs / kFullHemisphere, share};
    if (options_.nearField != nullptr) options_.nearField->correct(patch, row, shares);
    std::vector<double> factors(row.size(), 1.0);
    for (size_t j = 0; j < row.size(); ++j) {
      if (counts[j] > 0) factors[j] = static_cast<double>(row[j]) * kFullHemisphere / counts[j];
    }
    if (paths_) addPaths(batch, k, 1, factors, scratchRow.continued);
    if (options_.images != nullptr) addImages(batch, k, 1, factors, scratchRow.continued);
  }
  const std::vector<double> first(row.begin(), row.end());
  RowAccumulator::storeContinued(store, patch, first, scratchRow.continued, 1, shares);
}

// One position: no sum to keep.
void HemicubeRows::storeSingle(const SeenBatch& batch, size_t k, RowStore& store) const {
  const uint32_t patch = batch.hemicubes[k].patch;
  const SeenCounts seen = countsOf(batch, k);
  const double share = seen.insideSolid() ? 0 : exposedShare(patch, 1);
  RowShares shares{0, 0, 0};
  if (share > 0) shares = {seen.missed / kFullHemisphere, seen.backs / kFullHemisphere, share};
  if (seen.isList) {
    static thread_local std::vector<uint32_t> ids;
    static thread_local std::vector<float> values;
    ids.clear();
    values.clear();
    if (share > 0) {
      seen.forEach([&](size_t j, uint32_t count) {
        ids.push_back(static_cast<uint32_t>(j));
        values.push_back(static_cast<float>(count / kFullHemisphere));
      });
      if (options_.nearField != nullptr) options_.nearField->correct(patch, ids, values, shares);
    }
    store.entries(patch, ids, values);
  } else {
    const std::span<float> row = store.row(patch);
    if (share <= 0) std::fill(row.begin(), row.end(), 0.0f);
    if (share > 0) {
      seen.forEach([&](size_t j, uint32_t count) { row[j] = static_cast<float>(count / kFullHemisphere); });
      if (options_.nearField != nullptr) options_.nearField->correct(patch, row, shares);
    }
  }
  store.finish(patch, shares);
}

void HemicubeRows::storeSum(RowAccumulator& row, RowStore& store, uint32_t patch) const {
  row.store(store, patch, exposedShare(patch, row.exposed));
}

void HemicubeRows::store(const SeenBatch& batch, RowStore& store) {
  const std::span<const Hemicube> hemicubes = batch.hemicubes;
  struct Run {
    size_t first, last;  // hemicubes of one patch
  };
  std::vector<Run> runs;
  for (size_t k = 0; k < hemicubes.size(); ++k) {
    if (k == 0 || hemicubes[k - 1].last) runs.push_back({k, k});
    runs.back().last = k;
  }
  const auto addRun = [&](const Run& run, RowAccumulator& to) {
    for (size_t k = run.first; k <= run.last; ++k) {
      if (hemicubes[k].isImage) continue;
      const SeenCounts seen = countsOf(batch, k);
      to.add(seen, hemicubes[k].weight);
      if (seen.insideSolid()) continue;
      if (paths_) addPaths(batch, k, hemicubes[k].weight, {}, to.continued);
      if (options_.images != nullptr) addImages(batch, k, hemicubes[k].weight, {}, to.continued);
    }
  };
  const int channels = store.channel(1) != nullptr ? 3 : 1;
  const auto clear = [&](RowAccumulator& to) {
    to.clear(patches_.size(), mostListed_ > 0);
    if (continues()) to.continued.clear(patches_.size(), channels);
  };
  const auto open = [&](size_t r) { return !hemicubes[runs[r].last].last || (r == 0 && carrying_); };
  tbb::parallel_for(size_t{0}, runs.size(), [&](size_t r) {
    if (open(r)) return;
    if (options_.positions == 1)
      return continues() ? storeSingleHybrid(batch, runs[r].first, store) : storeSingle(batch, runs[r].first, store);
    RowAccumulator& row = scratch_.local();
    clear(row);
    addRun(runs[r], row);
    storeSum(row, store, hemicubes[runs[r].first].patch);
  });
  for (size_t r = 0; r < runs.size(); ++r) {
    if (!open(r)) continue;
    if (!carrying_) clear(carry_);
    addRun(runs[r], carry_);
    carrying_ = !hemicubes[runs[r].last].last;
    if (!carrying_) storeSum(carry_, store, hemicubes[runs[r].first].patch);
  }
}

}  // namespace farol
