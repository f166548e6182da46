// What a ray meets first: the facets of a scene behind Embree.
#pragma once

#include "patch/patches.h"

#include <memory>
#include <string>

namespace farol {

// Sixteen rays side by side, in unit coordinates. Directions need not be unit vectors.
inline constexpr uint32_t kPacketSize = 16;
struct alignas(64) RayPacket {
  float ox[kPacketSize], oy[kPacketSize], oz[kPacketSize];
  float dx[kPacketSize], dy[kPacketSize], dz[kPacketSize];

  void set(uint32_t lane, const Vec3& origin, const Vec3& direction) {
    ox[lane] = static_cast<float>(origin.x);
    oy[lane] = static_cast<float>(origin.y);
    oz[lane] = static_cast<float>(origin.z);
    dx[lane] = static_cast<float>(direction.x);
    dy[lane] = static_cast<float>(direction.y);
    dz[lane] = static_cast<float>(direction.z);
  }
};
inline constexpr uint32_t firstRays(uint32_t count) { return (1u << count) - 1; }  // bits of so many
struct alignas(64) HitPacket {
  uint32_t facet[kPacketSize];  // kNone where a ray leaves the scene
  float u[kPacketSize], v[kPacketSize];
};

// Facets in an Embree scene with its robust traversal: no ray slips between facets that share an edge. All calls may
// come from several threads at once.
class Tracer {
 public:
  explicit Tracer(const FacetSet& facets);
  ~Tracer();
  Tracer(const Tracer&) = delete;
  Tracer& operator=(const Tracer&) = delete;

  // First hits of the first `count` rays; what the packet holds beyond them is ignored.
  void intersect(const RayPacket& rays, uint32_t count, HitPacket& hits) const;

  // Bit k: something lies between the origin and origin + direction of ray k, for the rays whose bits are set in `which`.
  uint32_t occluded(const RayPacket& rays, uint32_t which) const;

  // Whether lane k's ray meets this facet's back.
  bool seenFromBehind(uint32_t facet, const RayPacket& rays, uint32_t k) const;

  // "Embree 3.13.5, packets of 8".
  std::string description() const;
  static std::string versionText();  // of a device made for the purpose

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Finds the patch of a hit: facet, side and (u,v) through the cell map.
class HitPatches {
 public:
  HitPatches(const FacetSet& facets, const PatchSet& patches);

  bool seenFromBehind(uint32_t facet, const RayPacket& rays, uint32_t k) const {
    const glm::vec3& n = records_[facet].normal;
    return rays.dx[k] * n.x + rays.dy[k] * n.y + rays.dz[k] * n.z > 0;
  }

  // kNone when that side has no patch: a black back.
  uint32_t at(uint32_t facet, bool back, float u, float v) const {
    const Record& r = records_[facet];
    const uint32_t first = back ? r.backCell : r.frontCell;
    if (first == kNone) return kNone;
    const float fu = u * r.nu, fv = v * r.nv;
    const uint32_t iu = std::min(static_cast<uint32_t>(std::max(fu, 0.0f)), r.lastU);
    const uint32_t iv = std::min(static_cast<uint32_t>(std::max(fv, 0.0f)), r.lastV);
    if (r.parallelogram) return cellMap_[first + iv * (r.lastU + 1) + iu];
    const uint32_t n = r.lastU + 1, column = std::min(iu, n - 1 - iv);
    const bool inverted = (fu - static_cast<float>(column)) + (fv - static_cast<float>(iv)) > 1 && column + iv + 1 < n;
    return cellMap_[first + iv * (2 * n - iv) + 2 * column + (inverted ? 1 : 0)];
  }

 private:
  struct Record {
    glm::vec3 normal;
    float nu, nv;
    uint32_t lastU, lastV, frontCell, backCell;
    bool parallelogram;
  };
  std::vector<Record> records_;
  const std::vector<uint32_t>& cellMap_;
};

}  // namespace farol
