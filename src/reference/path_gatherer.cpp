#include "reference/path_gatherer.h"

#include "light/direct.h"

namespace farol {

struct PathGatherer::Lane {
  GatherPath* path = nullptr;  // null: idle
  uint64_t random = 0;
  uint32_t used = 0;  // of the path's numbers
  uint32_t depth = 0;
  bool last = false;  // light here ends the path
  Rgb weight{1};
  double offset = kRayOffset;  // of rays from the point
  Vec3 point{0}, normal{0}, direction{0};

  double next() { return used < path->numbers.size() ? path->numbers[used++] : unitFromBits(mixBits(random++)); }
  void setDirection(double a, double b) {  // distributed as the cosine
    const double r = std::sqrt(a), angle = 2 * kPi * b;
    const Vec3 t = anyPerpendicular(normal), u = glm::cross(normal, t);
    direction = r * std::cos(angle) * t + r * std::sin(angle) * u + std::sqrt(1 - a) * normal;
  }
};

struct PathGatherer::ShadowRays {
  RayPacket rays;
  std::array<Rgb, kPacketSize> light;                       // that arrives when nothing is in between; zero: no ray
  std::array<std::span<const uint32_t>, kPacketSize> ways;  // over mirrors

  ShadowRays() {
    for (uint32_t k = 0; k < kPacketSize; ++k) clear(k);
  }
  void clear(uint32_t k) {
    rays.set(k, Vec3(0), Vec3(0, 0, 1e-30));
    light[k] = Rgb(0);
    ways[k] = {};
  }
};

namespace {

// What continuations over mirrors and glass meet.
struct Met : PathSink {
  void met(const PathHit& hit) override { hits.push_back(hit); }
  std::vector<PathHit> hits;
};

}  // namespace

PathGatherer::PathGatherer(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const Scene& scene,
                           const LampPlan& lamps, const Rgb& sky, const TreeLimits& limits)
    : tracer_(tracer),
      facets_(facets),
      scene_(scene),
      plan_(lamps),
      lamps_(lamps.lamps),
      lights_(scene.lights),
      sky_(sky),
      hitPatches_(facets, patches),
      tree_(tracer, facets, patches, limits) {
  patchesSpecular_ = patches.anySpecular();
  if (patchesSpecular_ && (!lamps_.empty() || !lights_.empty())) {
    mirrors_.emplace(facets, patches);
    const auto images = lampImages(lamps.lamps, *mirrors_, limits);
    const auto ofLights = lightImages(scene.lights, facets.frame, *mirrors_, limits);
    if (images) lamps_.insert(lamps_.end(), images->begin(), images->end());
    if (ofLights) lights_.insert(lights_.end(), ofLights->begin(), ofLights->end());
    imagesOfLamps_ = images.has_value();
    missesLights_ = !lights_.empty() && !ofLights;
    if (!images && !ofLights) mirrors_.reset();
  }
  for (const Surface& s : scene.surfaces) {
    const Material& m = scene.materials[s.material];
    varies_.push_back(m.textured() || !s.colors.empty() ? 1 : 0);
    constant_.push_back(m.evaluate(scene.textures, {}));
  }
}

void PathGatherer::endWith(const PatchSet& patches, std::span<const Rgb> irradiance, const std::vector<double>& exposed) {
  constexpr uint32_t kShadowRays = 128;
  knownPatches_.emplace(facets_, patches);
  known_.assign(irradiance.begin(), irradiance.end());
  if (lamps_.empty() && lights_.empty()) return;
  const DirectLight direct =
      DirectIrradiance(tracer_, facets_, patches, lamps_, lights_, {kShadowRays, 1, mirrors_ ? &*mirrors_ : nullptr})
          .compute(exposed);
  for (size_t i = 0; i < known_.size(); ++i) known_[i] -= direct.irradiance[i];
}

SpecularLight PathGatherer::follow(const PatchSet& patches, std::span<const double> exposed, size_t rays, uint64_t seed) const {
  const std::vector<uint8_t> none(patches.size(), 0);
  return traceSpecularLight(tracer_, facets_, patches, tree_, imagesOfLamps_ ? none : plan_.apart,
                            missesLights_ ? std::span<const PunctualLight>(scene_.lights) : std::span<const PunctualLight>(),
                            exposed, rays, seed, [](double) {});
}

Optics PathGatherer::opticsAt(uint32_t facet, double u, double v) const {
  const Facet& f = facets_.facets[facet];
  if (varies_[f.surface] == 0) return constant_[f.surface];
  const Surface& s = scene_.surfaces[f.surface];
  return scene_.materials[s.material].evaluate(scene_.textures, attributesAt(s, f, u, v));
}

void PathGatherer::start(GatherPath& path, Lane& lane) const {
  const Facet& facet = facets_.facets[path.facet];
  path.irradiance = Rgb(0);
  lane = {};
  lane.path = &path;
  lane.random = mixBits(path.seed) << 12;
  lane.offset = facet.rayOffset;
  lane.normal = path.back ? -facet.normal : facet.normal;
  lane.point = facets_.point(facet, path.uv.x, path.uv.y);
  const double a = lane.next(), b = lane.next();
  lane.setDirection(a, b);
}

// By about what each lamp brings unless something is in between: never 0 for one that may bring something. `s`, a number in
// [0,1), is used up and made anew. All lamps: none brings anything.
std::pair<size_t, double> PathGatherer::chooseLamp(const Lane& lane, double& s) const {
  const size_t count = lamps_.size();
  if (count == 1) return {0, 1.0};
  thread_local std::vector<double> sums;  // cumulative
  sums.resize(count);
  double sum = 0;
  for (size_t l = 0; l < count; ++l) {
    const Lamp& lamp = lamps_[l];
    const Vec3 d = lamp.centre - lane.point;
    const double above = glm::dot(lane.normal, d) + lamp.radius, there = -glm::dot(lamp.normal, d);
    const double squared = std::max(glm::dot(d, d), lamp.radius * lamp.radius);
    if (above > 0 && there > 0) sum += lamp.area * luminance(lamp.emission) * above * there / (squared * squared);
    sums[l] = sum;
  }
  if (sum <= 0) return {count, 0.0};
  for (double& x : sums) x /= sum;
  const size_t which =
      std::min<size_t>(static_cast<size_t>(std::upper_bound(sums.begin(), sums.end(), s) - sums.begin()), count - 1);
  const double before = which > 0 ? sums[which - 1] : 0, chance = sums[which] - before;
  s = std::min((s - before) / chance, 1.0);
  return {which, chance};
}

// Light of a lamp is sampled by its points, or met, from those that are this close. Where a surface touches a lamp, what a point at
// distance r brings goes as r^-2, and its square over points of both (r^2 dr) has no finite integral: shadow rays have no finite
// variance. What rays by the cosine find there is never more than the exitance.
bool PathGatherer::close(const Vec3& point, const Vec3& onLamp, uint32_t facet) const {
  constexpr double kClose = 0.25;  // squared distance, in areas of the lamp's facet
  const Vec3 d = onLamp - point;
  return glm::dot(d, d) < kClose * facets_.facets[facet].area;
}

// Whether some lamp may be close to the point.
bool PathGatherer::closeToLamps(const Vec3& point) const {
  return std::any_of(plan_.lamps.begin(), plan_.lamps.end(), [&](const Lamp& lamp) {
    const double far = glm::distance(point, lamp.centre);
    return far <= lamp.radius || close(point, point + (lamp.centre - point) * ((far - lamp.radius) / far), lamp.facet);
  });
}

// One point of one lamp, and one punctual light.
void PathGatherer::light(Lane& lane, uint32_t k, ShadowRays& toLamps, ShadowRays& toPunctual) const {
  toLamps.clear(k);
  toPunctual.clear(k);
  const Vec3 from = lane.point + lane.offset * lane.normal;
  if (!lamps_.empty()) {
    double s = lane.next(), t = lane.next();
    const auto [which, chance] = chooseLamp(lane, s);
    if (which == lamps_.size()) return lightPunctual(lane, k, toPunctual);
    const Lamp& lamp = lamps_[which];
    // A parallelogram or a triangle: both are affine, and a triangle is half of one.
    const bool half = lamp.polygon.size() == 3;
    if (half && s + t > 1) {
      s = 1 - s;
      t = 1 - t;
    }
    const Vec3& corner = lamp.polygon[0];
    const Vec3 q = corner + s * (lamp.polygon[1] - corner) + t * (lamp.polygon[half ? 2 : 3] - corner);
    const Vec3 d = q - lane.point;
    const double squared = glm::dot(d, d), here = glm::dot(lane.normal, d), there = -glm::dot(lamp.normal, d);
    if (here > 0 && there > 0 && !(lamp.mirrors.empty() && close(lane.point, q, lamp.facet))) {
      toLamps.light[k] = lane.weight * lamp.emission * (lamp.area * here * there / (kPi * squared * squared * chance));
      toLamps.rays.set(k, from, q + kRayOffset * lamp.normal - from);
      toLamps.ways[k] = lamp.mirrors;
    }
  }
  lightPunctual(lane, k, toPunctual);
}

void PathGatherer::lightPunctual(Lane& lane, uint32_t k, ShadowRays& toPunctual) const {
  if (lights_.empty()) return;
  const Vec3 from = lane.point + lane.offset * lane.normal;
  const size_t count = lights_.size();
  const PunctualLight& l = lights_[std::min(static_cast<size_t>(lane.next() * static_cast<double>(count)), count - 1)];
  const Rgb arrives = unoccludedIrradiance(l, facets_.frame.toScene(lane.point), lane.normal);
  if (maxChannel(arrives) <= 0) return;
  toPunctual.light[k] = lane.weight * arrives * static_cast<double>(count);
  toPunctual.rays.set(k, from, wayTo(l, from, facets_.frame));
  toPunctual.ways[k] = l.mirrors;
}

void PathGatherer::meet(const HitPacket& hits, const RayPacket& rays, uint32_t k, Lane& lane) const {
  Rgb& sum = lane.path->irradiance;
  const uint32_t facet = hits.facet[k];
  const auto end = [&] { lane.path = nullptr; };
  if (facet == kNone) {
    if (!lane.last) sum += lane.weight * sky_;
    return end();
  }
  const bool back = hitPatches_.seenFromBehind(facet, rays, k);
  const uint32_t patch = hitPatches_.at(facet, back, hits.u[k], hits.v[k]);
  if (patch == kNone) return end();
  PathHit next{facet, patch, back, hits.u[k], hits.v[k], Rgb(1)};
  const double u = static_cast<double>(next.u), v = static_cast<double>(next.v);
  const Optics optics = opticsAt(facet, u, v);
  const bool apart = plan_.apart[patch] != 0;
  if (apart ? close(lane.point, tree_.pointOn(facet, u, v), facet) : !lane.last) sum += lane.weight * optics.emission;
  if (lane.last) return end();
  Rgb factor = optics.diffuse;
  if (tree_.specular(patch)) {
    Met met;
    met.hits.push_back(next);
    PathEnds ends;
    const SpecularHit hit{tree_.pointOn(facet, u, v), lane.direction, Rgb(1), facet, patch, back, kNone, 0};
    tree_.follow(std::span(&hit, 1), met, ends);
    sum += lane.weight * ends.missed * sky_;
    // Everything met shines; the path goes on from one of them, chosen by what it would reflect.
    std::vector<Rgb> factors;
    double total = 0;
    for (const PathHit& h : met.hits) {
      const Optics o = opticsAt(h.facet, static_cast<double>(h.u), static_cast<double>(h.v));
      // By its image, or followed from the lamp.
      const bool elsewhere = plan_.apart[h.patch] != 0 && (imagesOfLamps_ || (leaveOutFollowed_ && lane.depth == 0));
      if (&h != &met.hits[0] && !elsewhere) sum += lane.weight * h.weight * o.emission;
      factors.push_back(h.weight * o.diffuse);
      total += maxChannel(factors.back());
    }
    if (total <= 0) return end();
    double choice = lane.next() * total;
    size_t which = 0;
    while (which + 1 < factors.size() && choice >= maxChannel(factors[which])) choice -= maxChannel(factors[which++]);
    if (maxChannel(factors[which]) <= 0) return end();
    next = met.hits[which];
    factor = factors[which] * (total / maxChannel(factors[which]));
  }
  lane.weight *= factor;
  if (knownPatches_) {
    const uint32_t known = knownPatches_->at(next.facet, next.back, next.u, next.v);
    if (known != kNone) sum += lane.weight * known_[known];
    lane.last = true;  // and one more ray where a lamp may be close
  }
  if (maxChannel(lane.weight) <= 0) return end();
  constexpr uint32_t kSure = 2;
  if (++lane.depth > kSure) {
    const double survival = std::min(1.0, maxChannel(lane.weight));
    if (lane.next() >= survival) return end();
    lane.weight /= survival;
  }
  const Facet& f = facets_.facets[next.facet];
  lane.offset = f.rayOffset;
  lane.normal = next.back ? -f.normal : f.normal;
  lane.point = tree_.pointOn(next.facet, static_cast<double>(next.u), static_cast<double>(next.v));
  const double a = lane.next(), b = lane.next();
  lane.setDirection(a, b);
}

void PathGatherer::gather(std::span<GatherPath> paths) const {
  std::array<Lane, kPacketSize> lanes;
  size_t started = 0;
  RayPacket rays;
  HitPacket hits;
  ShadowRays toLamps, toPunctual;
  const auto addLight = [&](ShadowRays& shadow, uint32_t count) {
    const uint32_t all = firstRays(count), blocked = mirrors_ ? all & ~mirrors_->connected(tracer_, shadow.rays, all, shadow.ways)
                                                              : tracer_.occluded(shadow.rays, all);
    for (uint32_t k = 0; k < count; ++k) {
      if (lanes[k].path != nullptr && (blocked >> k & 1) == 0) lanes[k].path->irradiance += shadow.light[k];
    }
  };
  for (;;) {
    uint32_t busy = 0;  // lanes up to the last busy one
    for (uint32_t k = 0; k < kPacketSize; ++k) {
      if (lanes[k].path == nullptr && started < paths.size()) start(paths[started++], lanes[k]);
      if (lanes[k].path != nullptr) {
        busy = k + 1;
        light(lanes[k], k, toLamps, toPunctual);
        rays.set(k, lanes[k].point + lanes[k].offset * lanes[k].normal, lanes[k].direction);
      } else {
        toLamps.clear(k);
        toPunctual.clear(k);
        rays.set(k, Vec3(0), Vec3(0, 0, 1));
      }
    }
    if (busy == 0) return;
    if (!lamps_.empty()) addLight(toLamps, busy);
    if (!lights_.empty()) addLight(toPunctual, busy);
    for (uint32_t k = 0; k < busy; ++k) {
      if (lanes[k].last && !closeToLamps(lanes[k].point)) lanes[k].path = nullptr;
    }
    tracer_.intersect(rays, busy, hits);
    for (uint32_t k = 0; k < busy; ++k) {
      if (lanes[k].path != nullptr) meet(hits, rays, k, lanes[k]);
    }
  }
}

}  // namespace farol
