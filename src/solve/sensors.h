// Irradiance at points of the user's own: a lighting engineer's work plane.
#pragma once

#include "solve/solver.h"
#include "trace/ray_tree.h"

namespace farol {

struct Sensor {
  Vec3 position{0}, normal{0, 0, 1};  // [scene units], unit vector
};

struct SensorReading {
  Rgb irradiance{0};  // [flux per area]
  double error = 0;   // estimated standard error, worst channel
};

struct SensorOptions {
  uint32_t rays = 4096;        // per sensor, over the hemisphere
  uint32_t shadowRays = 1024;  // per sensor, to lamps
  uint64_t seed = 1;
  Rgb sky{0};
};

// H at each sensor: direct light as for patches, at the point, plus what rays over the hemisphere bring from the solved
// radiosity of the patches they meet. The error comes from the means of 16 blocks of rays and the shadow rays' spread.
std::vector<SensorReading> readSensors(const RayTree& tree, const Tracer& tracer, const FacetSet& facets, const PatchSet& patches,
                                       const DirectIrradiance& lamps, const DirectLight& direct, const Solution& solution,
                                       std::span<const Sensor> sensors, const SensorOptions& options);

}  // namespace farol
