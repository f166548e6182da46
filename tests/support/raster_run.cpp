#include "raster_run.h"

#include <gtest/gtest.h>
#include <optional>

namespace farol::test {
namespace {

std::optional<gpu::Device>& sharedDevice() {
  static std::optional<gpu::Device> shared;
  return shared;
}

// After the last test: no message from the validation layer, then the device goes before its libraries do.
class DeviceGuard : public ::testing::Environment {
 public:
  void TearDown() override {
    if (!sharedDevice()) return;
    EXPECT_EQ(sharedDevice()->validationMessages(), 0u);
    sharedDevice().reset();
  }
};
[[maybe_unused]] const auto* const guard = ::testing::AddGlobalTestEnvironment(new DeviceGuard);

FacetSet quietFacets(const Scene& scene) {
  Log log(true);
  return buildFacets(scene, log);
}

}  // namespace

const gpu::Device& device() {
  if (!sharedDevice()) sharedDevice().emplace();
  return *sharedDevice();
}

RasterRun::RasterRun(Scene s, const PatchOptions& patchOptions, const RasterOptions& rasterOptions)
    : scene(std::move(s)),
      facets(quietFacets(scene)),
      patches(buildPatches(scene, facets, patchOptions)),
      f(patches.size()),
      options(rasterOptions) {}

std::vector<uint32_t> RasterRun::patchesOf(const std::string& surface) const {
  std::vector<uint32_t> found;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    const std::string name = surfaceNameOf(scene, patches.patches[i]);
    if (name == surface || name == surface + "~back") found.push_back(i);
  }
  return found;
}

double RasterRun::factor(const std::string& from, const std::string& to) {
  std::vector<uint32_t> gathering, missing;
  for (const uint32_t i : patchesOf(from)) {
    if (!patches.patches[i].back) gathering.push_back(i);
  }
  for (const uint32_t i : gathering) {
    if (f[i].empty()) missing.push_back(i);
  }
  if (!missing.empty()) RasterRowMaker(device(), facets, patches, options).makeRows(missing, f, [](size_t) {});
  const std::vector<uint32_t> targets = patchesOf(to);
  double sum = 0, area = 0;
  for (const uint32_t i : gathering) {
    double row = 0;
    for (const uint32_t j : targets) row += static_cast<double>(f[i][j]);
    sum += patches.patches[i].area * row;
    area += patches.patches[i].area;
  }
  return sum / area;
}

void RasterRun::makeAll() {
  RasterRowMaker maker(device(), facets, patches, options);
  makeFormFactors(maker, patches, false, Log(true), f);
}

}  // namespace farol::test
