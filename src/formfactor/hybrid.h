// Raster and rays combined: an item buffer finds what a hemicube sees first, and paths go on from the pixels that landed
// on mirrors and glass (after Sillion and Puech 1989).
#pragma once

#include "formfactor/form_factors.h"
#include "formfactor/projection.h"
#include "trace/ray_tree.h"

#include <array>

namespace farol {

// Where one hemicube stands: a right-handed frame with z along the patch normal [unit coordinates].
struct HemicubePose {
  Vec3 origin, x, y, z;
};

// What paths add to the entries of a row, for up to three channels.
class ContinuedEntries : public PathSink {
 public:
  void clear(size_t patches, int channels);
  void met(const PathHit& hit) override {
    for (int c = 0; c < channels_; ++c) sums_[static_cast<size_t>(c)][hit.patch] += hit.weight[c];
  }
  const std::vector<double>& of(int c) const { return sums_[static_cast<size_t>(c)]; }
  int channels() const { return channels_; }

  PathEnds ends;
  double specular = 0;  // weight that paths went on from

 private:
  int channels_ = 1;
  std::array<std::vector<double>, 3> sums_;
};

class PixelPaths {
 public:
  // The references must outlive this.
  PixelPaths(const RayTree& tree, const FacetSet& facets, const PatchSet& patches, const ProjectionLayout& layout,
             const std::vector<uint32_t>& deltaFactors);

  // Follows the pixels of an item buffer that show something specular. A pixel carries its delta form factor times
  // `weight` times, where `factors` is not empty [patches], the factor of the patch that it shows. `medium`: what the
  // hemicube stands in.
  void follow(const uint32_t* items, const HemicubePose& pose, double weight, std::span<const double> factors, uint32_t medium,
              ContinuedEntries& entries) const;

 private:
  const RayTree& tree_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  const ProjectionLayout& layout_;
  std::vector<double> deltaFactors_;    // [pixels], adding up to 1
  std::vector<uint8_t> specularItems_;  // [cells + 2]
};

}  // namespace farol
