// A picture in linear light.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace farol {

struct Image {
  uint32_t width = 0, height = 0;
  std::vector<float> rgb;  // 3 per pixel, rows from top to bottom; radiance [flux per area and steradian]

  float* pixel(uint32_t x, uint32_t y) { return &rgb[3 * (static_cast<size_t>(y) * width + x)]; }
  const float* pixel(uint32_t x, uint32_t y) const { return &rgb[3 * (static_cast<size_t>(y) * width + x)]; }
};

}  // namespace farol
