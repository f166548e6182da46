// What stands behind gpu.h. Included by this room's sources only.
#pragma once

#include "gpu/gpu.h"

#define VK_NO_PROTOTYPES
#include <atomic>
#include <map>
#include <string>
#include <utility>
#include <volk.h>

namespace farol::gpu {

// Throws Error "failed to <operation>: <result>", or what is derived from it, unless the call succeeded.
void check(VkResult result, const std::string& operation);

struct Device::Impl {
  VkInstance instance = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
  bool debugNames = false;
  std::atomic<size_t> messages{0};

  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkPhysicalDeviceMemoryProperties memory{};
  DeviceInfo info;
  Limits limits;
  std::string cacheKey;  // pipeline cache UUID in hexadecimal

  VkDevice device = VK_NULL_HANDLE;
  VolkDeviceTable vk{};
  uint32_t queueFamily = 0;
  VkQueue queue = VK_NULL_HANDLE;
  VkCommandPool pool = VK_NULL_HANDLE;
  VkPipelineCache pipelineCache = VK_NULL_HANDLE;
  size_t loadedCacheBytes = 0;
  uint64_t mostAllocated = UINT64_MAX;      // faults to order (FAROL_DEVICE_FAULT): bytes at once,
  mutable uint64_t waitsLeft = UINT64_MAX;  // and waits until the device is lost

  ~Impl();

  template <typename Handle>
  void name(VkObjectType type, Handle handle, const std::string& text) const {
    setName(type, reinterpret_cast<uint64_t>(handle), text);
  }
  VkDeviceMemory allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags wanted, VkMemoryPropertyFlags preferred,
                          const std::string& what) const;

 private:
  void setName(VkObjectType type, uint64_t handle, const std::string& text) const;
};

// Pipeline cache on disk, under the user's cache folder. Failing to read or write it is not an error.
void loadPipelineCache(Device::Impl& device);
void savePipelineCache(const Device::Impl& device);

struct Buffer::Impl {
  const Device::Impl& device;
  VkBuffer buffer = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  uint64_t bytes = 0;
  std::byte* mapped = nullptr;

  explicit Impl(const Device::Impl& d) : device(d) {}
  ~Impl();
};

struct RasterTarget::Impl {
  struct Image {
    VkImage image = VK_NULL_HANDLE;
    VkDeviceMemory memory = VK_NULL_HANDLE;
    VkFormat format = VK_FORMAT_UNDEFINED;
    VkImageAspectFlags aspect = VK_IMAGE_ASPECT_COLOR_BIT;
    std::map<std::pair<uint32_t, uint32_t>, VkImageView> views;  // (first layer, layers)
  };

  const Device::Impl& device;
  std::string name;
  uint32_t width = 0, height = 0, layers = 0;
  std::vector<Image> colors;
  Image depth;

  explicit Impl(const Device::Impl& d) : device(d) {}
  ~Impl();
  void create(Image& image, VkFormat format, VkImageUsageFlags usage, const std::string& label) const;
  VkImageView view(Image& image, uint32_t first, uint32_t count) const;
};

struct Bindings::Impl {
  const Device::Impl& device;
  VkDescriptorSetLayout layout = VK_NULL_HANDLE;
  VkDescriptorPool pool = VK_NULL_HANDLE;
  VkDescriptorSet set = VK_NULL_HANDLE;

  explicit Impl(const Device::Impl& d) : device(d) {}
  ~Impl();
};

// The layout of `count` storage buffers that Bindings and pipelines share.
VkDescriptorSetLayout createBufferLayout(const Device::Impl& device, uint32_t count);

struct Pipeline::Impl {
  const Device::Impl& device;
  VkDescriptorSetLayout setLayout = VK_NULL_HANDLE;
  VkPipelineLayout layout = VK_NULL_HANDLE;
  VkPipeline pipeline = VK_NULL_HANDLE;
  VkPipelineBindPoint bindPoint = VK_PIPELINE_BIND_POINT_COMPUTE;

  explicit Impl(const Device::Impl& d) : device(d) {}
  ~Impl();
};

VkFormat vulkanFormat(Format format);

}  // namespace farol::gpu
