#include "light/direct.h"

#include "base/sobol.h"
#include "formfactor/analytic.h"
#include "formfactor/rays.h"
#include "patch/positions.h"
#include "trace/cover.h"

#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr uint32_t kPenumbraFactor = 4;  // rays where neighbours see a lamp partly, relative to elsewhere
constexpr double kFewestRays = 4;        // a source that deserves fewer shares them with the others of its kind

}  // namespace

// Where light is gathered: a patch or a point.
struct DirectIrradiance::Receiver {
  Vec3 normal{0}, centre{0};
  double radius = 0, offset = kRayOffset;
  std::vector<Position> points;  // for closed forms
  uint32_t patch = kNone;
  std::vector<Piece> pieces;  // of the patch: origins are spread over them by area; none: all at the centre
  bool bent = false;          // pieces have normals of their own
  bool partlyCovered = false;
  uint32_t block = 0;
  uint64_t seed = 0;
};

Rgb unoccludedIrradiance(const PunctualLight& light, const Vec3& point, const Vec3& normal) {
  if (light.kind == PunctualLight::Kind::directional)
    return light.intensity * std::max(0.0, -glm::dot(normal, light.direction));
  const Vec3 to = light.position - point;
  const double squared = glm::dot(to, to), distance = std::sqrt(squared);
  const double cosine = distance > 0 ? glm::dot(normal, to) / distance : 0;
  if (cosine <= 0) return Rgb(0);
  double factor = cosine / squared;
  if (light.range > 0) {
    const double q = squared / (light.range * light.range);
    factor *= std::clamp(1 - q * q, 0.0, 1.0);
  }
  if (light.kind == PunctualLight::Kind::spot) {
    const double cone = -glm::dot(light.direction, to) / distance;
    const double outer = std::cos(light.outerCone), inner = std::cos(light.innerCone);
    const double t = std::clamp((cone - outer) / std::max(inner - outer, 1e-4), 0.0, 1.0);
    factor *= t * t;
  }
  return light.intensity * factor;
}

DirectIrradiance::DirectIrradiance(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches,
                                   std::span<const Lamp> lamps, std::span<const PunctualLight> lights,
                                   const DirectOptions& options)
    : tracer_(tracer), facets_(facets), patches_(patches), lamps_(lamps), lights_(lights), options_(options) {
  const uint32_t count = SampleTable::kBlocks * kPenumbraFactor * options.shadowRays;
  for (uint32_t k = 0; k < count; ++k) points_.push_back(sobolPoint(k));
}

DirectIrradiance::Receiver DirectIrradiance::receiverOf(uint32_t patch, double exposed) const {
  const Patch& p = patches_.patches[patch];
  Receiver r;
  r.patch = patch;
  r.normal = p.normal;
  r.offset = facets_.facets[patches_.cells[patches_.cellsOf(patch)[0]].facet].rayOffset;
  r.centre = facets_.frame.toUnit(p.centre);
  r.radius = std::sqrt(p.area) / facets_.frame.size;
  const TileSeat seat = seatOf(facets_, patches_, patch, options_.seed);
  r.block = seat.block;
  r.seed = mixBits(static_cast<uint64_t>(seat.turn * 1e15));
  r.partlyCovered = exposed < 1;
  r.pieces = piecesOf(facets_, patches_, patch);
  r.bent = std::any_of(r.pieces.begin(), r.pieces.end(), [&](const Piece& piece) { return piece.normal != p.normal; });
  r.points = positionsOn(facets_, patches_, patch, r.partlyCovered ? 64 : r.pieces.size() == 1 ? 4 : 16, r.seed);
  if (r.partlyCovered) r.points = exposedPositions(tracer_, facets_, r.points, r.normal);
  return r;
}

DirectIrradiance::Estimate DirectIrradiance::gather(const Receiver& r, uint32_t rays) const {
  struct Source {
    const Lamp* lamp;
    const PunctualLight* light;
    Rgb irradiance;  // unoccluded
    double weight;
    std::array<uint32_t, 4> shift;  // of the sequence
  };
  std::vector<Source> sources;
  double total = 0;
  std::vector<Position> morePoints;  // made when a lamp is near, or when part of the patch is behind it
  const auto pointsFor = [&](const Lamp& lamp) -> const std::vector<Position>& {
    const bool isNear = glm::distance(lamp.centre, r.centre) < lamp.radius + 3 * r.radius;
    const bool cut = std::abs(glm::dot(lamp.normal, r.centre - lamp.centre)) < r.radius;  // by the lamp's plane
    if ((!isNear && !cut) || r.partlyCovered || r.patch == kNone) return r.points;
    if (morePoints.empty())
      morePoints = positionsOn(facets_, patches_, r.patch, r.pieces.size() == 1 ? 36 : 64, r.seed);
    return morePoints;
  };
  const auto add = [&](const Lamp* lamp, const PunctualLight* light, const Rgb& irradiance) {
    const double weight = maxChannel(irradiance);
    const auto number = static_cast<uint32_t>(lamp != nullptr ? lamp - lamps_.data() : light - lights_.data() + (1 << 20));
    if (!(weight > 0)) return;
    Source source{lamp, light, irradiance, weight, {}};
    const uint64_t seed = r.seed ^ mixBits(number);
    for (size_t c = 0; c < 4; ++c) source.shift[c] = static_cast<uint32_t>(mixBits(seed + c));
    sources.push_back(source);
    total += weight;
  };
  for (const Lamp& lamp : lamps_) {
    bool above = r.bent;
    for (const Vec3& v : lamp.polygon) above |= glm::dot(r.normal, v - r.centre) > kRayOffset;
    if (!above || glm::dot(lamp.normal, r.centre - lamp.centre) + 2 * r.radius <= 0) continue;
    double f = 0;
    for (const Position& q : pointsFor(lamp)) f += q.weight * pointToPolygon(q.point, q.normal, lamp.polygon);
    add(&lamp, nullptr, f * lamp.emission);
  }
  for (const PunctualLight& light : lights_) {
    Rgb irradiance(0);
    for (const Position& q : r.points)
      irradiance += q.weight * unoccludedIrradiance(light, facets_.frame.toScene(q.point), q.normal);
    add(nullptr, &light, irradiance);
  }
  Estimate e;
  if (sources.empty()) return e;

  const double margin = std::min(0.01, 2 * kRayOffset / std::max(r.radius, 1e-9));
  double area = 0;
  for (const Piece& piece : r.pieces) area += piece.area;
  struct Origin {
    Vec3 point, normal;
  };
  const auto originOf = [&](double s, double t) -> Origin {
    if (r.pieces.empty()) return {r.centre, r.normal};
    size_t at = 0;
    double before = 0;  // of the area; t also chooses the piece
    while (at + 1 < r.pieces.size() && before + r.pieces[at].area < t * area) before += r.pieces[at++].area;
    const Piece& piece = r.pieces[at];
    t = (t * area - before) / piece.area;
    if (piece.triangle && s + t > 1) {
      s = 1 - s;
      t = 1 - t;
    }
    return {piece.at(std::clamp(s, margin, 1 - margin), std::clamp(t, margin, 1 - margin)), piece.normal};
  };
  const auto pointOn = [](const Lamp& lamp, double a, double b) {
    const std::vector<Vec3>& v = lamp.polygon;
    if (v.size() == 4) return v[0] + a * (v[1] - v[0]) + b * (v[3] - v[0]);
    return a + b > 1 ? v[0] + (1 - a) * (v[1] - v[0]) + (1 - b) * (v[2] - v[0])
                     : v[0] + a * (v[1] - v[0]) + b * (v[2] - v[0]);
  };

  RayPacket packet;
  double kernel[kPacketSize];
  const Source* of[kPacketSize];
  uint32_t lanes = 0;
  struct Sums {
    double k = 0, kv = 0, k2 = 0, k2v = 0;
  };
  struct Pool {
    Rgb k{0}, kv{0};
    double k1 = 0, kv1 = 0, k2 = 0, k2v = 0;
  } pool;
  Sums sums;
  bool pooling = false;
  uint32_t blocked = 0, open = 0;
  const auto flush = [&] {
    if (lanes == 0) return;
    const uint32_t hidden = tracer_.occluded(packet, lanes);
    e.rays += lanes;
    for (uint32_t k = 0; k < lanes; ++k) {
      const bool visible = (hidden >> k & 1) == 0;
      const double w = kernel[k];
      (visible ? open : blocked) += 1;
      if (pooling) {
        const Rgb share = w * of[k]->irradiance / of[k]->weight;
        pool.k += share;
        pool.k1 += w;
        pool.k2 += w * w;
        if (visible) {
          pool.kv += share;
          pool.kv1 += w;
          pool.k2v += w * w;
        }
      } else {
        sums.k += w;
        sums.k2 += w * w;
        if (visible) {
          sums.kv += w;
          sums.k2v += w * w;
        }
      }
    }
    lanes = 0;
  };
  const auto shoot = [&](const Source& source, uint32_t number) {
    double x[4];  // where on the patch, where on the source
    const std::array<uint32_t, 4>& fixed = points_[number % points_.size()];
    for (size_t c = 0; c < 4; ++c) x[c] = (static_cast<uint32_t>(fixed[c] + source.shift[c]) + 0.5) * 0x1p-32;
    const auto [p, normal] = originOf(x[0], x[1]);
    if (r.partlyCovered && insideObject(tracer_, facets_, std::span(&p, 1), r.normal, 0) != 0) return;
    const Vec3 from = p + r.offset * normal;
    Vec3 to;
    double k = 0;
    if (source.lamp != nullptr) {
      const Vec3 q = pointOn(*source.lamp, x[2], x[3]), d = q - p;
      const double squared = glm::dot(d, d);
      k = std::max(0.0, glm::dot(normal, d)) * std::max(0.0, -glm::dot(source.lamp->normal, d)) / (squared * squared);
      k *= source.lamp->area * maxChannel(source.lamp->emission) / (kPi * source.weight);
      to = q + kRayOffset * source.lamp->normal;
    } else {
      k = maxChannel(unoccludedIrradiance(*source.light, facets_.frame.toScene(p), normal)) / source.weight;
      to = source.light->kind == PunctualLight::Kind::directional ? p - 3.0 * source.light->direction
                                                                  : facets_.frame.toUnit(source.light->position);
    }
    if (!(k > 0)) return;
    packet.set(lanes, from, to - from);
    kernel[lanes] = k;
    of[lanes] = &source;
    if (++lanes == kPacketSize) flush();
  };

  double pooledWeight = 0, variance = 0;
  Rgb pooled(0);
  for (const Source& source : sources) {
    const double deserved = rays * source.weight / total;
    if (deserved < kFewestRays && sources.size() > 1) {
      pooledWeight += source.weight;
      pooled += source.irradiance;
      continue;
    }
    const auto count = static_cast<uint32_t>(std::lround(deserved));
    sums = {};
    for (uint32_t k = 0; k < count; ++k) shoot(source, r.block * count + k);
    flush();
    if (sums.k <= 0) continue;
    const double share = sums.kv / sums.k;
    e.irradiance += share * source.irradiance;
    // Variance of a ratio of sums: sum k^2 (V - share)^2 / (sum k)^2.
    const double spread = sums.k2v * (1 - share) * (1 - share) + (sums.k2 - sums.k2v) * share * share;
    variance += source.weight * source.weight * spread / (sums.k * sums.k);
  }
  if (pooledWeight > 0) {
    pooling = true;
    const auto count = static_cast<uint32_t>(std::ceil(std::max(kFewestRays, rays * pooledWeight / total)));
    const double offset = unitFromBits(mixBits(r.seed + r.block));
    size_t at = 0;
    const auto isPooled = [&](const Source& s) { return rays * s.weight / total < kFewestRays; };
    while (!isPooled(sources[at])) ++at;
    double before = 0;
    for (uint32_t k = 0; k < count; ++k) {
      const double place = (k + offset) / count * pooledWeight;
      while (before + sources[at].weight < place) {
        size_t next = at + 1;
        while (next < sources.size() && !isPooled(sources[next])) ++next;
        if (next == sources.size()) break;
        before += sources[at].weight;
        at = next;
      }
      shoot(sources[at], r.block * count + k);
    }
    flush();
    for (int c = 0; c < 3; ++c) {
      if (pool.k[c] > 0) e.irradiance[c] += pooled[c] * pool.kv[c] / pool.k[c];
    }
    if (pool.k1 > 0) {
      const double share = pool.kv1 / pool.k1;
      const double spread = pool.k2v * (1 - share) * (1 - share) + (pool.k2 - pool.k2v) * share * share;
      variance += pooledWeight * pooledWeight * spread / (pool.k1 * pool.k1);
    }
  }
  e.partly = blocked > 0 && open > 0;
  e.deviation = std::sqrt(variance);
  return e;
}

DirectLight DirectIrradiance::compute(const std::vector<double>& exposed, std::span<const uint32_t> chosen) const {
  const auto n = static_cast<uint32_t>(patches_.size());
  DirectLight result;
  result.irradiance.assign(n, Rgb(0));
  result.deviation.assign(n, 0);
  std::vector<uint32_t> all;
  if (chosen.empty()) {
    for (uint32_t i = 0; i < n; ++i) all.push_back(i);
    chosen = all;
  }
  std::vector<Estimate> estimates(n);
  const auto pass = [&](std::span<const uint32_t> wanted, uint32_t rays) {
    tbb::parallel_for(size_t{0}, wanted.size(), [&](size_t k) {
      const uint32_t i = wanted[k];
      if (exposed[i] <= 0) return;
      const uint32_t before = estimates[i].rays;
      estimates[i] = gather(receiverOf(i, exposed[i]), rays);
      estimates[i].rays += before;
    });
  };
  pass(chosen, options_.shadowRays);
  // More rays where neighbours saw a lamp partly. A patch's own rays must not decide that: patches whose first rays
  // happen to agree would keep them, which biases the mean.
  std::vector<uint32_t> penumbra;
  for (const uint32_t i : chosen) {
    const auto cells = patches_.cellsOf(i);
    const Cell& cell = patches_.cells[cells[0]];
    const CellGrid& grid = patches_.grids[cell.facet];
    const bool parallelogram = facets_.facets[cell.facet].parallelogram;
    const uint32_t first = cell.back ? grid.backCell : grid.frontCell, count = grid.count(parallelogram);
    bool partly = false;
    const auto look = [&](int64_t place) {
      if (place < 0 || place >= count) return;
      const uint32_t neighbour = patches_.cellMap[first + static_cast<uint32_t>(place)];
      partly |= neighbour != kNone && neighbour != i && estimates[neighbour].partly;
    };
    const int64_t own = cells[0] - first, width = parallelogram ? grid.nu : 2 * (grid.nu - cell.v) - 1;
    for (const int64_t step : {int64_t{-1}, int64_t{1}, width, -width}) look(own + step);
    if (partly) penumbra.push_back(i);
  }
  pass(penumbra, kPenumbraFactor * options_.shadowRays);
  for (const uint32_t i : chosen) {
    result.irradiance[i] = estimates[i].irradiance;
    result.deviation[i] = estimates[i].deviation;
    result.rays += estimates[i].rays;
  }
  return result;
}

DirectIrradiance::Estimate DirectIrradiance::at(const Vec3& point, const Vec3& normal, uint32_t rays,
                                                uint64_t seed) const {
  Receiver r;
  r.normal = normal;
  r.centre = point;
  r.points = {{point, 1.0, normal}};
  r.block = static_cast<uint32_t>(seed % SampleTable::kBlocks);
  r.seed = mixBits(seed);
  return gather(r, rays);
}

}  // namespace farol
