#include "cli/sample_counts.h"

#include <algorithm>
#include <cmath>

namespace farol {

using Kind = MethodSpec::Kind;

uint32_t evenCount(double worth, uint32_t least, uint32_t most) {
  uint32_t count = least;
  while (count < most && count < worth) count *= 2;
  return 0.625 * count >= worth ? std::max(least, count / 4 * 3) : count;
}

double worthOf(double count) {
  const double power = std::exp2(std::floor(std::log2(count)));
  return power * (1 + 0.5 * (count / power - 1));
}

double worthOf(const MethodSpec& spec) { return spec.kind == Kind::rays ? worthOf(spec.rays) : samplesOf(spec); }

// With rays, from one power of two to the next: 0.65 to 0.74 in the Cornell box and the L-shaped room of 800 to 8,000 patches.
double orderOf(const MethodSpec& spec) {
  constexpr double kHemicubeOrder = 0.5, kRayOrder = 0.65;
  return spec.kind == Kind::rays ? kRayOrder : kHemicubeOrder;
}

void scaleSamples(MethodSpec& spec, double factor) {
  if (spec.kind == Kind::rays) {
    spec.rays = evenCount(worthOf(spec.rays) * factor, 16, kMostRays);
  } else if (spec.hemicubes()) {
    // Beyond 128 pixels an edge more points of the patch do more.
    constexpr double kEnough = 128;
    double edge = spec.resolution * std::sqrt(factor);
    while (edge > kEnough && spec.positions < 16) {
      const int more = spec.positions == 1 ? 4 : spec.positions == 4 ? 9 : 16;
      edge *= std::sqrt(static_cast<double>(spec.positions) / more);
      spec.positions = more;
    }
    spec.resolution = static_cast<uint32_t>(std::clamp(2 * std::ceil(edge / 2), 16.0, 1024.0));
  }
}

}  // namespace farol
