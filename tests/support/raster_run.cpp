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

}  // namespace

const gpu::Device& device() {
  if (!sharedDevice()) sharedDevice().emplace();
  return *sharedDevice();
}

}  // namespace farol::test
