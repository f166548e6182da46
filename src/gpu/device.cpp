#define VOLK_IMPLEMENTATION
#include "base/error.h"
#include "gpu/vulkan_impl.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace farol::gpu {
namespace {

constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";

const char* resultName(VkResult result) {
  switch (result) {
    case VK_ERROR_OUT_OF_HOST_MEMORY:
      return "out of host memory";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY:
      return "out of device memory";
    case VK_ERROR_INITIALIZATION_FAILED:
      return "initialization failed";
    case VK_ERROR_DEVICE_LOST:
      return "device lost";
    case VK_ERROR_LAYER_NOT_PRESENT:
      return "layer not present";
    case VK_ERROR_EXTENSION_NOT_PRESENT:
      return "extension not present";
    case VK_ERROR_FEATURE_NOT_PRESENT:
      return "feature not present";
    case VK_ERROR_INCOMPATIBLE_DRIVER:
      return "incompatible driver";
    case VK_ERROR_FORMAT_NOT_SUPPORTED:
      return "format not supported";
    default:
      return "error";
  }
}

bool validationWanted() {
  const char* value = std::getenv("FAROL_VALIDATION");
  return value != nullptr && *value != '\0' && std::strcmp(value, "0") != 0;
}

VKAPI_ATTR VkBool32 VKAPI_CALL onMessage(VkDebugUtilsMessageSeverityFlagBitsEXT /*severity*/,
                                         VkDebugUtilsMessageTypeFlagsEXT /*types*/,
                                         const VkDebugUtilsMessengerCallbackDataEXT* data, void* user) {
  ++static_cast<Device::Impl*>(user)->messages;
  fmt::print(stderr, "vulkan validation: {}\n", data->pMessage);
  return VK_FALSE;
}

// A count of FAROL_DEVICE_FAULT=<name>:<count>, or endless.
uint64_t faultOf(const std::string& name) {
  const char* value = std::getenv("FAROL_DEVICE_FAULT");
  const std::string text = value != nullptr ? value : "";
  return text.starts_with(name + ":") ? std::strtoull(text.c_str() + name.size() + 1, nullptr, 10) : UINT64_MAX;
}

bool hasExtension(const std::vector<VkExtensionProperties>& list, const char* name) {
  return std::any_of(list.begin(), list.end(), [&](const auto& e) { return std::strcmp(e.extensionName, name) == 0; });
}

VkInstance createInstance(bool validation, bool& debugUtils) {
  if (volkInitialize() != VK_SUCCESS) {
    throw Error("no Vulkan loader was found; install libvulkan1 and a driver (Debian: mesa-vulkan-drivers)");
  }
  uint32_t count = 0;
  vkEnumerateInstanceExtensionProperties(nullptr, &count, nullptr);
  std::vector<VkExtensionProperties> available(count);
  vkEnumerateInstanceExtensionProperties(nullptr, &count, available.data());
  debugUtils = hasExtension(available, VK_EXT_DEBUG_UTILS_EXTENSION_NAME);

  std::vector<const char*> extensions, layers;
  if (debugUtils) extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
  if (validation) {
    uint32_t layerCount = 0;
    vkEnumerateInstanceLayerProperties(&layerCount, nullptr);
    std::vector<VkLayerProperties> known(layerCount);
    vkEnumerateInstanceLayerProperties(&layerCount, known.data());
    const bool found =
        std::any_of(known.begin(), known.end(), [](const auto& l) { return std::strcmp(l.layerName, kValidationLayer) == 0; });
    if (!found || !debugUtils)
      throw Error("FAROL_VALIDATION is set but {} is not installed (Debian: vulkan-validationlayers)", kValidationLayer);
    layers.push_back(kValidationLayer);
  }
  VkApplicationInfo application{};
  application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
  application.pApplicationName = "farol";
  application.apiVersion = VK_API_VERSION_1_3;
  VkInstanceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  info.pApplicationInfo = &application;
  info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  info.enabledLayerCount = static_cast<uint32_t>(layers.size());
  info.ppEnabledLayerNames = layers.data();
  VkInstance instance = VK_NULL_HANDLE;
  const VkResult result = vkCreateInstance(&info, nullptr, &instance);
  if (result == VK_ERROR_INCOMPATIBLE_DRIVER) {
    throw Error("no Vulkan driver was found; a software one is in Debian's mesa-vulkan-drivers");
  }
  check(result, "create a Vulkan instance");
  volkLoadInstanceOnly(instance);
  return instance;
}

const char* typeName(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
      return "discrete GPU";
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
      return "integrated GPU";
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
      return "virtual GPU";
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
      return "CPU";
    default:
      return "other";
  }
}

// Higher is tried first when the user names no device.
int preference(const DeviceInfo& info) {
  const char* order[] = {"other", "CPU", "virtual GPU", "integrated GPU", "discrete GPU"};
  for (int i = 4; i >= 0; --i) {
    if (info.type == order[i]) return i;
  }
  return 0;
}

// Index of a queue family with graphics and compute, or -1.
int queueFamilyOf(VkPhysicalDevice device) {
  uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  constexpr VkQueueFlags needed = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
  for (uint32_t i = 0; i < count; ++i) {
    if ((families[i].queueFlags & needed) == needed) return static_cast<int>(i);
  }
  return -1;
}

std::string refusalOf(VkPhysicalDevice device, const VkPhysicalDeviceProperties& properties) {
  if (properties.apiVersion < VK_API_VERSION_1_3) {
    return fmt::format("offers Vulkan {}.{}, 1.3 is needed", VK_API_VERSION_MAJOR(properties.apiVersion),
                       VK_API_VERSION_MINOR(properties.apiVersion));
  }
  if (queueFamilyOf(device) < 0) return "has no queue for both graphics and compute";
  VkFormatProperties format{};
  vkGetPhysicalDeviceFormatProperties(device, VK_FORMAT_R32_UINT, &format);
  if ((format.optimalTilingFeatures & VK_FORMAT_FEATURE_COLOR_ATTACHMENT_BIT) == 0) return "cannot draw into 32-bit integer images";
  vkGetPhysicalDeviceFormatProperties(device, VK_FORMAT_D32_SFLOAT, &format);
  if ((format.optimalTilingFeatures & VK_FORMAT_FEATURE_DEPTH_STENCIL_ATTACHMENT_BIT) == 0)
    return "has no 32-bit float depth images";
  return "";
}

std::vector<std::pair<VkPhysicalDevice, DeviceInfo>> enumerate(VkInstance instance) {
  uint32_t count = 0;
  vkEnumeratePhysicalDevices(instance, &count, nullptr);
  std::vector<VkPhysicalDevice> handles(count);
  vkEnumeratePhysicalDevices(instance, &count, handles.data());
  std::vector<std::pair<VkPhysicalDevice, DeviceInfo>> result;
  for (uint32_t i = 0; i < count; ++i) {
    VkPhysicalDeviceProperties base{};
    vkGetPhysicalDeviceProperties(handles[i], &base);
    DeviceInfo info;
    info.index = i;
    info.name = base.deviceName;
    info.type = typeName(base.deviceType);
    info.apiVersion = fmt::format("{}.{}.{}", VK_API_VERSION_MAJOR(base.apiVersion), VK_API_VERSION_MINOR(base.apiVersion),
                                  VK_API_VERSION_PATCH(base.apiVersion));
    info.refusal = refusalOf(handles[i], base);
    if (base.apiVersion >= VK_API_VERSION_1_2) {
      VkPhysicalDeviceDriverProperties driver{};
      driver.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES;
      VkPhysicalDeviceProperties2 properties{};
      properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
      properties.pNext = &driver;
      vkGetPhysicalDeviceProperties2(handles[i], &properties);
      info.driver = fmt::format("{} {}", driver.driverName, driver.driverInfo);
      VkPhysicalDeviceVulkan12Features features12{};
      features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
      VkPhysicalDeviceFeatures2 features{};
      features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
      features.pNext = &features12;
      vkGetPhysicalDeviceFeatures2(handles[i], &features);
      info.layeredDrawing = features12.shaderOutputLayer == VK_TRUE && features.features.drawIndirectFirstInstance == VK_TRUE &&
                            features.features.multiDrawIndirect == VK_TRUE;
    }
    VkPhysicalDeviceMemoryProperties memory{};
    vkGetPhysicalDeviceMemoryProperties(handles[i], &memory);
    for (uint32_t h = 0; h < memory.memoryHeapCount; ++h) {
      if ((memory.memoryHeaps[h].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) != 0) info.memoryBytes += memory.memoryHeaps[h].size;
    }
    result.emplace_back(handles[i], info);
  }
  return result;
}

std::string lowered(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool matches(const DeviceInfo& info, const std::string& wanted) {
  if (wanted.empty()) return true;
  if (std::all_of(wanted.begin(), wanted.end(), [](unsigned char c) { return std::isdigit(c); })) {
    return wanted == std::to_string(info.index);
  }
  return lowered(info.name).find(lowered(wanted)) != std::string::npos;
}

void createLogicalDevice(Device::Impl& d) {
  const float priority = 1.0f;
  VkDeviceQueueCreateInfo queue{};
  queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue.queueFamilyIndex = d.queueFamily;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  VkPhysicalDeviceVulkan13Features features13{};
  features13.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
  features13.dynamicRendering = VK_TRUE;
  features13.synchronization2 = VK_TRUE;
  features13.maintenance4 = VK_TRUE;  // glslang gives workgroup sizes as specialisation ids
  VkPhysicalDeviceVulkan12Features features12{};
  features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
  features12.pNext = &features13;
  const VkBool32 layered = d.info.layeredDrawing ? VK_TRUE : VK_FALSE;
  features12.shaderOutputLayer = layered;
  VkPhysicalDeviceFeatures features10{};
  VkPhysicalDeviceFeatures offered{};
  vkGetPhysicalDeviceFeatures(d.physical, &offered);
  features10.shaderClipDistance = offered.shaderClipDistance;
  features10.drawIndirectFirstInstance = layered;
  features10.multiDrawIndirect = layered;
  VkDeviceCreateInfo creation{};
  creation.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  creation.pNext = &features12;
  creation.queueCreateInfoCount = 1;
  creation.pQueueCreateInfos = &queue;
  creation.pEnabledFeatures = &features10;
  check(vkCreateDevice(d.physical, &creation, nullptr, &d.device), "open Vulkan device " + d.info.name);
  volkLoadDeviceTable(&d.vk, d.device);
  d.vk.vkGetDeviceQueue(d.device, d.queueFamily, 0, &d.queue);

  VkCommandPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  pool.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
  pool.queueFamilyIndex = d.queueFamily;
  check(d.vk.vkCreateCommandPool(d.device, &pool, nullptr, &d.pool), "create a command pool");
}

}  // namespace

void check(VkResult result, const std::string& operation) {
  if (result == VK_SUCCESS) return;
  const std::string sentence =
      fmt::format("failed to {}: {} (VkResult {})", operation, resultName(result), static_cast<int>(result));
  if (result == VK_ERROR_OUT_OF_DEVICE_MEMORY || result == VK_ERROR_OUT_OF_HOST_MEMORY) throw OutOfMemory(sentence);
  if (result == VK_ERROR_DEVICE_LOST) {
    throw DeviceLost(
        "{}: it was reset or taken away, or its driver ended work that took too long; choose another --device, or --method rays",
        sentence);
  }
  throw Error(sentence);
}

Device::Impl::~Impl() {
  if (device != VK_NULL_HANDLE) {
    vk.vkDeviceWaitIdle(device);
    if (pipelineCache != VK_NULL_HANDLE) {
      savePipelineCache(*this);
      vk.vkDestroyPipelineCache(device, pipelineCache, nullptr);
    }
    vk.vkDestroyCommandPool(device, pool, nullptr);
    vk.vkDestroyDevice(device, nullptr);
  }
  if (messenger != VK_NULL_HANDLE) vkDestroyDebugUtilsMessengerEXT(instance, messenger, nullptr);
  if (instance != VK_NULL_HANDLE) vkDestroyInstance(instance, nullptr);
}

void Device::Impl::setName(VkObjectType type, uint64_t handle, const std::string& text) const {
  if (!debugNames) return;
  VkDebugUtilsObjectNameInfoEXT label{};
  label.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT;
  label.objectType = type;
  label.objectHandle = handle;
  label.pObjectName = text.c_str();
  vkSetDebugUtilsObjectNameEXT(device, &label);
}

VkDeviceMemory Device::Impl::allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags wanted,
                                      VkMemoryPropertyFlags preferred, const std::string& what) const {
  uint32_t chosen = VK_MAX_MEMORY_TYPES;
  for (const VkMemoryPropertyFlags flags : {wanted | preferred, wanted}) {
    for (uint32_t i = 0; i < memory.memoryTypeCount && chosen == VK_MAX_MEMORY_TYPES; ++i) {
      const bool allowed = (needs.memoryTypeBits >> i & 1u) != 0;
      if (allowed && (memory.memoryTypes[i].propertyFlags & flags) == flags) chosen = i;
    }
  }
  if (chosen == VK_MAX_MEMORY_TYPES) throw Error("device {} has no memory of the kind that {} needs", info.name, what);
  VkMemoryAllocateInfo allocation{};
  allocation.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  allocation.allocationSize = needs.size;
  allocation.memoryTypeIndex = chosen;
  VkDeviceMemory result = VK_NULL_HANDLE;
  const bool refused = needs.size > mostAllocated;
  check(refused ? VK_ERROR_OUT_OF_DEVICE_MEMORY : vk.vkAllocateMemory(device, &allocation, nullptr, &result),
        fmt::format("allocate {} bytes for {}", needs.size, what));
  return result;
}

std::vector<DeviceInfo> listDevices() {
  bool debugUtils = false;
  const VkInstance instance = createInstance(false, debugUtils);
  std::vector<DeviceInfo> result;
  for (const auto& [handle, info] : enumerate(instance)) result.push_back(info);
  vkDestroyInstance(instance, nullptr);
  return result;
}

Device::Device(const std::string& wanted) : impl_(std::make_unique<Impl>()) {
  Impl& d = *impl_;
  d.mostAllocated = faultOf("memory");
  d.waitsLeft = faultOf("lost");
  const bool validation = validationWanted();
  d.instance = createInstance(validation, d.debugNames);
  if (validation) {
    VkDebugUtilsMessengerCreateInfoEXT listener{};
    listener.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    listener.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    listener.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
    listener.pfnUserCallback = onMessage;
    listener.pUserData = &d;
    check(vkCreateDebugUtilsMessengerEXT(d.instance, &listener, nullptr, &d.messenger), "listen to the validation layer");
  }
  const auto devices = enumerate(d.instance);
  std::string reasons;
  int best = -1;
  for (const auto& [handle, info] : devices) {
    const bool named = matches(info, wanted);
    const std::string reason = !info.refusal.empty() ? info.refusal : named ? "" : fmt::format("is not '{}'", wanted);
    if (!reason.empty()) {
      reasons += fmt::format("; {} '{}' {}", info.index, info.name, reason);
    } else if (preference(info) > best) {
      best = preference(info);
      d.physical = handle;
      d.info = info;
    }
  }
  if (d.physical == VK_NULL_HANDLE) {
    throw Error("no usable Vulkan device{}{}", wanted.empty() ? "" : fmt::format(" '{}'", wanted),
                devices.empty() ? ": the machine has none" : reasons);
  }
  d.queueFamily = static_cast<uint32_t>(queueFamilyOf(d.physical));
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(d.physical, &properties);
  vkGetPhysicalDeviceMemoryProperties(d.physical, &d.memory);
  d.limits = {properties.limits.maxStorageBufferRange, properties.limits.maxImageDimension2D, properties.limits.maxImageArrayLayers,
              std::min(properties.limits.maxComputeWorkGroupCount[0], properties.limits.maxComputeWorkGroupCount[1])};
  for (const uint8_t byte : properties.pipelineCacheUUID) d.cacheKey += fmt::format("{:02x}", byte);
  createLogicalDevice(d);
  loadPipelineCache(d);
}

Device::~Device() = default;
Device::Device(Device&&) noexcept = default;

const DeviceInfo& Device::info() const { return impl_->info; }
const Limits& Device::limits() const { return impl_->limits; }
size_t Device::validationMessages() const { return impl_->messages; }

}  // namespace farol::gpu
