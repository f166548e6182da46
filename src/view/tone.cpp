#include "view/tone.h"

#include <algorithm>
#include <cmath>

namespace farol {

double automaticScale(const Image& image) {
  double sum = 0, count = 0;
  for (size_t i = 0; i + 2 < image.rgb.size(); i += 3) {
    const double y = 0.2126 * static_cast<double>(image.rgb[i]) + 0.7152 * static_cast<double>(image.rgb[i + 1]) +
                     0.0722 * static_cast<double>(image.rgb[i + 2]);
    if (!(y > 0)) continue;
    sum += std::log(y);
    count += 1;
  }
  return count > 0 ? 0.18 / std::exp(sum / count) : 1.0;
}

std::vector<uint8_t> toSrgb(const Image& image, double scale) {
  std::vector<uint8_t> out(image.rgb.size());
  std::transform(image.rgb.begin(), image.rgb.end(), out.begin(), [scale](float radiance) {
    constexpr double kKnee = 0.8;
    double v = std::max(0.0, static_cast<double>(radiance) * scale);
    if (v > kKnee) v = 1 - (1 - kKnee) * std::exp(-(v - kKnee) / (1 - kKnee));  // same slope at the knee
    const double coded = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
    return static_cast<uint8_t>(std::lround(255 * std::min(coded, 1.0)));
  });
  return out;
}

}  // namespace farol
