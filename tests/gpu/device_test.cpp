#include "base/error.h"
#include "raster_run.h"

#include <gmock/gmock.h>

namespace farol::test {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

TEST(DeviceChoice, ListsWhatTheMachineHas) {
  const auto devices = gpu::listDevices();
  ASSERT_FALSE(devices.empty());
  for (const gpu::DeviceInfo& d : devices) {
    EXPECT_FALSE(d.name.empty());
    EXPECT_FALSE(d.type.empty());
  }
}

TEST(DeviceChoice, FindsADeviceByPartOfItsNameAndByIndex) {
  const gpu::DeviceInfo wanted = device().info();
  EXPECT_EQ(gpu::Device(wanted.name.substr(0, 5)).info().name, wanted.name);
  EXPECT_EQ(gpu::Device(std::to_string(wanted.index)).info().name, wanted.name);
}

TEST(DeviceChoice, GivesAReasonPerDeviceWhenNoneFits) {
  EXPECT_THAT([] { gpu::Device("no such device"); },
              ThrowsMessage<Error>(
                  ::testing::AllOf(HasSubstr("no usable Vulkan device 'no such device'"), HasSubstr(device().info().name))));
}

}  // namespace
}  // namespace farol::test
