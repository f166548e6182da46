// The camera's picture of a solved scene. Which facet each sample sees, and where, is rasterized on the Vulkan
// device; its radiance (E + rho H) / pi, with H smooth and E and rho from the material at that very point, is
// evaluated on the CPU: there the material has its one implementation, and there paths go on from mirrors and glass.
#pragma once

#include "base/image.h"
#include "gpu/gpu.h"
#include "solve/node_irradiance.h"
#include "trace/ray_tree.h"

namespace farol {

struct ViewOptions {
  uint32_t width = 1280, height = 720;
  uint32_t samples = 4;               // along an edge of a pixel
  Rgb sky{0};                         // radiosity of the background
  const RayTree* tree = nullptr;      // the second pass: what mirrors and glass show, traced from the camera; none: black
  const PatchSet* patches = nullptr;  // for either of the two
  // Colours to show instead of light, flat per patch.
  const std::vector<Rgb>* colors = nullptr;
};

// Linear radiance per pixel.
Image renderView(const gpu::Device& device, const Scene& scene, const FacetSet& facets, const NodeIrradiance& irradiance,
                 const Camera& camera, const ViewOptions& options, const Log& log);

}  // namespace farol
