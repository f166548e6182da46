#include "light/specular_light.h"

#include "base/sobol.h"
#include "formfactor/error_model.h"
#include "light/direct.h"

#include <algorithm>
#include <bit>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr size_t kRounds = 4;  // their differences tell the error of all
constexpr size_t kRaysPerTask = 1u << 10,
                 kTasksAtOnce = 64;  // what arrives waits to be added up: 100 MB where rays meet fifty mirrors

// Where rays start, and with what power.
struct Origin {
  Piece piece;                           // of a lamp, or
  const PunctualLight* light = nullptr;  // a punctual light
  Rgb colour{1};                         // of the power, 1 in its largest channel
  double powerTo = 0;                    // sum of the powers up to this one, of the largest channel each
  uint32_t medium = kNone;               // that the rays start in
  double offset = 0;
};

struct Start {
  Rgb weight;  // of a ray, in shares of its power
  uint32_t medium;
  const PunctualLight* light;
};

// All that shines, and where the rays of a sequence in four dimensions start on it.
class Origins {
 public:
  Origins(const FacetSet& facets, const PatchSet& patches, const RayTree& tree, std::span<const uint8_t> apart,
          std::span<const PunctualLight> lights, uint64_t seed)
      : frame_(facets.frame) {
    const auto add = [&](Origin origin, const Rgb& power) {
      if (maxChannel(power) <= 0) return;
      origin.colour = power / maxChannel(power);
      origin.powerTo = power_ += maxChannel(power);
      all_.push_back(origin);
    };
    for (uint32_t i = 0; i < patches.size(); ++i) {
      if (apart[i] == 0) continue;
      for (const Piece& piece : piecesOf(facets, patches, i))
        add({.piece = piece, .medium = tree.mediumBehind(i), .offset = facets.facets[piece.facet].rayOffset},
            piece.area * patches.patches[i].emission);
    }
    for (const PunctualLight& light : lights) add({.piece = {}, .light = &light}, spread(light) * light.intensity);
    for (size_t d = 0; d < shift_.size(); ++d) shift_[d] = static_cast<uint32_t>(mixBits(mixBits(seed) + d));
  }
  double power() const { return power_; }  // in the largest channel of each

  // Ray `number` into a lane of a packet: by power.
  Start start(size_t number, RayPacket& packet, uint32_t lane) const {
    const auto x = sobolPoint(static_cast<uint32_t>(number));
    std::array<double, 4> u;
    for (size_t d = 0; d < u.size(); ++d) u[d] = (x[d] ^ shift_[d]) * 0x1p-32 + 0x1p-33;
    // The first number chooses the origin and is spread over [0,1) again.
    const auto at =
        std::upper_bound(all_.begin(), all_.end() - 1, u[0] * power_, [](double p, const Origin& o) { return p < o.powerTo; });
    const double before = at == all_.begin() ? 0 : (at - 1)->powerTo;
    u[0] = std::clamp((u[0] * power_ - before) / (at->powerTo - before), 0.0, 1.0);
    return at->light != nullptr ? fromLight(*at, u, packet, lane) : fromPiece(*at, u, packet, lane);
  }

 private:
  static constexpr double kRadius = 0.5 + 1e-6;  // of any scene [unit coordinates]

  // What times its intensity is a light's power: the solid angle of its cone, or the area of a disc that covers the scene [scene
  // units squared].
  double spread(const PunctualLight& light) const {
    if (light.kind == PunctualLight::Kind::directional) return kPi * std::pow(kRadius * frame_.size, 2);
    return 2 * kPi * (1 - lowestCosine(light));
  }
  static double lowestCosine(const PunctualLight& light) {
    return light.kind == PunctualLight::Kind::spot ? std::cos(light.outerCone) : -1;
  }

  // Evenly over the area, by the cosine.
  static Start fromPiece(const Origin& o, std::array<double, 4> u, RayPacket& packet, uint32_t lane) {
    if (o.piece.triangle && u[0] + u[1] > 1) {
      u[0] = 1 - u[0];
      u[1] = 1 - u[1];
    }
    const Vec3& n = o.piece.normal;
    const Vec3 s = anyPerpendicular(n), t = glm::cross(n, s);
    const double r = std::sqrt(u[2]), angle = 2 * kPi * u[3];
    packet.set(lane, o.piece.at(u[0], u[1]) + o.offset * n,
               r * std::cos(angle) * s + r * std::sin(angle) * t + std::sqrt(1 - u[2]) * n);
    return {o.colour, o.medium, nullptr};
  }

  // Evenly over the cone; or over the disc, in parallel.
  Start fromLight(const Origin& o, const std::array<double, 4>& u, RayPacket& packet, uint32_t lane) const {
    const PunctualLight& light = *o.light;
    const Vec3 s = anyPerpendicular(light.direction), t = glm::cross(light.direction, s);
    const double angle = 2 * kPi * u[3];
    const Vec3 around = std::cos(angle) * s + std::sin(angle) * t;
    if (light.kind == PunctualLight::Kind::directional) {
      packet.set(lane, kRadius * (std::sqrt(u[2]) * around - 2.0 * light.direction), light.direction);
      return {o.colour, kNone, &light};
    }
    const double cosine = 1 - u[2] * (1 - lowestCosine(light)), sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
    packet.set(lane, frame_.toUnit(light.position), cosine * light.direction + sine * around);
    return {o.colour * coneShare(light, cosine), kNone, &light};
  }

  const Frame& frame_;
  std::vector<Origin> all_;
  double power_ = 0;  // [flux]
  std::array<uint32_t, 4> shift_{};
};

struct Arrival {
  uint32_t patch;
  Rgb weight;  // in shares of one ray's power
};

struct Arrivals : PathSink {
  void met(const PathHit& hit) override { all.push_back({hit.patch, hit.weight}); }
  std::vector<Arrival> all;
};

}  // namespace

SpecularLight traceSpecularLight(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const RayTree& tree,
                                 std::span<const uint8_t> apart, std::span<const PunctualLight> lights,
                                 std::span<const double> exposed, size_t rays, uint64_t seed,
                                 const std::function<void(double)>& done) {
  const Origins origins(facets, patches, tree, apart, lights, seed);
  SpecularLight light;
  light.irradiance.assign(patches.size(), Rgb(0));
  light.deviation.assign(patches.size(), Rgb(0));
  if (origins.power() <= 0) return light;
  // Rounds of a power of two, where the sequence is even; no more than its numbers reach.
  const size_t perRound = std::min(std::bit_ceil((rays + kRounds - 1) / kRounds), size_t{1} << 30);
  light.rays = kRounds * perRound;
  const HitPatches hitPatches(facets, patches);

  const auto trace = [&](size_t first, size_t count, std::vector<Arrival>& arrivals) {
    RayPacket packet;
    HitPacket hits;
    Arrivals met;
    PathEnds ends;
    std::vector<SpecularHit> specular;
    std::array<Start, kPacketSize> from{};
    for (size_t k = first; k < first + count; k += kPacketSize) {
      const auto lanes = static_cast<uint32_t>(std::min<size_t>(kPacketSize, first + count - k));
      for (uint32_t l = 0; l < lanes; ++l) from[l] = origins.start(k + l, packet, l);
      tracer.intersect(packet, lanes, hits);
      for (uint32_t l = 0; l < lanes; ++l) {
        const uint32_t facet = hits.facet[l];
        if (facet == kNone) continue;
        const bool back = hitPatches.seenFromBehind(facet, packet, l);
        const uint32_t patch = hitPatches.at(facet, back, hits.u[l], hits.v[l]);
        if (patch == kNone || !tree.specular(patch)) continue;
        const Vec3 point = tree.pointOn(facet, static_cast<double>(hits.u[l]), static_cast<double>(hits.v[l]));
        const Start& start = from[l];
        const double distance = glm::distance(point, Vec3(packet.ox[l], packet.oy[l], packet.oz[l]));
        Rgb weight = start.weight * tree.passed(start.medium, distance);
        if (start.light != nullptr) weight *= rangeShare(*start.light, distance * facets.frame.size);
        specular.push_back(
            {point, glm::normalize(Vec3(packet.dx[l], packet.dy[l], packet.dz[l])), weight, facet, patch, back, start.medium, 0});
      }
    }
    tree.follow(specular, met, ends);
    arrivals = std::move(met.all);
  };

  std::vector<Rgb> squares(patches.size(), Rgb(0));
  for (size_t round = 0; round < kRounds; ++round) {
    std::vector<Rgb> sums(patches.size(), Rgb(0));
    for (size_t first = 0; first < perRound; first += kTasksAtOnce * kRaysPerTask) {
      const size_t end = std::min(perRound, first + kTasksAtOnce * kRaysPerTask),
                   tasks = (end - first + kRaysPerTask - 1) / kRaysPerTask;
      std::vector<std::vector<Arrival>> arrivals(tasks);
      tbb::parallel_for(size_t{0}, tasks, [&](size_t task) {
        const size_t begin = first + task * kRaysPerTask;
        trace(round * perRound + begin, std::min(kRaysPerTask, end - begin), arrivals[task]);
      });
      for (const auto& of : arrivals) {
        for (const Arrival& a : of) sums[a.patch] += a.weight;
      }
      done(static_cast<double>(round * perRound + end) / static_cast<double>(light.rays));
    }
    for (size_t i = 0; i < sums.size(); ++i) {
      if (exposed[i] <= 0 || patches.patches[i].passesAll()) continue;
      const Rgb mean = sums[i] * (origins.power() / (static_cast<double>(perRound) * patches.patches[i].area * exposed[i]));
      light.irradiance[i] += mean / double{kRounds};
      squares[i] += mean * mean;
    }
  }
  for (size_t i = 0; i < squares.size(); ++i) {
    const Rgb spread =
        glm::max(Rgb(0), squares[i] - double{kRounds} * light.irradiance[i] * light.irradiance[i]) / double{kRounds - 1};
    light.deviation[i] = glm::sqrt(spread) * std::pow(double{kRounds}, -kSampleOrder);
  }
  return light;
}

}  // namespace farol
