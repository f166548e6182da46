// Form factors of a test scene by raster, on one Vulkan device for the whole test program.
#pragma once

#include "formfactor/raster.h"
#include "test_scene.h"

namespace farol::test {

// Opened on first use, with the validation layer when the environment asks for it; any message of the layer fails
// the test program (raster_run.cpp adds the check).
const gpu::Device& device();

struct RasterRun {
  RasterRun(Scene scene, const PatchOptions& patchOptions, const RasterOptions& rasterOptions);

  // Area-weighted mean factor from one surface to another. Makes the rows it needs.
  double factor(const std::string& from, const std::string& to);
  std::vector<uint32_t> patchesOf(const std::string& surface) const;
  void makeAll();

  Scene scene;
  FacetSet facets;
  PatchSet patches;
  FormFactorMatrix f;
  RasterOptions options;
};

}  // namespace farol::test
