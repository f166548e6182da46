#include "scene/accessor.h"

#include "base/error.h"

#include <cstring>

namespace farol {
namespace {

// One component as a double; `normalized` as in glTF 2.0, section 3.6.2.2.
double readComponent(const unsigned char* p, int type, bool normalized) {
  const auto as = [p](auto zero) {
    std::memcpy(&zero, p, sizeof(zero));
    return static_cast<double>(zero);
  };
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return normalized ? std::max(as(int8_t{}) / 127.0, -1.0) : as(int8_t{});
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return normalized ? as(uint8_t{}) / 255.0 : as(uint8_t{});
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return normalized ? std::max(as(int16_t{}) / 32767.0, -1.0) : as(int16_t{});
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return normalized ? as(uint16_t{}) / 65535.0 : as(uint16_t{});
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return as(uint32_t{});
    default:
      return as(float{});
  }
}

// The bytes of `count` elements, or an error: the document check went by declared lengths, this one by
// the data that is really there.
const unsigned char* locate(const tinygltf::Model& model, int view, size_t offset, size_t count, size_t element, size_t stride,
                            const std::string& who) {
  const tinygltf::BufferView& v = model.bufferViews[static_cast<size_t>(view)];
  const tinygltf::Buffer& buffer = model.buffers[static_cast<size_t>(v.buffer)];
  const size_t start = v.byteOffset + offset;
  const size_t end = count == 0 ? start : start + stride * (count - 1) + element;
  if (end > buffer.data.size()) {
    throw Error("{}: needs bytes up to {} of buffer {}, which has {}", who, end, v.buffer, buffer.data.size());
  }
  return buffer.data.data() + start;
}

}  // namespace

int accessorComponents(const tinygltf::Model& model, int accessor) {
  return tinygltf::GetNumComponentsInType(static_cast<uint32_t>(model.accessors[static_cast<size_t>(accessor)].type));
}

std::vector<double> readAccessor(const tinygltf::Model& model, int accessor, int components, const std::string& who) {
  const tinygltf::Accessor& a = model.accessors[static_cast<size_t>(accessor)];
  if (accessorComponents(model, accessor) != components) {
    throw Error("{}: accessor {} has {} components per element, {} are needed", who, accessor, accessorComponents(model, accessor),
                components);
  }
  const auto per = static_cast<size_t>(components);
  const auto width = static_cast<size_t>(tinygltf::GetComponentSizeInBytes(static_cast<uint32_t>(a.componentType)));
  std::vector<double> values(a.count * per, 0.0);
  const auto readElement = [&](const unsigned char* from, size_t element) {
    for (size_t c = 0; c < per; ++c) {
      const double value = readComponent(from + c * width, a.componentType, a.normalized);
      if (!std::isfinite(value)) throw Error("{}: element {} of accessor {} is not a finite number", who, element, accessor);
      values[element * per + c] = value;
    }
  };
  if (a.bufferView >= 0) {
    const size_t declared = model.bufferViews[static_cast<size_t>(a.bufferView)].byteStride;
    const size_t stride = declared != 0 ? declared : width * per;
    const unsigned char* data = locate(model, a.bufferView, a.byteOffset, a.count, width * per, stride, who);
    for (size_t i = 0; i < a.count; ++i) readElement(data + i * stride, i);
  }
  if (a.sparse.isSparse) {
    const auto count = static_cast<size_t>(a.sparse.count);
    const auto indexWidth =
        static_cast<size_t>(tinygltf::GetComponentSizeInBytes(static_cast<uint32_t>(a.sparse.indices.componentType)));
    const unsigned char* indices = locate(model, a.sparse.indices.bufferView, static_cast<size_t>(a.sparse.indices.byteOffset),
                                          count, indexWidth, indexWidth, who);
    const unsigned char* data = locate(model, a.sparse.values.bufferView, static_cast<size_t>(a.sparse.values.byteOffset), count,
                                       width * per, width * per, who);
    for (size_t i = 0; i < count; ++i) {
      const auto at = static_cast<size_t>(readComponent(indices + i * indexWidth, a.sparse.indices.componentType, false));
      if (at >= a.count) throw Error("{}: sparse index {} of accessor {} is outside its {} elements", who, at, accessor, a.count);
      readElement(data + i * width * per, at);
    }
  }
  return values;
}

}  // namespace farol
