#include "scene/material_load.h"

#include "base/error.h"

#include <array>
#include <string_view>

namespace farol {
namespace {

using nlohmann::json;

// Reads the members of one material, each checked for kind and range.
class MaterialReader {
 public:
  MaterialReader(const Document& document, std::string who, Log& log) : document_(document), who_(std::move(who)), log_(log) {}

  Material read(const json& o) {
    Material m;
    m.name = o.value("name", std::string());
    m.doubleSided = o.value("doubleSided", false);
    const json& pbr = object(o, "pbrMetallicRoughness");
    m.baseColor = color(pbr, "baseColorFactor", Rgb(1), 1, 4);
    if (!pbr.contains("baseColorFactor") && !pbr.contains("baseColorTexture")) defaultsUsed = true;
    m.metallic = number(pbr, "metallicFactor", 1, 0, 1);
    m.roughness = number(pbr, "roughnessFactor", 1, 0, 1);
    m.baseTexture = texture(pbr, "baseColorTexture");
    m.metallicRoughnessTexture = texture(pbr, "metallicRoughnessTexture");

    const json& extensions = object(o, "extensions");
    m.unlit = extensions.contains("KHR_materials_unlit");
    if (m.unlit) log_.note(fmt::format("{}: unlit, its base colour is taken as reflectance", who_));
    const double strength = number(object(extensions, "KHR_materials_emissive_strength"), "emissiveStrength", 1, 0, 1e30);
    // Emitted radiance L becomes exitance E = pi L here and nowhere else.
    m.emission = kPi * strength * color(o, "emissiveFactor", Rgb(0), 1, 3);
    m.emissionTexture = texture(o, "emissiveTexture");
    readTransmission(extensions, m);
    readExact(object(object(o, "extras"), "farol"), m);
    return m;
  }

  bool defaultsUsed = false;

 private:
  [[noreturn]] void fail(const std::string& what) const { throw Error("{}: {}: {}", document_.path, who_, what); }

  const json& object(const json& o, const char* key) const {
    static const json empty = json::object();
    const auto it = o.find(key);
    if (it == o.end()) return empty;
    if (!it->is_object()) {
      if (std::string_view(key) == "extras") return empty;  // extras may be anything
      fail(fmt::format("{} is not an object", key));
    }
    return *it;
  }

  double number(const json& o, const char* key, double fallback, double low, double high) const {
    const auto it = o.find(key);
    if (it == o.end()) return fallback;
    if (!it->is_number() || it->get<double>() < low || it->get<double>() > high) {
      fail(fmt::format("{} is {}, not a number from {} to {}", key, it->dump(), low, high));
    }
    return it->get<double>();
  }

  // Three channels in [0, high]; `length` entries are expected (a fourth, alpha, is not used).
  Rgb color(const json& o, const char* key, Rgb fallback, double high, size_t length) const {
    const auto it = o.find(key);
    if (it == o.end()) return fallback;
    if (!it->is_array() || it->size() != length) fail(fmt::format("{} is not an array of {} numbers", key, length));
    Rgb value(0);
    for (int c = 0; c < 3; ++c) {
      const json& x = (*it)[static_cast<size_t>(c)];
      if (!x.is_number() || !(x.get<double>() >= 0 && x.get<double>() <= high)) {
        fail(fmt::format("{} channel {} is {}, outside [0, {}]", key, "rgb"[c], x.dump(), high));
      }
      value[c] = x.get<double>();
    }
    return value;
  }

  TextureUse texture(const json& o, const char* key) const {
    TextureUse use;
    const json& info = object(o, key);
    if (info.empty()) return use;
    const size_t count = document_.json.contains("textures") ? document_.json["textures"].size() : 0;
    const auto it = info.find("index");
    if (it == info.end() || !it->is_number_unsigned() || it->get<size_t>() >= count) {
      fail(fmt::format("{}: index is {}, but the file has {} textures", key, it == info.end() ? "missing" : it->dump(), count));
    }
    use.texture = it->get<int>();
    use.set = static_cast<int>(number(info, "texCoord", 0, 0, 15));
    const json& transform = object(object(info, "extensions"), "KHR_texture_transform");
    use.set = static_cast<int>(number(transform, "texCoord", use.set, 0, 15));
    if (use.set > 1) fail(fmt::format("{}: texCoord is {}; sets 0 and 1 are read", key, use.set));
    use.rotation = number(transform, "rotation", 0, -1e6, 1e6);
    use.offset = pair(transform, "offset", Vec2(0));
    use.scale = pair(transform, "scale", Vec2(1));
    return use;
  }

  Vec2 pair(const json& o, const char* key, Vec2 fallback) const {
    const auto it = o.find(key);
    if (it == o.end()) return fallback;
    if (!it->is_array() || it->size() != 2 || !(*it)[0].is_number() || !(*it)[1].is_number()) {
      fail(fmt::format("KHR_texture_transform: {} is not two numbers", key));
    }
    return {(*it)[0].get<double>(), (*it)[1].get<double>()};
  }

  void readTransmission(const json& extensions, Material& m) const {
    const json& transmission = object(extensions, "KHR_materials_transmission");
    m.transmission = number(transmission, "transmissionFactor", 0, 0, 1);
    m.transmissionTexture = texture(transmission, "transmissionTexture");
    m.ior = number(object(extensions, "KHR_materials_ior"), "ior", 1.5, 0, 1e6);
    const json& volume = object(extensions, "KHR_materials_volume");
    m.thickness = number(volume, "thicknessFactor", 0, 0, 1e30);
    m.attenuationColor = color(volume, "attenuationColor", Rgb(1), 1, 3);
    m.attenuationDistance = number(volume, "attenuationDistance", 0, 0, 1e30);
    if (m.transmission > 0 && m.roughness > kMirrorRoughness && !m.metallicRoughnessTexture.used()) {
      fail(fmt::format("transmission with roughness {} is not supported; up to {} it is taken as clear", m.roughness,
                       kMirrorRoughness));
    }
  }

  void readExact(const json& o, Material& m) const {
    for (const auto& [key, value] : o.items()) {
      static constexpr std::array<std::string_view, 6> known = {"diffuse", "specular", "transmission", "ior", "solid", "emission"};
      if (std::find(known.begin(), known.end(), key) == known.end()) {
        log_.warn(
            {"unknown-property", fmt::format("{}: {}: extras.farol.{} is not known and was ignored", document_.path, who_, key)});
      }
    }
    const auto exact = [&](const char* key, double high, std::optional<Rgb>& target) {
      if (o.contains(key)) target = color(o, key, Rgb(0), high, 3);
    };
    exact("diffuse", 1, m.exactDiffuse);
    exact("specular", 1, m.exactSpecular);
    exact("transmission", 1, m.exactTransmission);
    exact("emission", 1e30, m.exactEmission);
    m.ior = number(o, "ior", m.ior, 1e-6, 1e6);
    if (const auto it = o.find("solid"); it != o.end()) {
      if (!it->is_boolean()) fail("extras.farol.solid is not true or false");
      m.exactSolid = it->get<bool>();
    }
    const Rgb sum = m.exactDiffuse.value_or(Rgb(0)) + m.exactSpecular.value_or(Rgb(0)) + m.exactTransmission.value_or(Rgb(0));
    if (maxChannel(sum) > 1 + 1e-9) {
      fail(fmt::format("extras.farol: diffuse + specular + transmission is {}, above 1", maxChannel(sum)));
    }
  }

  const Document& document_;
  std::string who_;
  Log& log_;
};

}  // namespace

std::vector<Material> loadMaterials(const Document& document, Log& log) {
  std::vector<Material> materials;
  const json& list = document.json.contains("materials") ? document.json["materials"] : json::array();
  bool defaultsUsed = false;
  for (size_t i = 0; i < list.size(); ++i) {
    const std::string name = list[i].contains("name") && list[i]["name"].is_string() ? list[i]["name"].get<std::string>() : "";
    MaterialReader reader(document, name.empty() ? fmt::format("material {}", i) : fmt::format("material '{}'", name), log);
    try {
      materials.push_back(reader.read(list[i]));
    } catch (const json::exception& e) {
      throw Error("{}: material {}: a member has the wrong kind of value ({})", document.path, i, e.what());
    }
    const bool exact = materials.back().exactDiffuse.has_value();
    defaultsUsed = defaultsUsed || (reader.defaultsUsed && !exact);
  }
  if (defaultsUsed) log.note("some materials have no base colour: glTF's default of 1 (white) is taken as given");
  Material fallback;  // glTF's default material is white metal of roughness 1, which counts as diffuse
  fallback.name = "(default)";
  materials.push_back(fallback);
  return materials;
}

std::vector<Texture> loadTextures(const Document& document, const tinygltf::Model& model) {
  const auto wrapOf = [](int mode) {
    if (mode == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return Wrap::clamp;
    return mode == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT ? Wrap::mirror : Wrap::repeat;
  };
  std::vector<Texture> textures;
  for (size_t i = 0; i < model.textures.size(); ++i) {
    const tinygltf::Texture& source = model.textures[i];
    if (source.source < 0) throw Error("{}: texture {}: has no image that can be read (PNG or JPEG)", document.path, i);
    const tinygltf::Image& image = model.images[static_cast<size_t>(source.source)];
    Texture t;
    t.name = image.name;
    t.width = image.width;
    t.height = image.height;
    const size_t texels =
        image.width > 0 && image.height > 0 ? static_cast<size_t>(image.width) * static_cast<size_t>(image.height) : 0;
    const size_t bytes = image.bits == 16 ? 2 : 1;
    if (texels == 0 || image.component != 4 || image.image.size() < texels * 4 * bytes) {
      throw Error("{}: image {} '{}': cannot be read as a picture", document.path, source.source, image.uri);
    }
    t.rgba.resize(texels * 4);
    for (size_t k = 0; k < t.rgba.size(); ++k) t.rgba[k] = image.image[k * bytes + (bytes - 1)];  // high byte of 16 bit
    if (source.sampler >= 0) {
      const tinygltf::Sampler& sampler = model.samplers[static_cast<size_t>(source.sampler)];
      t.wrapU = wrapOf(sampler.wrapS);
      t.wrapV = wrapOf(sampler.wrapT);
      t.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    }
    textures.push_back(std::move(t));
  }
  return textures;
}

}  // namespace farol
