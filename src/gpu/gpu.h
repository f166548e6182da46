// A thin layer over Vulkan 1.3: what a numerical program needs and no more. No Vulkan type appears here.
// Objects own what they create and are move-only; a Device must outlive everything made from it.
// Every failure throws Error with a verb phrase and the Vulkan result.
#pragma once

#include "base/error.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace farol::gpu {

class OutOfMemory : public Error {  // of the device or the host: less at a time may fit
 public:
  using Error::Error;
};

class DeviceLost : public Error {  // the device and all that was made from it are of no more use
 public:
  using Error::Error;
};

struct DeviceInfo {
  uint32_t index = 0;
  std::string name, type, driver, apiVersion;
  uint64_t memoryBytes = 0;
  bool layeredDrawing = false;  // vertex shaders may choose the layer, indirect draws their first instance
  std::string refusal;          // why the device cannot be used; empty when it can
};

struct Limits {
  uint64_t maxStorageBufferRange = 0;  // [bytes]
  uint32_t maxImageSize = 0;           // [pixels] side of a 2-D image
  uint32_t maxImageLayers = 0;
  uint32_t maxWorkgroupCount = 0;  // per dimension
};

// All Vulkan devices of the machine, usable or not. Throws when there is no Vulkan loader or driver.
std::vector<DeviceInfo> listDevices();

class Device {
 public:
  // The device with this index or whose name contains `wanted`; the fastest kind when empty. Throws
  // with a reason per device when none can be used. The validation layer is loaded when the environment
  // has FAROL_VALIDATION=1; its messages go to standard error and are counted. For tests of what follows,
  // FAROL_DEVICE_FAULT=memory:N refuses allocations of more than N bytes, and =lost:N loses the device at the N-th wait.
  explicit Device(const std::string& wanted = "");
  ~Device();
  Device(Device&&) noexcept;
  Device& operator=(Device&&) = delete;

  const DeviceInfo& info() const;
  const Limits& limits() const;
  size_t validationMessages() const;

  struct Impl;
  Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

enum class Memory {
  device,    // fast for shaders, not mapped
  upload,    // mapped, written by the host
  download,  // mapped and cached, read by the host
};

// Bytes for shaders (storage), vertices, indices and copies.
class Buffer {
 public:
  Buffer(const Device& device, const std::string& name, uint64_t bytes, Memory memory);
  ~Buffer();
  Buffer(Buffer&&) noexcept;
  Buffer& operator=(Buffer&&) noexcept;

  uint64_t bytes() const;
  std::byte* mapped() const;  // null for Memory::device

  template <typename T>
  std::span<T> as() const {
    return {reinterpret_cast<T*>(mapped()), bytes() / sizeof(T)};
  }

  struct Impl;
  Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

// A device buffer holding a copy of `data`.
Buffer uploadBytes(const Device& device, const std::string& name, std::span<const std::byte> data);
template <typename T>
Buffer upload(const Device& device, const std::string& name, const std::vector<T>& data) {
  return uploadBytes(device, name, std::as_bytes(std::span(data)));
}

enum class Format { uint32, float32x2 };

// Colour images and a 32-bit float depth image of one size, with array layers.
class RasterTarget {
 public:
  RasterTarget(const Device& device, const std::string& name, uint32_t width, uint32_t height, uint32_t layers,
               const std::vector<Format>& colors);
  ~RasterTarget();
  RasterTarget(RasterTarget&&) noexcept;
  RasterTarget& operator=(RasterTarget&&) noexcept;

  struct Impl;
  Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

using Spirv = std::span<const uint32_t>;

// Storage buffers at bindings 0, 1, ... of set 0.
class Bindings {
 public:
  Bindings(const Device& device, const std::string& name, const std::vector<const Buffer*>& buffers);
  ~Bindings();
  Bindings(Bindings&&) noexcept;
  Bindings& operator=(Bindings&&) noexcept;

  struct Impl;
  Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

class Pipeline {
 public:
  ~Pipeline();
  Pipeline(Pipeline&&) noexcept;
  Pipeline& operator=(Pipeline&&) noexcept;

  struct Impl;
  Impl& impl() const { return *impl_; }

 protected:
  Pipeline();
  std::unique_ptr<Impl> impl_;
};

class ComputePipeline : public Pipeline {
 public:
  ComputePipeline(const Device& device, const std::string& name, Spirv shader, uint32_t bufferCount, uint32_t pushBytes);
};

// Indexed triangles; vertices are 16 bytes: three floats (location 0) and one unsigned integer (location 1).
// Depth is reversed: greater is nearer, equal does not replace.
class RasterPipeline : public Pipeline {
 public:
  RasterPipeline(const Device& device, const std::string& name, Spirv vertex, Spirv fragment, const std::vector<Format>& colors,
                 uint32_t bufferCount, uint32_t pushBytes);
};

enum class Faces { all, front, back };  // which triangles are drawn; front is counter-clockwise

// One command buffer: record, submit, wait. Barriers stand next to the operations that need them.
class Commands {
 public:
  Commands(const Device& device, const std::string& name);
  ~Commands();
  Commands(Commands&&) noexcept;
  Commands& operator=(Commands&&) noexcept;

  void begin();
  void fill(const Buffer& buffer, uint64_t bytes, uint32_t value);
  void copy(const Buffer& from, const Buffer& to, uint64_t bytes);
  // Clears layers [first, first + count) and starts drawing into them: every uint32 image to clearId,
  // float images to 0.
  void beginRaster(const RasterTarget& target, uint32_t first, uint32_t count, uint32_t clearId);
  void bind(const Pipeline& pipeline, const Bindings& bindings);
  void bindMesh(const Buffer& vertices, const Buffer& indices);
  void viewport(uint32_t x, uint32_t y, uint32_t width, uint32_t height);  // and scissor [pixels]
  void faces(Faces drawn);
  void push(std::span<const std::byte> constants);
  template <typename T>
  void push(const T& constants) {
    push(std::as_bytes(std::span(&constants, 1)));
  }
  void drawIndexed(uint32_t indexCount);
  void drawIndirect(const Buffer& draws, uint32_t first, uint32_t count);  // indexed, 5 x uint32 each
  void endRaster();
  void copyColor(const RasterTarget& target, uint32_t color, uint32_t layers, const Buffer& to);
  void dispatch(uint32_t x, uint32_t y);
  void shareWithHost();  // what shaders wrote into mapped buffers
  void submit();
  void wait();  // until the last submission has finished; the host then sees what it wrote

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace farol::gpu
