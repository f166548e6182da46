#include "gpu/vulkan_impl.h"

#include <array>

namespace farol::gpu {
namespace {

class ShaderModule {
 public:
  ShaderModule(const Device::Impl& device, Spirv code, const std::string& name) : device_(device) {
    VkShaderModuleCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    info.codeSize = code.size_bytes();
    info.pCode = code.data();
    check(device.vk.vkCreateShaderModule(device.device, &info, nullptr, &module_), "create shader " + name);
  }
  ~ShaderModule() { device_.vk.vkDestroyShaderModule(device_.device, module_, nullptr); }
  ShaderModule(const ShaderModule&) = delete;
  ShaderModule& operator=(const ShaderModule&) = delete;

  VkPipelineShaderStageCreateInfo stage(VkShaderStageFlagBits kind) const {
    VkPipelineShaderStageCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    info.stage = kind;
    info.module = module_;
    info.pName = "main";
    return info;
  }

 private:
  const Device::Impl& device_;
  VkShaderModule module_ = VK_NULL_HANDLE;
};

constexpr VkShaderStageFlags kAllStages = VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT | VK_SHADER_STAGE_COMPUTE_BIT;

void createLayout(Pipeline::Impl& p, uint32_t bufferCount, uint32_t pushBytes) {
  p.setLayout = createBufferLayout(p.device, bufferCount);
  const VkPushConstantRange range{kAllStages, 0, pushBytes};
  VkPipelineLayoutCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
  info.setLayoutCount = 1;
  info.pSetLayouts = &p.setLayout;
  info.pushConstantRangeCount = pushBytes > 0 ? 1 : 0;
  info.pPushConstantRanges = &range;
  check(p.device.vk.vkCreatePipelineLayout(p.device.device, &info, nullptr, &p.layout), "create a pipeline layout");
}

}  // namespace

Pipeline::Impl::~Impl() {
  if (pipeline != VK_NULL_HANDLE) device.vk.vkDestroyPipeline(device.device, pipeline, nullptr);
  if (layout != VK_NULL_HANDLE) device.vk.vkDestroyPipelineLayout(device.device, layout, nullptr);
  if (setLayout != VK_NULL_HANDLE) device.vk.vkDestroyDescriptorSetLayout(device.device, setLayout, nullptr);
}

Pipeline::Pipeline() = default;
Pipeline::~Pipeline() = default;
Pipeline::Pipeline(Pipeline&&) noexcept = default;
Pipeline& Pipeline::operator=(Pipeline&&) noexcept = default;

ComputePipeline::ComputePipeline(const Device& device, const std::string& name, Spirv shader, uint32_t bufferCount,
                                 uint32_t pushBytes) {
  const Device::Impl& d = device.impl();
  impl_ = std::make_unique<Impl>(d);
  createLayout(*impl_, bufferCount, pushBytes);
  const ShaderModule module(d, shader, name);
  VkComputePipelineCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
  info.stage = module.stage(VK_SHADER_STAGE_COMPUTE_BIT);
  info.layout = impl_->layout;
  check(d.vk.vkCreateComputePipelines(d.device, d.pipelineCache, 1, &info, nullptr, &impl_->pipeline), "create pipeline " + name);
  d.name(VK_OBJECT_TYPE_PIPELINE, impl_->pipeline, name);
}

RasterPipeline::RasterPipeline(const Device& device, const std::string& name, Spirv vertex, Spirv fragment,
                               const std::vector<Format>& colors, uint32_t bufferCount, uint32_t pushBytes) {
  const Device::Impl& d = device.impl();
  impl_ = std::make_unique<Impl>(d);
  impl_->bindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS;
  createLayout(*impl_, bufferCount, pushBytes);
  const ShaderModule vertexModule(d, vertex, name + " vertex"), fragmentModule(d, fragment, name + " fragment");
  const std::array stages = {vertexModule.stage(VK_SHADER_STAGE_VERTEX_BIT), fragmentModule.stage(VK_SHADER_STAGE_FRAGMENT_BIT)};

  const VkVertexInputBindingDescription binding{0, 16, VK_VERTEX_INPUT_RATE_VERTEX};
  const std::array<VkVertexInputAttributeDescription, 2> attributes = {
      {{0, 0, VK_FORMAT_R32G32B32_SFLOAT, 0}, {1, 0, VK_FORMAT_R32_UINT, 12}}};
  VkPipelineVertexInputStateCreateInfo input{};
  input.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO;
  input.vertexBindingDescriptionCount = 1;
  input.pVertexBindingDescriptions = &binding;
  input.vertexAttributeDescriptionCount = attributes.size();
  input.pVertexAttributeDescriptions = attributes.data();
  VkPipelineInputAssemblyStateCreateInfo assembly{};
  assembly.sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO;
  assembly.topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST;
  VkPipelineViewportStateCreateInfo viewport{};
  viewport.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO;
  viewport.viewportCount = 1;
  viewport.scissorCount = 1;
  VkPipelineRasterizationStateCreateInfo raster{};
  raster.sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO;
  raster.polygonMode = VK_POLYGON_MODE_FILL;
  raster.frontFace = VK_FRONT_FACE_COUNTER_CLOCKWISE;
  raster.lineWidth = 1.0f;
  VkPipelineMultisampleStateCreateInfo multisample{};
  multisample.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO;
  multisample.rasterizationSamples = VK_SAMPLE_COUNT_1_BIT;
  VkPipelineDepthStencilStateCreateInfo depth{};
  depth.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO;
  depth.depthTestEnable = VK_TRUE;
  depth.depthWriteEnable = VK_TRUE;
  depth.depthCompareOp = VK_COMPARE_OP_GREATER;
  std::vector<VkPipelineColorBlendAttachmentState> blends(colors.size());
  std::vector<VkFormat> formats;
  for (size_t i = 0; i < colors.size(); ++i) {
    blends[i] = {};
    blends[i].colorWriteMask = VK_COLOR_COMPONENT_R_BIT | VK_COLOR_COMPONENT_G_BIT;
    formats.push_back(vulkanFormat(colors[i]));
  }
  VkPipelineColorBlendStateCreateInfo blend{};
  blend.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO;
  blend.attachmentCount = static_cast<uint32_t>(blends.size());
  blend.pAttachments = blends.data();
  const std::array dynamics = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR, VK_DYNAMIC_STATE_CULL_MODE};
  VkPipelineDynamicStateCreateInfo dynamic{};
  dynamic.sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO;
  dynamic.dynamicStateCount = dynamics.size();
  dynamic.pDynamicStates = dynamics.data();
  VkPipelineRenderingCreateInfo rendering{};
  rendering.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO;
  rendering.colorAttachmentCount = static_cast<uint32_t>(formats.size());
  rendering.pColorAttachmentFormats = formats.data();
  rendering.depthAttachmentFormat = VK_FORMAT_D32_SFLOAT;

  VkGraphicsPipelineCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO;
  info.pNext = &rendering;
  info.stageCount = stages.size();
  info.pStages = stages.data();
  info.pVertexInputState = &input;
  info.pInputAssemblyState = &assembly;
  info.pViewportState = &viewport;
  info.pRasterizationState = &raster;
  info.pMultisampleState = &multisample;
  info.pDepthStencilState = &depth;
  info.pColorBlendState = &blend;
  info.pDynamicState = &dynamic;
  info.layout = impl_->layout;
  check(d.vk.vkCreateGraphicsPipelines(d.device, d.pipelineCache, 1, &info, nullptr, &impl_->pipeline), "create pipeline " + name);
  d.name(VK_OBJECT_TYPE_PIPELINE, impl_->pipeline, name);
}

}  // namespace farol::gpu
