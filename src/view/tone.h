// From linear radiance to what a screen shows. Policy of display only: nothing here flows back into physics.
#pragma once

#include "base/image.h"

#include <cstdint>
#include <vector>

namespace farol {

// The factor that brings the picture's lit parts to a pleasant brightness: their geometric mean becomes 0.18
// (Reinhard et al. 2002); 1 for a black picture.
double automaticScale(const Image& image);

// 8-bit sRGB, 3 per pixel: radiance times `scale`, linear up to 0.8, then a shoulder that approaches 1.
std::vector<uint8_t> toSrgb(const Image& image, double scale);

}  // namespace farol
