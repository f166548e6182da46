#include "base/error.h"
#include "gpu/vulkan_impl.h"

#include <cstring>

namespace farol::gpu {

// ---- buffers

Buffer::Impl::~Impl() {
  if (mapped != nullptr) device.vk.vkUnmapMemory(device.device, memory);
  if (buffer != VK_NULL_HANDLE) device.vk.vkDestroyBuffer(device.device, buffer, nullptr);
  if (memory != VK_NULL_HANDLE) device.vk.vkFreeMemory(device.device, memory, nullptr);
}

Buffer::Buffer(const Device& device, const std::string& name, uint64_t bytes, Memory memory)
    : impl_(std::make_unique<Impl>(device.impl())) {
  const Device::Impl& d = device.impl();
  impl_->bytes = std::max<uint64_t>(bytes, 16);  // Vulkan has no empty buffers
  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = impl_->bytes;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | VK_BUFFER_USAGE_INDEX_BUFFER_BIT |
               VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  check(d.vk.vkCreateBuffer(d.device, &info, nullptr, &impl_->buffer), "create buffer " + name);
  VkMemoryRequirements needs{};
  d.vk.vkGetBufferMemoryRequirements(d.device, impl_->buffer, &needs);
  constexpr VkMemoryPropertyFlags kHost = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  const VkMemoryPropertyFlags wanted = memory == Memory::device ? 0 : kHost;
  const VkMemoryPropertyFlags preferred = memory == Memory::device     ? VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
                                          : memory == Memory::download ? VK_MEMORY_PROPERTY_HOST_CACHED_BIT
                                                                       : 0;
  impl_->memory = d.allocate(needs, wanted, preferred, "buffer " + name);
  check(d.vk.vkBindBufferMemory(d.device, impl_->buffer, impl_->memory, 0), "bind buffer " + name);
  d.name(VK_OBJECT_TYPE_BUFFER, impl_->buffer, name);
  if (memory != Memory::device) {
    void* pointer = nullptr;
    check(d.vk.vkMapMemory(d.device, impl_->memory, 0, VK_WHOLE_SIZE, 0, &pointer), "map buffer " + name);
    impl_->mapped = static_cast<std::byte*>(pointer);
  }
}

Buffer::~Buffer() = default;
Buffer::Buffer(Buffer&&) noexcept = default;
Buffer& Buffer::operator=(Buffer&&) noexcept = default;
uint64_t Buffer::bytes() const { return impl_->bytes; }
std::byte* Buffer::mapped() const { return impl_->mapped; }

Buffer uploadBytes(const Device& device, const std::string& name, std::span<const std::byte> data) {
  Buffer staging(device, name + " (staging)", data.size(), Memory::upload);
  if (!data.empty()) std::memcpy(staging.mapped(), data.data(), data.size());
  Buffer result(device, name, data.size(), Memory::device);
  if (!data.empty()) {
    Commands commands(device, "upload " + name);
    commands.begin();
    commands.copy(staging, result, data.size());
    commands.submit();
    commands.wait();
  }
  return result;
}

// ---- images

VkFormat vulkanFormat(Format format) { return format == Format::uint32 ? VK_FORMAT_R32_UINT : VK_FORMAT_R32G32_SFLOAT; }

RasterTarget::Impl::~Impl() {
  const auto destroy = [this](Image& image) {
    for (const auto& [range, handle] : image.views) device.vk.vkDestroyImageView(device.device, handle, nullptr);
    if (image.image != VK_NULL_HANDLE) device.vk.vkDestroyImage(device.device, image.image, nullptr);
    if (image.memory != VK_NULL_HANDLE) device.vk.vkFreeMemory(device.device, image.memory, nullptr);
  };
  for (Image& image : colors) destroy(image);
  destroy(depth);
}

void RasterTarget::Impl::create(Image& image, VkFormat format, VkImageUsageFlags usage, const std::string& label) const {
  image.format = format;
  VkImageCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO;
  info.imageType = VK_IMAGE_TYPE_2D;
  info.format = format;
  info.extent = {width, height, 1};
  info.mipLevels = 1;
  info.arrayLayers = layers;
  info.samples = VK_SAMPLE_COUNT_1_BIT;
  info.tiling = VK_IMAGE_TILING_OPTIMAL;
  info.usage = usage;
  check(device.vk.vkCreateImage(device.device, &info, nullptr, &image.image), "create image " + label);
  VkMemoryRequirements needs{};
  device.vk.vkGetImageMemoryRequirements(device.device, image.image, &needs);
  image.memory = device.allocate(needs, 0, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, "image " + label);
  check(device.vk.vkBindImageMemory(device.device, image.image, image.memory, 0), "bind image " + label);
  device.name(VK_OBJECT_TYPE_IMAGE, image.image, label);
}

VkImageView RasterTarget::Impl::view(Image& image, uint32_t first, uint32_t count) const {
  VkImageView& handle = image.views[{first, count}];
  if (handle != VK_NULL_HANDLE) return handle;
  VkImageViewCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO;
  info.image = image.image;
  info.viewType = VK_IMAGE_VIEW_TYPE_2D_ARRAY;
  info.format = image.format;
  info.subresourceRange = {image.aspect, 0, 1, first, count};
  check(device.vk.vkCreateImageView(device.device, &info, nullptr, &handle), "create a view of image " + name);
  return handle;
}

RasterTarget::RasterTarget(const Device& device, const std::string& name, uint32_t width, uint32_t height, uint32_t layers,
                           const std::vector<Format>& colors)
    : impl_(std::make_unique<Impl>(device.impl())) {
  impl_->name = name;
  impl_->width = width;
  impl_->height = height;
  impl_->layers = layers;
  impl_->colors.resize(colors.size());
  for (size_t i = 0; i < colors.size(); ++i) {
    impl_->create(impl_->colors[i], vulkanFormat(colors[i]), VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
                  fmt::format("{} colour {}", name, i));
  }
  impl_->depth.aspect = VK_IMAGE_ASPECT_DEPTH_BIT;
  impl_->create(impl_->depth, VK_FORMAT_D32_SFLOAT, VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT, name + " depth");
}

RasterTarget::~RasterTarget() = default;
RasterTarget::RasterTarget(RasterTarget&&) noexcept = default;
RasterTarget& RasterTarget::operator=(RasterTarget&&) noexcept = default;

// ---- bindings

VkDescriptorSetLayout createBufferLayout(const Device::Impl& d, uint32_t count) {
  std::vector<VkDescriptorSetLayoutBinding> bindings(count);
  for (uint32_t i = 0; i < count; ++i) {
    bindings[i] = {i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1,
                   VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT | VK_SHADER_STAGE_COMPUTE_BIT, nullptr};
  }
  VkDescriptorSetLayoutCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
  info.bindingCount = count;
  info.pBindings = bindings.data();
  VkDescriptorSetLayout layout = VK_NULL_HANDLE;
  check(d.vk.vkCreateDescriptorSetLayout(d.device, &info, nullptr, &layout), "create a descriptor layout");
  return layout;
}

Bindings::Impl::~Impl() {
  if (pool != VK_NULL_HANDLE) device.vk.vkDestroyDescriptorPool(device.device, pool, nullptr);
  if (layout != VK_NULL_HANDLE) device.vk.vkDestroyDescriptorSetLayout(device.device, layout, nullptr);
}

Bindings::Bindings(const Device& device, const std::string& name, const std::vector<const Buffer*>& buffers)
    : impl_(std::make_unique<Impl>(device.impl())) {
  const Device::Impl& d = device.impl();
  const auto count = static_cast<uint32_t>(buffers.size());
  for (const Buffer* buffer : buffers) {
    if (buffer->bytes() <= d.limits.maxStorageBufferRange) continue;
    throw Error("{} needs a buffer of {} bytes; device {} binds at most {}", name, buffer->bytes(), d.info.name,
                d.limits.maxStorageBufferRange);
  }
  impl_->layout = createBufferLayout(d, count);
  const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, count};
  VkDescriptorPoolCreateInfo poolInfo{};
  poolInfo.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
  poolInfo.maxSets = 1;
  poolInfo.poolSizeCount = 1;
  poolInfo.pPoolSizes = &size;
  check(d.vk.vkCreateDescriptorPool(d.device, &poolInfo, nullptr, &impl_->pool), "create a descriptor pool");
  VkDescriptorSetAllocateInfo allocation{};
  allocation.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
  allocation.descriptorPool = impl_->pool;
  allocation.descriptorSetCount = 1;
  allocation.pSetLayouts = &impl_->layout;
  check(d.vk.vkAllocateDescriptorSets(d.device, &allocation, &impl_->set), "allocate a descriptor set");
  d.name(VK_OBJECT_TYPE_DESCRIPTOR_SET, impl_->set, name);
  std::vector<VkDescriptorBufferInfo> infos(count);
  std::vector<VkWriteDescriptorSet> writes(count);
  for (uint32_t i = 0; i < count; ++i) {
    infos[i] = {buffers[i]->impl().buffer, 0, VK_WHOLE_SIZE};
    writes[i] = {};
    writes[i].sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    writes[i].dstSet = impl_->set;
    writes[i].dstBinding = i;
    writes[i].descriptorCount = 1;
    writes[i].descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    writes[i].pBufferInfo = &infos[i];
  }
  d.vk.vkUpdateDescriptorSets(d.device, count, writes.data(), 0, nullptr);
}

Bindings::~Bindings() = default;
Bindings::Bindings(Bindings&&) noexcept = default;
Bindings& Bindings::operator=(Bindings&&) noexcept = default;

}  // namespace farol::gpu
