// The two ways to project the hemisphere above a patch onto flat faces that a GPU can rasterize, and the
// exact form factor of every pixel.
#pragma once

#include "base/math.h"

#include <array>
#include <cstdint>
#include <vector>

namespace farol {

enum class Projection {
  hemicube,     // Cohen and Greenberg 1985: top R x R, four sides R x R/2
  tetrahedron,  // Beran-Koehn and Pavicic 1991, cubic tetrahedron: three R x R faces, half of each above the horizon
};

// One face in the local frame (x, y, normal). `right` x `up` = `forward`, so that faces are not mirrored.
// At depth 1 along `forward` the face covers [low, 1] x [bottom, 1] in (right, up).
struct ProjectionFace {
  Vec3 right{0}, up{0}, forward{0};
  double low = -1, bottom = -1;
  uint32_t x = 0, y = 0, width = 0, height = 0;  // place in the atlas [pixels]
};

// All faces side by side: an atlas of 3R x R pixels for both projections.
struct ProjectionLayout {
  uint32_t width = 0, height = 0;
  std::vector<ProjectionFace> faces;
};
ProjectionLayout layoutOf(Projection projection, uint32_t resolution);

// Exact delta form factor of every pixel of the atlas, summing to 1 [height x width]. A tetrahedron's pixels
// below the horizon have 0; a pixel cut by the horizon gives its half to its two neighbours above, because
// its own centre lies on the horizon and sees nothing dependable.
std::vector<double> deltaFormFactors(Projection projection, uint32_t resolution);

// The same as integers that sum to exactly 2^32 - 1 (largest remainder).
std::vector<uint32_t> quantisedFormFactors(Projection projection, uint32_t resolution);

}  // namespace farol
