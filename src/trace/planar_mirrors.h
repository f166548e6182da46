// The planar mirrors of a scene and what is seen in them: by the method of images (Wallace, Cohen and Greenberg 1987) a mirror
// shows what would be seen straight, were it reflected at the mirror's plane.
#pragma once

#include "trace/tracer.h"

namespace farol {

// All that lies in one plane and reflects alike.
struct PlanarMirror {
  Vec3 normal{0};       // on the side that reflects
  double distance = 0;  // of the plane: normal . p [unit coordinates]
  Rgb reflectance{0};
  std::vector<std::vector<Vec3>> outlines;  // of its facets [unit coordinates]

  double height(const Vec3& p) const { return glm::dot(normal, p) - distance; }  // above the plane
  Vec3 reflected(const Vec3& p) const { return p - 2 * height(p) * normal; }
  Vec3 turned(const Vec3& direction) const { return direction - 2 * glm::dot(direction, normal) * normal; }
};

inline constexpr double kInPlane = 1e-6;  // planes and polygons closer than this are one [unit coordinates]

class PlanarMirrors {
 public:
  // The references must outlive this.
  PlanarMirrors(const FacetSet& facets, const PatchSet& patches);

  const std::vector<PlanarMirror>& all() const { return mirrors_; }
  const std::vector<uint32_t>& ofPatch() const { return ofPatch_; }  // kNone: no mirror
  // Surfaces that are more than planar mirrors, or kNone: one that light passes; one whose facets meet at shallow angles.
  uint32_t clearSurface() const { return clear_; }
  uint32_t curvedSurface() const { return curved_; }
  // Of more than kMostPlanes planes; those beyond are left out.
  bool tooMany() const { return tooMany_; }
  static constexpr size_t kMostPlanes = 1024;

  // Which of the rays in `which` arrive at origin + direction, an image, over exactly the mirrors that `ways` names for
  // their lanes, from the ray's origin on, with nothing else in between; straight where it names none.
  uint32_t connected(const Tracer& tracer, const RayPacket& rays, uint32_t which,
                     const std::array<std::span<const uint32_t>, kPacketSize>& ways) const;

 private:
  const FacetSet& facets_;
  HitPatches hitPatches_;
  std::vector<PlanarMirror> mirrors_;
  std::vector<uint32_t> ofPatch_;
  uint32_t clear_ = kNone, curved_ = kNone;
  bool tooMany_ = false;
};

}  // namespace farol
