#include "gpu/vulkan_impl.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <unistd.h>

namespace farol::gpu {
namespace {
namespace fs = std::filesystem;

// $XDG_CACHE_HOME/farol or ~/.cache/farol; empty where there is neither.
fs::path cacheFile(const Device::Impl& device) {
  const char* cache = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  fs::path folder;
  if (cache != nullptr && *cache != '\0')
    folder = cache;
  else if (home != nullptr && *home != '\0')
    folder = fs::path(home) / ".cache";
  else
    return {};
  return folder / "farol" / ("pipelines-" + device.cacheKey + ".bin");
}

}  // namespace

void loadPipelineCache(Device::Impl& device) {
  std::vector<char> data;
  if (const fs::path file = cacheFile(device); !file.empty()) {
    std::ifstream in(file, std::ios::binary);
    data.assign(std::istreambuf_iterator<char>(in), {});
  }
  device.loadedCacheBytes = data.size();
  VkPipelineCacheCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO;
  info.initialDataSize = data.size();  // the driver ignores data that is not its own
  info.pInitialData = data.data();
  check(device.vk.vkCreatePipelineCache(device.device, &info, nullptr, &device.pipelineCache), "create a pipeline cache");
}

void savePipelineCache(const Device::Impl& device) {
  const fs::path file = cacheFile(device);
  size_t size = 0;
  if (file.empty() || device.vk.vkGetPipelineCacheData(device.device, device.pipelineCache, &size, nullptr) != VK_SUCCESS) return;
  if (size == device.loadedCacheBytes) return;
  std::vector<char> data(size);
  if (device.vk.vkGetPipelineCacheData(device.device, device.pipelineCache, &size, data.data()) != VK_SUCCESS) return;
  std::error_code ignored;
  fs::create_directories(file.parent_path(), ignored);
  const fs::path temporary = file.string() + "." + std::to_string(getpid());
  std::ofstream(temporary, std::ios::binary).write(data.data(), static_cast<std::streamsize>(size));
  fs::rename(temporary, file, ignored);
  if (ignored) fs::remove(temporary, ignored);
}

}  // namespace farol::gpu
