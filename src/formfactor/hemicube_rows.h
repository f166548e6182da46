// Rows of F from what hemicubes saw, as shaders counted it. Internal to this room.
#pragma once

#include "formfactor/images.h"
#include "formfactor/raster.h"
#include "formfactor/row_accumulator.h"

#include <optional>
#include <span>
#include <tbb/enumerable_thread_specific.h>

namespace farol {

struct Hemicube {
  uint32_t patch;
  Vec3 point;  // [unit coordinates]
  double weight;
  double turn;  // about the normal [rad]
  bool last;    // of its patch
  MirrorImage image = {};
  bool isImage = false;
  uint32_t parent = kNone;  // an image's: place in the batch
};

HemicubePose poseOf(const Hemicube& h, const Vec3& normal);

// What a batch of hemicubes saw.
struct SeenBatch {
  std::span<const Hemicube> hemicubes;
  std::span<const uint32_t> counts;  // [hemicubes x bins]; with lists [hemicubes x (1 + most) x 2]
  std::span<const uint32_t> items;   // [hemicubes x pixels], for paths only
};

class HemicubeRows {
 public:
  // Bins: the patches, nothing seen, black backs, and with images what an image does not show. `mostListed` > 0: counts are
  // lists of the bins that hold something, at most so many. The references must outlive this.
  HemicubeRows(const FacetSet& facets, const PatchSet& patches, const RasterOptions& options, const ProjectionLayout& layout,
               uint32_t bins, uint32_t mostListed);

  // Stores the rows that the batch completes. A patch whose positions are cut by the batch's end is carried on to the next;
  // positions are always added in their order, so the rows do not depend on where batches end.
  void store(const SeenBatch& batch, RowStore& store);
  void forget() { carrying_ = false; }  // what was carried on

 private:
  SeenCounts countsOf(const SeenBatch& batch, size_t k) const;
  double exposedShare(uint32_t patch, double positions) const;
  void addPaths(const SeenBatch& batch, size_t k, double weight, std::span<const double> factors, ContinuedEntries& to) const;
  void addImages(const SeenBatch& batch, size_t k, double weight, std::span<const double> factors, ContinuedEntries& to) const;
  void storeSingle(const SeenBatch& batch, size_t k, RowStore& store) const;
  void storeSingleHybrid(const SeenBatch& batch, size_t k, RowStore& store);
  void storeSum(RowAccumulator& row, RowStore& store, uint32_t patch) const;
  bool continues() const { return paths_.has_value() || options_.images != nullptr; }

  const PatchSet& patches_;
  const RasterOptions& options_;
  uint32_t pixels_, bins_, mostListed_;
  std::optional<PixelPaths> paths_;  // hybrid
  tbb::enumerable_thread_specific<RowAccumulator> scratch_;
  RowAccumulator carry_;
  bool carrying_ = false;
};

}  // namespace farol
