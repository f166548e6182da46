// Planar mirrors by the method of images: what a hemicube sees in a mirror is what it would see from its own mirror image
// through the mirror's outline, on and on.
#pragma once

#include "formfactor/hybrid.h"
#include "trace/planar_mirrors.h"

namespace farol {

// One image of a hemicube. Parents come before their images; -1: the hemicube itself.
struct MirrorImage {
  HemicubePose pose;        // reflected: left-handed after an odd number of mirrors
  Vec3 clipNormal{0};       // only what lies in front of the mirror's plane is seen in it
  double clipDistance = 0;  // [unit coordinates]
  int parent = -1;
  uint32_t mirror = 0, root = 0;  // the mirror in which the parent shows it, and the first of all
  Rgb weight{1};                  // product of reflectances
  bool flipped = false;           // left-handed
};

class ImageTrees {
 public:
  // Throws Error naming the surface where light passes, or where a mirror is curved: its facets meet at shallow angles; and where
  // mirrors lie in too many planes.
  ImageTrees(const Scene& scene, const FacetSet& facets, const PatchSet& patches, const TreeLimits& limits, uint32_t maxImages);

  // At most `most` images of a hemicube, those of the largest weight times solid angle: mirrors that it, or one of the
  // images, may see through the outline of the last mirror (beams clipped as polygons).
  std::vector<MirrorImage> of(const HemicubePose& pose) const;

  uint32_t most() const { return maxImages_; }
  const std::vector<uint32_t>& mirrorOfPatch() const { return mirrors_.ofPatch(); }  // kNone: no mirror
  size_t mirrorCount() const { return mirrors_.all().size(); }

 private:
  using Polygon = std::vector<Vec3>;
  struct Node;
  void grow(const HemicubePose& pose, const Node* from, int parent, std::vector<Node>& queue) const;

  const TreeLimits limits_;
  const uint32_t maxImages_;
  const PlanarMirrors mirrors_;
};

}  // namespace farol
