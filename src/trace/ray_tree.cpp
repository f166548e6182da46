#include "trace/ray_tree.h"

#include <span>

namespace farol {

double fresnel(double cosine, double ratio, double& cosineThrough) {
  const double sineThrough = std::sqrt(std::max(0.0, 1 - cosine * cosine)) / ratio;
  cosineThrough = 0;
  if (sineThrough >= 1) return 1;
  cosineThrough = std::sqrt(1 - sineThrough * sineThrough);
  const double across = (cosine - ratio * cosineThrough) / (cosine + ratio * cosineThrough);
  const double along = (ratio * cosine - cosineThrough) / (ratio * cosine + cosineThrough);
  return 0.5 * (across * across + along * along);
}

RayTree::RayTree(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const TreeLimits& limits)
    : tracer_(tracer), facets_(facets), patches_(patches), limits_(limits), hitPatches_(facets, patches) {
  for (const Patch& p : patches.patches) optics_.push_back({p.mirror, p.transmission, p.isSpecular()});
  for (const Facet& f : facets.facets) {
    const Vec3& o = facets.points[f.corners[0]];
    const double shortest = std::min(glm::distance(facets.points[f.corners[1]], o), glm::distance(facets.points[f.vCorner()], o));
    margins_.push_back(std::min(0.01, 2 * kRayOffset / shortest));
  }
}

uint32_t RayTree::mediumBehind(uint32_t patch) const {
  const Patch& p = patches_.patches[patch];
  return p.back && patches_.media[p.surface].solid ? p.surface : kNone;
}

Vec3 RayTree::pointOn(uint32_t facet, double u, double v) const {
  const Facet& f = facets_.facets[facet];
  const double low = margins_[facet], high = 1 - low;
  u = std::clamp(u, low, high);
  v = std::clamp(v, low, high);
  if (!f.parallelogram && u + v > high) {
    const double scale = high / (u + v);
    u *= scale;
    v *= scale;
  }
  return facets_.point(f, u, v);
}

Rgb RayTree::passed(uint32_t medium, double distance) const {
  if (medium == kNone) return Rgb(1);
  const Rgb& attenuation = patches_.media[medium].attenuation;
  return maxChannel(attenuation) > 0 ? glm::exp(-attenuation * (distance * facets_.frame.size)) : Rgb(1);
}

void RayTree::spawnRay(const Vec3& origin, const Vec3& direction, const Rgb& weight, uint32_t medium, uint32_t depth, double share,
                       std::vector<Ray>& rays, PathEnds& ends) const {
  if (maxChannel(weight) <= 0) return;
  if (depth > limits_.maxDepth || maxChannel(weight) < limits_.minWeight * share)
    ends.cut += weight;
  else
    rays.push_back({origin, direction, weight, medium, depth, share});
}

void RayTree::spawn(const SpecularHit& hit, std::vector<Ray>& rays, PathEnds& ends) const {
  const Facet& facet = facets_.facets[hit.facet];
  const PatchOptics& optics = optics_[hit.patch];
  const Medium& own = patches_.media[facet.surface];
  const Vec3 normal = hit.back ? -facet.normal : facet.normal;
  const double cosine = std::max(-glm::dot(hit.direction, normal), 1e-9);
  const uint32_t here = hit.back && own.solid ? facet.surface : hit.medium;
  Rgb mirrored = optics.mirror;
  if (maxChannel(optics.transmission) > 0) {
    Vec3 through = hit.direction;
    uint32_t beyond = hit.medium;
    double reflectance = 0, cosineThrough = 0;
    if (own.solid) {
      beyond = hit.back ? kNone : facet.surface;
      const double from = here == kNone ? 1 : patches_.media[here].ior, to = hit.back ? 1 : own.ior;
      reflectance = fresnel(cosine, to / from, cosineThrough);
      through = (from / to) * hit.direction + ((from / to) * cosine - cosineThrough) * normal;
    } else {  // a sheet: all reflections between its faces, no deviation
      reflectance = fresnel(cosine, own.ior, cosineThrough);
      reflectance = 2 * reflectance / (1 + reflectance);
    }
    mirrored += optics.transmission * reflectance;
    if (reflectance < 1) {
      spawnRay(hit.point - facet.rayOffset * normal, through, hit.weight * optics.transmission * (1 - reflectance), beyond,
               hit.depth + 1, hit.share, rays, ends);
    }
  }
  spawnRay(hit.point + facet.rayOffset * normal, hit.direction + 2 * cosine * normal, hit.weight * mirrored, here, hit.depth + 1,
           hit.share, rays, ends);
}

void RayTree::follow(std::span<const SpecularHit> hits, PathSink& sink, PathEnds& ends) const {
  constexpr size_t kMostPerHit = 1024;
  const size_t most = kMostPerHit * hits.size();
  static thread_local std::vector<Ray> ownRays;
  std::vector<Ray>& rays = ownRays;  // the last ones are traced first: few wait at a time
  rays.clear();
  size_t traced = 0, next = 0;
  RayPacket packet;
  HitPacket found;
  std::array<Ray, kPacketSize> lane;
  while (next < hits.size() || !rays.empty()) {
    while (rays.size() < kPacketSize && next < hits.size()) spawn(hits[next++], rays, ends);
    const auto lanes = static_cast<uint32_t>(std::min<size_t>(kPacketSize, rays.size()));
    traced += lanes;
    for (uint32_t k = 0; k < lanes; ++k) {
      lane[k] = rays.back();
      rays.pop_back();
      packet.set(k, lane[k].origin, lane[k].direction);
    }
    if (traced > most) {
      for (uint32_t k = 0; k < lanes; ++k) ends.cut += lane[k].weight;
      continue;
    }
    tracer_.intersect(packet, lanes, found);
    for (uint32_t k = 0; k < lanes; ++k) {
      const Ray& ray = lane[k];
      const uint32_t facet = found.facet[k];
      if (facet == kNone) {
        ends.missed += ray.weight;
        continue;
      }
      const bool back = hitPatches_.seenFromBehind(facet, packet, k);
      const uint32_t patch = hitPatches_.at(facet, back, found.u[k], found.v[k]);
      Rgb weight = ray.weight;
      const bool specular = patch != kNone && optics_[patch].specular;
      Vec3 point(0);
      if (ray.medium != kNone || specular) point = pointOn(facet, static_cast<double>(found.u[k]), static_cast<double>(found.v[k]));
      if (ray.medium != kNone) {
        weight *= passed(ray.medium, glm::distance(point, ray.origin));
        ends.absorbed += ray.weight - weight;
      }
      if (patch == kNone) {
        ends.backs += weight;
        continue;
      }
      sink.met({facet, patch, back, found.u[k], found.v[k], weight});
      if (specular) spawn({point, ray.direction, weight, facet, patch, back, ray.medium, ray.depth, ray.share}, rays, ends);
    }
  }
}

}  // namespace farol
