// Reflectance, transmission and emission of a surface, constant or from textures.
#pragma once

#include "base/math.h"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace farol {

enum class Wrap { repeat, mirror, clamp };

// An 8-bit image with its sampler. Row 0 is at v = 0.
struct Texture {
  std::string name;
  int width = 0, height = 0;
  std::vector<uint8_t> rgba;  // 4 bytes per texel, rows from top to bottom
  Wrap wrapU = Wrap::repeat, wrapV = Wrap::repeat;
  bool nearest = false;

  // Bilinear (or nearest) value at (u,v), channels in [0,1]; `srgb` decodes r, g, b before filtering.
  std::array<double, 4> sample(Vec2 uv, bool srgb) const;
};

// A reference to a texture: which one, which coordinate set, and KHR_texture_transform.
struct TextureUse {
  int texture = -1;  // -1: none
  int set = 0;
  Vec2 offset{0}, scale{1};
  double rotation = 0;  // [rad], counter-clockwise

  bool used() const { return texture >= 0; }
  Vec2 transform(Vec2 uv) const;
};

// What a surface does with light at one point. Per channel: diffuse + specular + transmission <= 1.
struct Optics {
  Rgb diffuse{0};       // reflectance rho
  Rgb specular{0};      // mirror reflectance
  Rgb transmission{0};  // share that passes the surface without scattering
  Rgb emission{0};      // exitance E = pi L [flux per area]
};

// Attributes of a surface point that materials depend on.
struct PointAttributes {
  std::array<Vec2, 2> uv{Vec2(0), Vec2(0)};
  Rgb color{1};
};

struct Material {
  std::string name;
  bool doubleSided = false, unlit = false;
  Rgb baseColor{1};
  double metallic = 1, roughness = 1, transmission = 0, ior = 1.5, thickness = 0;
  Rgb attenuationColor{1};
  double attenuationDistance = 0;  // [scene units]; 0: no attenuation
  Rgb emission{0};                 // exitance E = pi L, before its texture
  TextureUse baseTexture, metallicRoughnessTexture, emissionTexture, transmissionTexture;

  // extras.farol: exact values that replace the above.
  std::optional<Rgb> exactDiffuse, exactSpecular, exactTransmission, exactEmission;
  std::optional<bool> exactSolid;

  bool textured() const {
    return baseTexture.used() || metallicRoughnessTexture.used() || emissionTexture.used() || transmissionTexture.used();
  }
  bool transmits() const {  // light passes somewhere
    const bool exact = exactDiffuse || exactSpecular || exactTransmission;
    return exact ? exactTransmission && maxChannel(*exactTransmission) > 0 : !unlit && transmission > 0;
  }
  bool solid() const { return exactSolid.value_or(thickness > 0); }  // the mesh bounds a solid; otherwise a thin sheet
  Optics evaluate(const std::vector<Texture>& textures, const PointAttributes& at) const;
};

// Roughness up to which a metal is taken as a perfect mirror; rougher metal counts as diffuse.
inline constexpr double kMirrorRoughness = 0.2;

}  // namespace farol
