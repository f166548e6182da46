// Form factors of a test scene by raster, on one Vulkan device for the whole test program.
#pragma once

#include "factor_run.h"
#include "formfactor/raster.h"

namespace farol::test {

// Opened on first use, with the validation layer when the environment asks for it; any message of the layer fails
// the test program (raster_run.cpp adds the check).
const gpu::Device& device();

struct RasterRun : FactorRun {
  RasterRun(Scene s, const PatchOptions& patchOptions, const RasterOptions& rasterOptions)
      : FactorRun(std::move(s), patchOptions), options(rasterOptions) {}
  std::unique_ptr<RowMaker> maker() override { return std::make_unique<RasterRowMaker>(device(), facets, patches, options); }

  RasterOptions options;
};

}  // namespace farol::test
