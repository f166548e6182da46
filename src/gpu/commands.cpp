#include "gpu/vulkan_impl.h"

#include <vector>

namespace farol::gpu {

struct Commands::Impl {
  const Device::Impl& device;
  VkCommandBuffer buffer = VK_NULL_HANDLE;
  VkFence fence = VK_NULL_HANDLE;
  const Pipeline::Impl* bound = nullptr;
  bool pending = false;

  explicit Impl(const Device::Impl& d) : device(d) {}
  ~Impl() {
    if (pending) device.vk.vkWaitForFences(device.device, 1, &fence, VK_TRUE, UINT64_MAX);
    if (fence != VK_NULL_HANDLE) device.vk.vkDestroyFence(device.device, fence, nullptr);
    if (buffer != VK_NULL_HANDLE) device.vk.vkFreeCommandBuffers(device.device, device.pool, 1, &buffer);
  }

  void barrier(VkPipelineStageFlags2 fromStage, VkAccessFlags2 fromAccess, VkPipelineStageFlags2 toStage,
               VkAccessFlags2 toAccess) const {
    VkMemoryBarrier2 memory{};
    memory.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2;
    memory.srcStageMask = fromStage;
    memory.srcAccessMask = fromAccess;
    memory.dstStageMask = toStage;
    memory.dstAccessMask = toAccess;
    VkDependencyInfo info{};
    info.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO;
    info.memoryBarrierCount = 1;
    info.pMemoryBarriers = &memory;
    device.vk.vkCmdPipelineBarrier2(buffer, &info);
  }

  void imageBarrier(const RasterTarget::Impl::Image& image, uint32_t first, uint32_t count, VkPipelineStageFlags2 fromStage,
                    VkAccessFlags2 fromAccess, VkImageLayout from, VkPipelineStageFlags2 toStage, VkAccessFlags2 toAccess,
                    VkImageLayout to) const {
    VkImageMemoryBarrier2 barrier{};
    barrier.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2;
    barrier.srcStageMask = fromStage;
    barrier.srcAccessMask = fromAccess;
    barrier.dstStageMask = toStage;
    barrier.dstAccessMask = toAccess;
    barrier.oldLayout = from;
    barrier.newLayout = to;
    barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.image = image.image;
    barrier.subresourceRange = {image.aspect, 0, 1, first, count};
    VkDependencyInfo info{};
    info.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO;
    info.imageMemoryBarrierCount = 1;
    info.pImageMemoryBarriers = &barrier;
    device.vk.vkCmdPipelineBarrier2(buffer, &info);
  }
};

Commands::Commands(const Device& device, const std::string& name) : impl_(std::make_unique<Impl>(device.impl())) {
  const Device::Impl& d = device.impl();
  VkCommandBufferAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  info.commandPool = d.pool;
  info.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  info.commandBufferCount = 1;
  check(d.vk.vkAllocateCommandBuffers(d.device, &info, &impl_->buffer), "allocate commands " + name);
  d.name(VK_OBJECT_TYPE_COMMAND_BUFFER, impl_->buffer, name);
  VkFenceCreateInfo fence{};
  fence.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
  check(d.vk.vkCreateFence(d.device, &fence, nullptr, &impl_->fence), "create a fence for " + name);
}

Commands::~Commands() = default;
Commands::Commands(Commands&&) noexcept = default;
Commands& Commands::operator=(Commands&&) noexcept = default;

void Commands::begin() {
  VkCommandBufferBeginInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  check(impl_->device.vk.vkBeginCommandBuffer(impl_->buffer, &info), "begin commands");
  // Earlier submissions on the queue may still use the same buffers: everything they did comes first.
  impl_->barrier(VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT,
                 VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT);
}

void Commands::fill(const Buffer& buffer, uint64_t bytes, uint32_t value) {
  impl_->device.vk.vkCmdFillBuffer(impl_->buffer, buffer.impl().buffer, 0, (bytes + 3) / 4 * 4, value);
  // fill -> shaders
  impl_->barrier(VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, VK_ACCESS_2_TRANSFER_WRITE_BIT, VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
                 VK_ACCESS_2_SHADER_READ_BIT | VK_ACCESS_2_SHADER_WRITE_BIT);
}

void Commands::copy(const Buffer& from, const Buffer& to, uint64_t bytes) {
  const VkBufferCopy region{0, 0, bytes};
  impl_->device.vk.vkCmdCopyBuffer(impl_->buffer, from.impl().buffer, to.impl().buffer, 1, &region);
  // copy -> whatever reads next, the host included
  impl_->barrier(VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, VK_ACCESS_2_TRANSFER_WRITE_BIT,
                 VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT | VK_PIPELINE_STAGE_2_HOST_BIT,
                 VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_HOST_READ_BIT);
}

void Commands::beginRaster(const RasterTarget& target, uint32_t first, uint32_t count, uint32_t clearId) {
  RasterTarget::Impl& t = target.impl();
  std::vector<VkRenderingAttachmentInfo> colors;
  for (RasterTarget::Impl::Image& image : t.colors) {
    // The copy of the last batch has read the image; its content may go.
    impl_->imageBarrier(image, first, count, VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, VK_ACCESS_2_TRANSFER_READ_BIT,
                        VK_IMAGE_LAYOUT_UNDEFINED, VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT,
                        VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL);
    VkRenderingAttachmentInfo info{};
    info.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO;
    info.imageView = t.view(image, first, count);
    info.imageLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;
    info.loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR;
    info.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
    if (image.format == VK_FORMAT_R32_UINT) info.clearValue.color.uint32[0] = clearId;
    colors.push_back(info);
  }
  // The depth tests of the last batch come before this one's clear.
  constexpr VkPipelineStageFlags2 kDepthStages =
      VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT | VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT;
  impl_->imageBarrier(t.depth, first, count, kDepthStages, VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
                      VK_IMAGE_LAYOUT_UNDEFINED, kDepthStages,
                      VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_READ_BIT | VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
                      VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL);
  VkRenderingAttachmentInfo depth{};
  depth.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO;
  depth.imageView = t.view(t.depth, first, count);
  depth.imageLayout = VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL;
  depth.loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR;
  depth.storeOp = VK_ATTACHMENT_STORE_OP_DONT_CARE;
  depth.clearValue.depthStencil.depth = 0.0f;  // reversed: 0 is infinitely far
  VkRenderingInfo rendering{};
  rendering.sType = VK_STRUCTURE_TYPE_RENDERING_INFO;
  rendering.renderArea = {{0, 0}, {t.width, t.height}};
  rendering.layerCount = count;
  rendering.colorAttachmentCount = static_cast<uint32_t>(colors.size());
  rendering.pColorAttachments = colors.data();
  rendering.pDepthAttachment = &depth;
  impl_->device.vk.vkCmdBeginRendering(impl_->buffer, &rendering);
}

void Commands::bind(const Pipeline& pipeline, const Bindings& bindings) {
  const Pipeline::Impl& p = pipeline.impl();
  impl_->bound = &p;
  impl_->device.vk.vkCmdBindPipeline(impl_->buffer, p.bindPoint, p.pipeline);
  impl_->device.vk.vkCmdBindDescriptorSets(impl_->buffer, p.bindPoint, p.layout, 0, 1, &bindings.impl().set, 0, nullptr);
}

void Commands::bindMesh(const Buffer& vertices, const Buffer& indices) {
  const VkDeviceSize offset = 0;
  impl_->device.vk.vkCmdBindVertexBuffers(impl_->buffer, 0, 1, &vertices.impl().buffer, &offset);
  impl_->device.vk.vkCmdBindIndexBuffer(impl_->buffer, indices.impl().buffer, 0, VK_INDEX_TYPE_UINT32);
}

void Commands::viewport(uint32_t x, uint32_t y, uint32_t width, uint32_t height) {
  const VkViewport viewport{
      static_cast<float>(x), static_cast<float>(y), static_cast<float>(width), static_cast<float>(height), 0.0f, 1.0f};
  impl_->device.vk.vkCmdSetViewport(impl_->buffer, 0, 1, &viewport);
  const VkRect2D scissor{{static_cast<int32_t>(x), static_cast<int32_t>(y)}, {width, height}};
  impl_->device.vk.vkCmdSetScissor(impl_->buffer, 0, 1, &scissor);
}

void Commands::faces(Faces drawn) {
  const VkCullModeFlags cull = drawn == Faces::all     ? VK_CULL_MODE_NONE
                               : drawn == Faces::front ? VK_CULL_MODE_BACK_BIT
                                                       : VK_CULL_MODE_FRONT_BIT;
  impl_->device.vk.vkCmdSetCullMode(impl_->buffer, cull);
}

void Commands::push(std::span<const std::byte> constants) {
  constexpr VkShaderStageFlags kAllStages = VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT | VK_SHADER_STAGE_COMPUTE_BIT;
  impl_->device.vk.vkCmdPushConstants(impl_->buffer, impl_->bound->layout, kAllStages, 0, static_cast<uint32_t>(constants.size()),
                                      constants.data());
}

void Commands::drawIndexed(uint32_t indexCount) { impl_->device.vk.vkCmdDrawIndexed(impl_->buffer, indexCount, 1, 0, 0, 0); }

void Commands::drawIndirect(const Buffer& draws, uint32_t first, uint32_t count) {
  constexpr uint32_t kStride = sizeof(VkDrawIndexedIndirectCommand);
  impl_->device.vk.vkCmdDrawIndexedIndirect(impl_->buffer, draws.impl().buffer, uint64_t{kStride} * first, count, kStride);
}

void Commands::endRaster() { impl_->device.vk.vkCmdEndRendering(impl_->buffer); }

void Commands::copyColor(const RasterTarget& target, uint32_t color, uint32_t layers, const Buffer& to) {
  const RasterTarget::Impl& t = target.impl();
  const RasterTarget::Impl::Image& image = t.colors[color];
  // drawing -> copy
  impl_->imageBarrier(image, 0, layers, VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT, VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT,
                      VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL, VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, VK_ACCESS_2_TRANSFER_READ_BIT,
                      VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL);
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, layers};
  region.imageExtent = {t.width, t.height, 1};
  impl_->device.vk.vkCmdCopyImageToBuffer(impl_->buffer, image.image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, to.impl().buffer, 1,
                                          &region);
  // copy -> reduction, or the host
  impl_->barrier(VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, VK_ACCESS_2_TRANSFER_WRITE_BIT,
                 VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_2_HOST_BIT,
                 VK_ACCESS_2_SHADER_READ_BIT | VK_ACCESS_2_HOST_READ_BIT);
}

void Commands::dispatch(uint32_t x, uint32_t y) {
  impl_->device.vk.vkCmdDispatch(impl_->buffer, x, y, 1);
  // compute -> copies, later dispatches, and draws that read lists
  impl_->barrier(VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, VK_ACCESS_2_SHADER_WRITE_BIT,
                 VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT | VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT |
                     VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT | VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT,
                 VK_ACCESS_2_TRANSFER_READ_BIT | VK_ACCESS_2_SHADER_READ_BIT | VK_ACCESS_2_SHADER_WRITE_BIT |
                     VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT);
}

void Commands::shareWithHost() {
  impl_->barrier(VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, VK_ACCESS_2_SHADER_WRITE_BIT, VK_PIPELINE_STAGE_2_HOST_BIT,
                 VK_ACCESS_2_HOST_READ_BIT);
}

void Commands::submit() {
  const Device::Impl& d = impl_->device;
  check(d.vk.vkEndCommandBuffer(impl_->buffer), "end commands");
  VkCommandBufferSubmitInfo commands{};
  commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO;
  commands.commandBuffer = impl_->buffer;
  VkSubmitInfo2 info{};
  info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2;
  info.commandBufferInfoCount = 1;
  info.pCommandBufferInfos = &commands;
  check(d.vk.vkQueueSubmit2(d.queue, 1, &info, impl_->fence), "submit commands");
  impl_->pending = true;
}

void Commands::wait() {
  if (!impl_->pending) return;
  const Device::Impl& d = impl_->device;
  const VkResult result = d.vk.vkWaitForFences(d.device, 1, &impl_->fence, VK_TRUE, UINT64_MAX);
  check(d.waitsLeft-- == 0 ? VK_ERROR_DEVICE_LOST : result, "wait for device " + d.info.name);
  check(d.vk.vkResetFences(d.device, 1, &impl_->fence), "reset a fence");
  impl_->pending = false;
}

}  // namespace farol::gpu
