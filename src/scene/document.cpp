#include "scene/document.h"

#include "base/error.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <string_view>

namespace farol {
namespace {

using nlohmann::json;

constexpr uint64_t kMaxFileBytes = 1ull << 31;  // one file or buffer; tinygltf counts in 32 bits
constexpr uint64_t kMaxElements = 1ull << 28;   // entries of one accessor

// Extensions whose meaning is honoured (design section 4). Any other required one is refused.
constexpr std::array<std::string_view, 8> kKnownExtensions = {"KHR_materials_emissive_strength",
                                                              "KHR_lights_punctual",
                                                              "KHR_materials_transmission",
                                                              "KHR_materials_ior",
                                                              "KHR_materials_volume",
                                                              "KHR_materials_unlit",
                                                              "KHR_texture_transform",
                                                              "KHR_mesh_quantization"};

const std::map<int, unsigned> kComponentBytes = {{5120, 1}, {5121, 1}, {5122, 2}, {5123, 2}, {5125, 4}, {5126, 4}};
const std::map<std::string, unsigned> kTypeComponents = {{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4},
                                                         {"MAT2", 4},   {"MAT3", 9}, {"MAT4", 16}};

class Checker {
 public:
  Checker(const std::string& path, const json& doc) : path_(path), doc_(doc) {}

  void run() {
    if (!doc_.is_object() || !doc_.contains("asset")) fail("file", "is JSON but not glTF: it has no 'asset'");
    checkVersion();
    checkExtensions();
    for (const char* key : {"buffers", "bufferViews", "accessors", "meshes", "nodes", "scenes", "images", "textures", "materials",
                            "cameras", "samplers"}) {
      if (doc_.contains(key) && !doc_[key].is_array()) fail(key, "is not an array");
      for (const json& item : list(key)) {
        if (!item.is_object()) fail(key, "has an entry that is not an object");
      }
    }
    eachOf("buffers", [&](const json& o, const std::string& who) { checkBuffer(o, who); });
    eachOf("bufferViews", [&](const json& o, const std::string& who) { checkBufferView(o, who); });
    eachOf("accessors", [&](const json& o, const std::string& who) { checkAccessor(o, who); });
    eachOf("images", [&](const json& o, const std::string& who) { checkImage(o, who); });
    eachOf("textures", [&](const json& o, const std::string& who) {
      index(o, "source", "images", who, false);
      index(o, "sampler", "samplers", who, false);
    });
    eachOf("meshes", [&](const json& o, const std::string& who) { checkMesh(o, who); });
    eachOf("nodes", [&](const json& o, const std::string& who) {
      index(o, "mesh", "meshes", who, false);
      index(o, "camera", "cameras", who, false);
      indexList(o, "children", "nodes", who);
    });
    eachOf("scenes", [&](const json& o, const std::string& who) { indexList(o, "nodes", "nodes", who); });
    index(doc_, "scene", "scenes", "file", false);
    checkTree();
  }

 private:
  [[noreturn]] void fail(const std::string& who, const std::string& what) const { throw Error("{}: {}: {}", path_, who, what); }

  const json& list(const char* key) const {
    static const json empty = json::array();
    const auto it = doc_.find(key);
    return it != doc_.end() ? *it : empty;
  }

  template <typename F>
  void eachOf(const char* key, F check) const {
    const std::string singular(key, std::strlen(key) - 1);
    const json& items = list(key);
    for (size_t i = 0; i < items.size(); ++i) {
      std::string who = fmt::format("{} {}", singular == "meshe" ? "mesh" : singular, i);
      if (items[i].contains("name") && items[i]["name"].is_string()) {
        who += fmt::format(" '{}'", items[i]["name"].get<std::string>());
      }
      check(items[i], who);
    }
  }

  uint64_t number(const json& o, const char* key, const std::string& who, uint64_t fallback, uint64_t max) const {
    const auto it = o.find(key);
    if (it == o.end()) return fallback;
    if (!it->is_number_unsigned() || it->get<uint64_t>() > max) {
      fail(who, fmt::format("{} is {}, not a whole number from 0 to {}", key, it->dump(), max));
    }
    return it->get<uint64_t>();
  }

  void index(const json& o, const char* key, const char* target, const std::string& who, bool required) const {
    if (!o.contains(key)) {
      if (required) fail(who, fmt::format("has no {}", key));
      return;
    }
    checkIndex(o[key], key, target, who);
  }

  void checkIndex(const json& value, const std::string& key, const char* target, const std::string& who) const {
    const size_t count = list(target).size();
    if (!value.is_number_unsigned() || value.get<uint64_t>() >= count) {
      fail(who, fmt::format("{} is {}, but the file has {} {}", key, value.dump(), count, target));
    }
  }

  void indexList(const json& o, const char* key, const char* target, const std::string& who) const {
    const auto it = o.find(key);
    if (it == o.end()) return;
    if (!it->is_array()) fail(who, fmt::format("{} is not an array", key));
    for (const json& value : *it) checkIndex(value, key, target, who);
  }

  void checkVersion() const {
    const json& asset = doc_["asset"];
    const auto it = asset.find("version");
    if (!asset.is_object() || it == asset.end() || !it->is_string()) fail("asset", "has no version");
    if (!it->get<std::string>().starts_with("2.")) {
      fail("asset", fmt::format("version is {}, but only glTF 2 is read", it->get<std::string>()));
    }
  }

  void checkExtensions() const {
    for (const json& name : list("extensionsRequired")) {
      if (!name.is_string()) fail("extensionsRequired", "has an entry that is not a string");
      const auto text = name.get<std::string>();
      if (std::find(kKnownExtensions.begin(), kKnownExtensions.end(), text) == kKnownExtensions.end()) {
        fail("extensionsRequired", fmt::format("{} is required but not supported; export the scene without it", text));
      }
    }
  }

  // Relative files and data URIs only: a scene must not reach outside of where it lies by an absolute path.
  void checkUri(const json& o, const std::string& who) const {
    const auto it = o.find("uri");
    if (it == o.end()) return;
    if (!it->is_string()) fail(who, "uri is not a string");
    const auto uri = it->get<std::string>();
    if (uri.starts_with("data:")) return;
    const size_t colon = uri.find(':');
    const bool scheme = colon != std::string::npos && colon < uri.find('/');
    if (uri.empty() || uri[0] == '/' || uri[0] == '\\' || scheme) {
      fail(who, fmt::format("uri '{}' is not allowed: only relative paths and data URIs are", uri));
    }
  }

  void checkBuffer(const json& o, const std::string& who) const {
    if (!o.contains("byteLength")) fail(who, "has no byteLength");
    number(o, "byteLength", who, 0, kMaxFileBytes);
    checkUri(o, who);
  }

  void checkBufferView(const json& o, const std::string& who) const {
    index(o, "buffer", "buffers", who, true);
    const uint64_t offset = number(o, "byteOffset", who, 0, kMaxFileBytes);
    const uint64_t length = number(o, "byteLength", who, 0, kMaxFileBytes);
    const uint64_t stride = number(o, "byteStride", who, 0, 252);
    if (stride != 0 && (stride < 4 || stride % 4 != 0)) {
      fail(who, fmt::format("byteStride is {}, not a multiple of 4 from 4 to 252", stride));
    }
    const auto size = list("buffers")[o["buffer"].get<size_t>()].value("byteLength", uint64_t{0});
    if (offset + length > size) {
      fail(who, fmt::format("ends at byte {}, but its buffer has {}", offset + length, size));
    }
  }

  // Throws unless `count` elements fit into the view that `o` names.
  void checkRange(const json& o, uint64_t count, uint64_t elementBytes, const std::string& who) const {
    index(o, "bufferView", "bufferViews", who, true);
    const json& view = list("bufferViews")[o["bufferView"].get<size_t>()];
    const uint64_t offset = number(o, "byteOffset", who, 0, kMaxFileBytes);
    const uint64_t stride = std::max<uint64_t>(view.value("byteStride", uint64_t{0}), elementBytes);
    const uint64_t end = count == 0 ? offset : offset + stride * (count - 1) + elementBytes;
    const uint64_t size = view.value("byteLength", uint64_t{0});
    if (end > size) {
      fail(who, fmt::format("needs {} bytes of bufferView {}, which has {}", end, o["bufferView"].get<size_t>(), size));
    }
  }

  unsigned componentBytes(const json& o, const std::string& who) const {
    const auto it = kComponentBytes.find(static_cast<int>(number(o, "componentType", who, 0, 65535)));
    if (it == kComponentBytes.end()) fail(who, "componentType is not one of 5120, 5121, 5122, 5123, 5125, 5126");
    return it->second;
  }

  void checkAccessor(const json& o, const std::string& who) const {
    const unsigned bytes = componentBytes(o, who);
    const auto type = o.find("type");
    if (type == o.end() || !type->is_string() || !kTypeComponents.contains(type->get<std::string>())) {
      fail(who, "type is not one of SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3, MAT4");
    }
    const uint64_t element = uint64_t{bytes} * kTypeComponents.at(type->get<std::string>());
    const uint64_t count = number(o, "count", who, 0, kMaxElements);
    if (o.contains("bufferView")) checkRange(o, count, element, who);
    const auto sparse = o.find("sparse");
    if (sparse == o.end()) return;
    const std::string part = who + " sparse";
    if (!sparse->is_object() || !sparse->contains("indices") || !sparse->contains("values")) {
      fail(part, "lacks indices or values");
    }
    const uint64_t replaced = number(*sparse, "count", part, 0, count);
    const json& indices = (*sparse)["indices"];
    if (!indices.is_object() || !(*sparse)["values"].is_object()) fail(part, "indices or values is not an object");
    checkRange(indices, replaced, componentBytes(indices, part), part);
    checkRange((*sparse)["values"], replaced, element, part);
  }

  void checkImage(const json& o, const std::string& who) const {
    checkUri(o, who);
    if (!o.contains("uri")) index(o, "bufferView", "bufferViews", who, true);
  }

  void checkMesh(const json& o, const std::string& who) const {
    if (!o.contains("primitives") || !o["primitives"].is_array()) fail(who, "has no primitives");
    for (const json& primitive : o["primitives"]) {
      if (!primitive.is_object()) fail(who, "has a primitive that is not an object");
      index(primitive, "indices", "accessors", who, false);
      index(primitive, "material", "materials", who, false);
      const auto attributes = primitive.find("attributes");
      if (attributes == primitive.end() || !attributes->is_object()) fail(who, "has a primitive without attributes");
      for (const auto& [name, value] : attributes->items()) checkIndex(value, name, "accessors", who);
      const auto targets = primitive.find("targets");
      if (targets == primitive.end()) continue;
      if (!targets->is_array()) fail(who, "targets is not an array");
      for (const json& target : *targets) {
        if (!target.is_object()) fail(who, "has a morph target that is not an object");
        for (const auto& [name, value] : target.items()) checkIndex(value, name, "accessors", who);
      }
    }
  }

  // Nodes form a forest: a node reached twice is in a cycle or has two parents.
  void checkTree() const {
    const json& nodes = list("nodes");
    std::vector<int64_t> parent(nodes.size(), -1);
    for (size_t i = 0; i < nodes.size(); ++i) {
      if (!nodes[i].contains("children")) continue;
      for (const json& child : nodes[i]["children"]) {
        const auto c = child.get<size_t>();
        if (parent[c] >= 0) fail(fmt::format("node {}", c), fmt::format("is a child of node {} and of node {}", parent[c], i));
        parent[c] = static_cast<int64_t>(i);
      }
    }
    // Each has one parent at most: walk up until a node known to lead to a root; meeting the walk's own
    // mark again is a cycle. Every node is marked once, so deep chains stay cheap.
    std::vector<size_t> walk(nodes.size(), 0);
    for (size_t i = 0; i < nodes.size(); ++i) {
      for (auto at = static_cast<int64_t>(i); at >= 0 && walk[static_cast<size_t>(at)] != kRooted;
           at = parent[static_cast<size_t>(at)]) {
        if (walk[static_cast<size_t>(at)] == i + 1) fail(fmt::format("node {}", at), "is its own ancestor (a cycle of nodes)");
        walk[static_cast<size_t>(at)] = i + 1;
      }
      for (auto at = static_cast<int64_t>(i); at >= 0 && walk[static_cast<size_t>(at)] == i + 1;
           at = parent[static_cast<size_t>(at)]) {
        walk[static_cast<size_t>(at)] = kRooted;
      }
    }
  }

  static constexpr size_t kRooted = ~size_t{0};
  const std::string& path_;
  const json& doc_;
};

std::vector<unsigned char> readWhole(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw Error("{}: there is no such file", path);
  if (std::filesystem::is_directory(path, error)) throw Error("{}: is a folder, not a glTF file", path);
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) throw Error("{}: cannot be read", path);
  const auto size = static_cast<uint64_t>(in.tellg());
  if (size > kMaxFileBytes) throw Error("{}: has {} bytes; at most {} are read", path, size, kMaxFileBytes);
  std::vector<unsigned char> bytes(size);
  in.seekg(0);
  in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!in) throw Error("{}: cannot be read", path);
  return bytes;
}

uint32_t littleEndian(const unsigned char* p) {
  return uint32_t{p[0]} | uint32_t{p[1]} << 8 | uint32_t{p[2]} << 16 | uint32_t{p[3]} << 24;
}

// The JSON text of a GLB, after checks of the container (glTF 2.0, section 4.4).
std::string_view jsonChunk(const std::string& path, const std::vector<unsigned char>& bytes) {
  constexpr uint64_t kHeaders = 20;  // file header and first chunk header
  if (bytes.size() < kHeaders) throw Error("{}: truncated GLB: {} bytes, headers alone need 20", path, bytes.size());
  const uint32_t version = littleEndian(&bytes[4]), length = littleEndian(&bytes[8]), chunk = littleEndian(&bytes[12]);
  if (version != 2) throw Error("{}: GLB version is {}, but only version 2 is read", path, version);
  if (length > bytes.size()) {
    throw Error("{}: truncated GLB: the header promises {} bytes, the file has {}", path, length, bytes.size());
  }
  if (kHeaders + chunk > length || littleEndian(&bytes[16]) != 0x4E4F534Au) {
    throw Error("{}: damaged GLB: the first chunk is not JSON that fits the file", path);
  }
  return {reinterpret_cast<const char*>(&bytes[kHeaders]), chunk};
}

}  // namespace

Document readDocument(const std::string& path) {
  Document document;
  document.path = path;
  document.bytes = readWhole(path);
  document.binary = document.bytes.size() >= 4 && std::memcmp(document.bytes.data(), "glTF", 4) == 0;
  const std::string_view text = document.binary
                                    ? jsonChunk(path, document.bytes)
                                    : std::string_view(reinterpret_cast<const char*>(document.bytes.data()), document.bytes.size());
  document.json = json::parse(text, nullptr, false);
  if (document.json.is_discarded()) throw Error("{}: is not glTF: neither a GLB container nor JSON text", path);
  Checker(document.path, document.json).run();
  return document;
}

}  // namespace farol
