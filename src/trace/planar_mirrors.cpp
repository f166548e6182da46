#include "trace/planar_mirrors.h"

#include <algorithm>
#include <map>
#include <set>

namespace farol {

PlanarMirrors::PlanarMirrors(const FacetSet& facets, const PatchSet& patches)
    : facets_(facets), hitPatches_(facets, patches), ofPatch_(patches.size(), kNone) {
  constexpr double kAlike = 1e-9;                       // of reflectances: means over patches differ in rounding
  std::map<std::pair<uint32_t, uint32_t>, Vec3> edges;  // of mirrors: the normal of the facet met first
  std::set<std::pair<uint32_t, uint32_t>> outlined;     // mirrors and their facets
  for (uint32_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches.patches[i];
    if (!p.isSpecular()) continue;
    if (maxChannel(p.transmission) > 0 && clear_ == kNone) clear_ = p.surface;
    if (maxChannel(p.mirror) <= 0) continue;
    const double distance = glm::dot(p.normal, facets.frame.toUnit(p.centre));
    uint32_t m = 0;
    while (m < mirrors_.size() &&
           !(glm::distance(mirrors_[m].normal, p.normal) < kInPlane && std::abs(mirrors_[m].distance - distance) < kInPlane &&
             maxChannel(glm::abs(mirrors_[m].reflectance - p.mirror)) < kAlike))
      ++m;
    if (m == kMostPlanes) {
      tooMany_ = true;
      return;
    }
    if (m == mirrors_.size()) mirrors_.push_back({p.normal, distance, p.mirror, {}});
    ofPatch_[i] = m;
    for (const uint32_t c : patches.cellsOf(i)) {
      const uint32_t number = patches.cells[c].facet;
      if (!outlined.insert({m, number}).second) continue;
      const Facet& facet = facets.facets[number];
      std::vector<Vec3> outline;
      for (size_t k = 0; k < facet.cornerCount(); ++k) {
        outline.push_back(facets.points[facet.corners[k]]);
        const uint32_t v = facet.corners[k], next = facet.corners[(k + 1) % facet.cornerCount()];
        const auto [at, isNew] = edges.try_emplace(std::minmax(v, next), p.normal);
        constexpr double kShallow = 0.7;  // cosine of 45 degrees
        const double cosine = glm::dot(at->second, p.normal);
        if (!isNew && cosine > kShallow && cosine < 1 - 1e-9 && curved_ == kNone) curved_ = p.surface;
      }
      mirrors_[m].outlines.push_back(std::move(outline));
    }
  }
  // A facet whose patches reflect differently is a mirror of each kind, as large as the facet: only their own part counts.
}

uint32_t PlanarMirrors::connected(const Tracer& tracer, const RayPacket& rays, uint32_t which,
                                  const std::array<std::span<const uint32_t>, kPacketSize>& ways) const {
  struct Lane {
    uint32_t number;
    Vec3 origin, target;
  };
  std::array<Lane, kPacketSize> lanes;
  uint32_t straight = 0;
  for (uint32_t k = 0; k < kPacketSize; ++k) straight |= ways[k].empty() ? 1u << k : 0u;
  straight &= which;
  uint32_t count = 0, arrived = straight != 0 ? straight & ~tracer.occluded(rays, straight) : 0;
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    if (((which & ~straight) >> k & 1) == 0) continue;
    const Vec3 origin(rays.ox[k], rays.oy[k], rays.oz[k]);
    lanes[count++] = {k, origin, origin + Vec3(rays.dx[k], rays.dy[k], rays.dz[k])};
  }
  RayPacket packet;
  HitPacket hits;
  for (size_t step = 0; count > 0; ++step) {
    for (uint32_t k = 0; k < count; ++k) packet.set(k, lanes[k].origin, lanes[k].target - lanes[k].origin);
    uint32_t ended = 0;  // lanes that have met all their mirrors
    for (uint32_t k = 0; k < count; ++k) ended |= ways[lanes[k].number].size() == step ? 1u << k : 0u;
    const uint32_t hidden = ended != 0 ? tracer.occluded(packet, ended) : 0;
    if (ended != firstRays(count)) tracer.intersect(packet, count, hits);
    uint32_t kept = 0;
    for (uint32_t k = 0; k < count; ++k) {
      Lane lane = lanes[k];
      if ((ended >> k & 1) != 0) {
        if ((hidden >> k & 1) == 0) arrived |= 1u << lane.number;
        continue;
      }
      const uint32_t facet = hits.facet[k], wanted = ways[lane.number][step];
      if (facet == kNone) continue;
      const uint32_t patch = hitPatches_.at(facet, hitPatches_.seenFromBehind(facet, packet, k), hits.u[k], hits.v[k]);
      if (patch == kNone || ofPatch_[patch] != wanted) continue;
      const PlanarMirror& mirror = mirrors_[wanted];
      const double from = mirror.height(lane.origin), to = mirror.height(lane.target);
      if (from <= 0 || to >= 0) continue;  // the image of something behind the mirror
      lane.origin += from / (from - to) * (lane.target - lane.origin) + facets_.facets[facet].rayOffset * mirror.normal;
      lane.target = mirror.reflected(lane.target);
      lanes[kept++] = lane;
    }
    count = kept;
  }
  return arrived;
}

}  // namespace farol
