#include "light/lamp_images.h"

#include <algorithm>

namespace farol {
namespace {

bool reaches(const std::vector<Vec3>& polygon, const Vec3& normal, double distance) {
  return std::any_of(polygon.begin(), polygon.end(), [&](const Vec3& v) { return glm::dot(normal, v) - distance > kInPlane; });
}

bool reaches(const PlanarMirror& mirror, const Vec3& normal, double distance) {
  return std::any_of(mirror.outlines.begin(), mirror.outlines.end(), [&](const std::vector<Vec3>& o) { return reaches(o, normal, distance); });
}

Lamp imageOf(const Lamp& lamp, const PlanarMirror& mirror, uint32_t number) {
  Lamp image = lamp;
  for (Vec3& v : image.polygon) v = mirror.reflected(v);
  std::reverse(image.polygon.begin(), image.polygon.end());
  image.normal = mirror.turned(lamp.normal);
  image.centre = mirror.reflected(lamp.centre);
  image.emission *= mirror.reflectance;
  image.mirrors.insert(image.mirrors.begin(), number);
  return image;
}

}  // namespace

std::optional<std::vector<Lamp>> lampImages(std::span<const Lamp> lamps, const PlanarMirrors& mirrors, const TreeLimits& limits, size_t most) {
  if (mirrors.clearSurface() != kNone || mirrors.tooMany()) return std::nullopt;
  std::vector<Lamp> images;
  const auto grow = [&](const Lamp& lamp, const Rgb& full) {
    if (lamp.mirrors.size() >= limits.maxDepth) return true;
    for (uint32_t m = 0; m < mirrors.all().size(); ++m) {
      const PlanarMirror& mirror = mirrors.all()[m];
      if (!reaches(lamp.polygon, mirror.normal, mirror.distance)) continue;  // nothing of it lies before the mirror
      if (lamp.mirrors.empty()) {
        if (!reaches(mirror, lamp.normal, glm::dot(lamp.normal, lamp.centre))) continue;
      } else {
        const PlanarMirror& last = mirrors.all()[lamp.mirrors[0]];
        if (!reaches(mirror, last.normal, last.distance) || !reaches(last, mirror.normal, mirror.distance)) continue;
      }
      Lamp image = imageOf(lamp, mirror, m);
      if (maxChannel(image.emission) < limits.minWeight * maxChannel(full)) continue;
      if (images.size() == most) return false;
      images.push_back(std::move(image));
    }
    return true;
  };
  for (const Lamp& lamp : lamps) {
    size_t next = images.size();
    if (!grow(lamp, lamp.emission)) return std::nullopt;
    for (; next < images.size(); ++next) {
      const Lamp image = images[next];
      if (!grow(image, lamp.emission)) return std::nullopt;
    }
  }
  return images;
}

}  // namespace farol
