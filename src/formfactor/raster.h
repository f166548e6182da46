// Rows of F by rasterization: an item buffer per hemicube through the graphics pipeline, summed into rows by a
// compute shader. Visibility is exact to one pixel; the error against a point's true factors falls with the
// resolution R as about R^-1.1 (0.31 s^-0.57 for s pixels per visible patch).
#pragma once

#include "formfactor/form_factors.h"
#include "formfactor/projection.h"
#include "gpu/gpu.h"
#include "trace/cover.h"
#include "trace/ray_tree.h"

#include <memory>

namespace farol {

class ImageTrees;
class NearField;

struct RasterOptions {
  uint32_t resolution = 64;  // R, even, 8 to 1024: pixels along an edge of a hemicube's top
  Projection projection = Projection::hemicube;
  int positions = 1;                            // hemicubes per patch, spread over its area
  uint64_t seed = 1;                            // turns of the hemicubes about the normal
  uint64_t deviceMemory = uint64_t{256} << 20;  // for one batch [bytes]
  uint32_t maxBatch = 128;                      // hemicubes per submission; 0: as many as fit the memory
  bool layered = true;                          // draw all layers at once where the device can
  bool lists = true;                            // leave empty bins on the device where most are empty
  bool turned = true;                           // about the normal; otherwise grids are in step (for comparison)
  const NearField* nearField = nullptr;         // corrects rows of one position; must outlive the maker
  const RayTree* tree = nullptr;                // hybrid: paths go on from mirrors and glass; must outlive the maker
  const ImageTrees* images = nullptr;           // raster with planar mirrors; must outlive the maker
  const ExposedArea* exposed = nullptr;         // where partly covered patches are seen from; must outlive the maker
};

class RasterRowMaker : public RowMaker {
 public:
  // The arguments must outlive the maker. Where the device has less memory than `deviceMemory` allows, now or later,
  // batches become smaller; throws Error when it does not hold one hemicube.
  RasterRowMaker(const gpu::Device& device, const FacetSet& facets, const PatchSet& patches, const RasterOptions& options);
  ~RasterRowMaker() override;

  void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) override;

  uint32_t batchSize() const;    // hemicubes per submission, at most
  uint64_t deviceBytes() const;  // device memory in use for batches

 private:
  struct Impl;
  void build();
  void shrink(const gpu::OutOfMemory& why);  // batches to come; throws when they cannot get smaller

  const gpu::Device& device_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  RasterOptions options_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace farol
