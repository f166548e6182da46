// Emitters that are treated apart: B = E + R, where E of small bright lamps reaches every patch directly, by closed
// form and shadow rays, and F carries what is reflected (R) only.
#pragma once

#include "patch/patches.h"

#include <span>
#include <string>
#include <vector>

namespace farol {

// A flat emitter of uniform exitance: one side of a facet, or of a cell where emission varies over the facet.
struct Lamp {
  std::vector<Vec3> polygon;  // counter-clockwise from the side that emits [unit coordinates]
  Vec3 normal{0}, centre{0};
  double area = 0;                // [unit coordinates squared]
  double radius = 0;              // around the centre [unit coordinates]
  Rgb emission{0};                // exitance E [flux per area]
  uint32_t facet = 0;             // that it is, or is a cell of
  std::vector<uint32_t> mirrors;  // of an image: those on the way to the lamp (lamp_images.h)
};

struct LampPlan {
  std::vector<Lamp> lamps;     // those apart
  std::vector<uint8_t> apart;  // [patches] 1: the patch's own emission is theirs
  size_t emitters = 0;         // lamps that could be apart
  std::string why;
};

// What a row costs and samples, for the prediction.
struct LampBudget {
  double samplesPerRow = 256;  // rays or pixels
  double secondsPerRow = 8e-6;
  double shadowRays = 64;  // per patch
};

// Emitters go apart from the brightest down as long as that makes (predicted variance of H) x (time per patch) smaller.
// Leaving a set in F costs the variance of E over a row's samples: sum f E^2 - (sum f E)^2, where f is the share of
// all area; a lamp apart costs a closed form and its part of the shadow rays. At most 5 % of all area goes apart: light
// from all around, such as a glowing ceiling or a furnace, is what rows sample well. At most 256 lamps.
LampPlan chooseLamps(const FacetSet& facets, const PatchSet& patches, const LampBudget& budget);

}  // namespace farol
