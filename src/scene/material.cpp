#include "scene/material.h"

namespace farol {
namespace {

// Linear value of an 8-bit sRGB code (IEC 61966-2-1).
double decodeSrgb(uint8_t code) {
  static const std::array<double, 256> table = [] {
    std::array<double, 256> t{};
    for (int i = 0; i < 256; ++i) {
      const double c = i / 255.0;
      t[static_cast<size_t>(i)] = c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
    }
    return t;
  }();
  return table[code];
}

int wrapTexel(int i, int n, Wrap wrap) {
  switch (wrap) {
    case Wrap::clamp:
      return std::clamp(i, 0, n - 1);
    case Wrap::mirror: {
      const int period = 2 * n;
      const int k = ((i % period) + period) % period;
      return k < n ? k : period - 1 - k;
    }
    case Wrap::repeat:
      break;
  }
  return ((i % n) + n) % n;
}

}  // namespace

Vec2 TextureUse::transform(Vec2 uv) const {
  // KHR_texture_transform: scale, then rotate, then offset.
  const double c = std::cos(rotation), s = std::sin(rotation);
  const Vec2 q = uv * scale;
  return {c * q.x + s * q.y + offset.x, -s * q.x + c * q.y + offset.y};
}

std::array<double, 4> Texture::sample(Vec2 uv, bool srgb) const {
  const auto texel = [&](int x, int y) {
    const size_t at = 4 * (static_cast<size_t>(wrapTexel(y, height, wrapV)) * static_cast<size_t>(width) +
                           static_cast<size_t>(wrapTexel(x, width, wrapU)));
    std::array<double, 4> value{};
    for (size_t c = 0; c < 4; ++c) {
      value[c] = srgb && c < 3 ? decodeSrgb(rgba[at + c]) : rgba[at + c] / 255.0;
    }
    return value;
  };
  // Far outside any sensible range the integer conversion would overflow; textures repeat there anyway.
  const double x = std::clamp(uv.x * width, -1e9, 1e9) - (nearest ? 0.0 : 0.5);
  const double y = std::clamp(uv.y * height, -1e9, 1e9) - (nearest ? 0.0 : 0.5);
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  if (nearest) return texel(x0, y0);
  const double fx = x - x0, fy = y - y0;
  const auto a = texel(x0, y0), b = texel(x0 + 1, y0), c = texel(x0, y0 + 1), d = texel(x0 + 1, y0 + 1);
  std::array<double, 4> value{};
  for (size_t k = 0; k < 4; ++k) {
    value[k] = (1 - fy) * ((1 - fx) * a[k] + fx * b[k]) + fy * ((1 - fx) * c[k] + fx * d[k]);
  }
  return value;
}

Optics Material::evaluate(const std::vector<Texture>& textures, const PointAttributes& at) const {
  const auto look = [&](const TextureUse& use, bool srgb) {
    return textures[static_cast<size_t>(use.texture)].sample(use.transform(at.uv[static_cast<size_t>(use.set)]), srgb);
  };
  Rgb base = baseColor * at.color;
  if (baseTexture.used()) {
    const auto t = look(baseTexture, true);
    base *= Rgb(t[0], t[1], t[2]);
  }
  double m = unlit ? 0 : metallic, rough = roughness, t = unlit ? 0 : transmission;
  if (metallicRoughnessTexture.used()) {
    const auto texel = look(metallicRoughnessTexture, false);
    rough *= texel[1];
    m *= texel[2];
  }
  if (transmissionTexture.used()) t *= look(transmissionTexture, false)[0];

  Optics optics;
  optics.diffuse = base * (1 - m) * (1 - t);
  (rough <= kMirrorRoughness ? optics.specular : optics.diffuse) += base * m;
  optics.transmission = base * (1 - m) * t;
  optics.emission = emission;
  if (emissionTexture.used()) {
    const auto e = look(emissionTexture, true);
    optics.emission *= Rgb(e[0], e[1], e[2]);
  }
  if (exactDiffuse || exactSpecular || exactTransmission) {  // what extras.farol leaves out is 0
    optics.diffuse = exactDiffuse.value_or(Rgb(0));
    optics.specular = exactSpecular.value_or(Rgb(0));
    optics.transmission = exactTransmission.value_or(Rgb(0));
  }
  if (exactEmission) optics.emission = *exactEmission;
  return optics;
}

}  // namespace farol
