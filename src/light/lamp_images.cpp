#include "light/lamp_images.h"

#include <algorithm>

namespace farol {
namespace {

bool reaches(const std::vector<Vec3>& polygon, const Vec3& normal, double distance) {
  return std::any_of(polygon.begin(), polygon.end(), [&](const Vec3& v) { return glm::dot(normal, v) - distance > kInPlane; });
}

bool reaches(const PlanarMirror& mirror, const Vec3& normal, double distance) {
  return std::any_of(mirror.outlines.begin(), mirror.outlines.end(),
                     [&](const std::vector<Vec3>& o) { return reaches(o, normal, distance); });
}

Lamp imageOf(const Lamp& lamp, const PlanarMirror& mirror) {
  Lamp image = lamp;
  for (Vec3& v : image.polygon) v = mirror.reflected(v);
  std::reverse(image.polygon.begin(), image.polygon.end());
  image.normal = mirror.turned(lamp.normal);
  image.centre = mirror.reflected(lamp.centre);
  image.emission *= mirror.reflectance;
  return image;
}
bool isBefore(const Lamp& lamp, const PlanarMirror& mirror) { return reaches(lamp.polygon, mirror.normal, mirror.distance); }
bool shinesOn(const Lamp& lamp, const PlanarMirror& mirror) {
  return reaches(mirror, lamp.normal, glm::dot(lamp.normal, lamp.centre));
}
double strength(const Lamp& lamp) { return maxChannel(lamp.emission); }

// A punctual light, its position in unit coordinates.
struct LightAt {
  PunctualLight light;
  Vec3 position;
  std::vector<uint32_t> mirrors;
};
LightAt imageOf(const LightAt& from, const PlanarMirror& mirror) {
  LightAt image = from;
  image.position = mirror.reflected(from.position);
  image.light.direction = mirror.turned(from.light.direction);
  image.light.intensity *= mirror.reflectance;
  return image;
}
bool isBefore(const LightAt& from, const PlanarMirror& mirror) {
  return from.light.kind == PunctualLight::Kind::directional ? glm::dot(from.light.direction, mirror.normal) < 0
                                                             : mirror.height(from.position) > kInPlane;
}
bool shinesOn(const LightAt&, const PlanarMirror&) { return true; }
double strength(const LightAt& from) { return maxChannel(from.light.intensity); }

template <typename Source>
std::optional<std::vector<Source>> imagesOf(std::span<const Source> sources, const PlanarMirrors& mirrors, const TreeLimits& limits,
                                            size_t most) {
  if (mirrors.clearSurface() != kNone || mirrors.tooMany()) return std::nullopt;
  std::vector<Source> images;
  const auto grow = [&](const Source& source, double full) {
    if (source.mirrors.size() >= limits.maxDepth) return true;
    for (uint32_t m = 0; m < mirrors.all().size(); ++m) {
      const PlanarMirror& mirror = mirrors.all()[m];
      if (!isBefore(source, mirror)) continue;  // nothing of it lies before the mirror
      if (source.mirrors.empty()) {
        if (!shinesOn(source, mirror)) continue;
      } else {
        const PlanarMirror& last = mirrors.all()[source.mirrors[0]];
        if (!reaches(mirror, last.normal, last.distance) || !reaches(last, mirror.normal, mirror.distance)) continue;
      }
      Source image = imageOf(source, mirror);
      if (strength(image) < limits.minWeight * full) continue;
      if (images.size() == most) return false;
      image.mirrors.insert(image.mirrors.begin(), m);
      images.push_back(std::move(image));
    }
    return true;
  };
  for (const Source& source : sources) {
    size_t next = images.size();
    if (!grow(source, strength(source))) return std::nullopt;
    for (; next < images.size(); ++next) {
      const Source image = images[next];
      if (!grow(image, strength(source))) return std::nullopt;
    }
  }
  return images;
}

}  // namespace

std::optional<std::vector<Lamp>> lampImages(std::span<const Lamp> lamps, const PlanarMirrors& mirrors, const TreeLimits& limits,
                                            size_t most) {
  return imagesOf(lamps, mirrors, limits, most);
}

std::optional<std::vector<PunctualLight>> lightImages(std::span<const PunctualLight> lights, const Frame& frame,
                                                      const PlanarMirrors& mirrors, const TreeLimits& limits, size_t most) {
  std::vector<LightAt> sources;
  for (const PunctualLight& light : lights) sources.push_back({light, frame.toUnit(light.position), {}});
  auto images = imagesOf(std::span<const LightAt>(sources), mirrors, limits, most);
  if (!images) return std::nullopt;
  std::vector<PunctualLight> result;
  for (LightAt& image : *images) {
    image.light.position = frame.toScene(image.position);
    image.light.mirrors = std::move(image.mirrors);
    result.push_back(std::move(image.light));
  }
  return result;
}

}  // namespace farol
