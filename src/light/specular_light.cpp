#include "light/specular_light.h"

#include "base/sobol.h"
#include "formfactor/error_model.h"

#include <algorithm>
#include <bit>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr size_t kRounds = 4;            // their differences tell the error of all
constexpr size_t kRaysPerTask = 1u << 10, kTasksAtOnce = 64;  // what arrives waits to be added up: 100 MB where rays meet fifty mirrors

// Where rays start, and with what power.
struct Origin {
  Piece piece;
  Rgb colour;       // of the power, 1 in its largest channel
  double powerTo;   // sum of the powers up to this one, of the largest channel each
  uint32_t medium;  // that the rays start in
  double offset;
};

// All that shines, and where the rays of a sequence in four dimensions start on it.
class Origins {
 public:
  Origins(const FacetSet& facets, const PatchSet& patches, const RayTree& tree, std::span<const uint8_t> apart, uint64_t seed) {
    for (uint32_t i = 0; i < patches.size(); ++i) {
      const Rgb& emission = patches.patches[i].emission;
      if (apart[i] == 0 || maxChannel(emission) <= 0) continue;
      for (const Piece& piece : piecesOf(facets, patches, i)) {
        power_ += piece.area * maxChannel(emission);
        all_.push_back({piece, emission / maxChannel(emission), power_, tree.mediumBehind(i), facets.facets[piece.facet].rayOffset});
      }
    }
    for (size_t d = 0; d < shift_.size(); ++d) shift_[d] = static_cast<uint32_t>(mixBits(mixBits(seed) + d));
  }
  double power() const { return power_; }  // in the largest channel of each

  // Ray `number` into a lane of a packet: by power, evenly over the area, by the cosine.
  const Origin& start(size_t number, RayPacket& packet, uint32_t lane) const {
    const auto x = sobolPoint(static_cast<uint32_t>(number));
    std::array<double, 4> u;
    for (size_t d = 0; d < u.size(); ++d) u[d] = (x[d] ^ shift_[d]) * 0x1p-32 + 0x1p-33;
    // The first number chooses the piece and is spread over [0,1) again.
    const auto at = std::upper_bound(all_.begin(), all_.end() - 1, u[0] * power_, [](double p, const Origin& o) { return p < o.powerTo; });
    const double before = at == all_.begin() ? 0 : (at - 1)->powerTo;
    u[0] = std::clamp((u[0] * power_ - before) / (at->powerTo - before), 0.0, 1.0);
    if (at->piece.triangle && u[0] + u[1] > 1) {
      u[0] = 1 - u[0];
      u[1] = 1 - u[1];
    }
    const Vec3& n = at->piece.normal;
    const Vec3 s = anyPerpendicular(n), t = glm::cross(n, s);
    const double r = std::sqrt(u[2]), angle = 2 * kPi * u[3];
    packet.set(lane, at->piece.at(u[0], u[1]) + at->offset * n, r * std::cos(angle) * s + r * std::sin(angle) * t + std::sqrt(1 - u[2]) * n);
    return *at;
  }

 private:
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
                                 std::span<const uint8_t> apart, std::span<const double> exposed, size_t rays, uint64_t seed,
                                 const std::function<void(double)>& done) {
  const Origins origins(facets, patches, tree, apart, seed);
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
    std::array<const Origin*, kPacketSize> from{};
    for (size_t k = first; k < first + count; k += kPacketSize) {
      const auto lanes = static_cast<uint32_t>(std::min<size_t>(kPacketSize, first + count - k));
      for (uint32_t l = 0; l < lanes; ++l) from[l] = &origins.start(k + l, packet, l);
      tracer.intersect(packet, lanes, hits);
      for (uint32_t l = 0; l < lanes; ++l) {
        const uint32_t facet = hits.facet[l];
        if (facet == kNone) continue;
        const bool back = hitPatches.seenFromBehind(facet, packet, l);
        const uint32_t patch = hitPatches.at(facet, back, hits.u[l], hits.v[l]);
        if (patch == kNone || !tree.specular(patch)) continue;
        const Vec3 point = tree.pointOn(facet, static_cast<double>(hits.u[l]), static_cast<double>(hits.v[l]));
        const Rgb weight = from[l]->colour * tree.passed(from[l]->medium, glm::distance(point, Vec3(packet.ox[l], packet.oy[l], packet.oz[l])));
        specular.push_back({point, glm::normalize(Vec3(packet.dx[l], packet.dy[l], packet.dz[l])), weight, facet, patch, back, from[l]->medium, 0});
      }
    }
    tree.follow(specular, met, ends);
    arrivals = std::move(met.all);
  };

  std::vector<Rgb> squares(patches.size(), Rgb(0));
  for (size_t round = 0; round < kRounds; ++round) {
    std::vector<Rgb> sums(patches.size(), Rgb(0));
    for (size_t first = 0; first < perRound; first += kTasksAtOnce * kRaysPerTask) {
      const size_t end = std::min(perRound, first + kTasksAtOnce * kRaysPerTask), tasks = (end - first + kRaysPerTask - 1) / kRaysPerTask;
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
    const Rgb spread = glm::max(Rgb(0), squares[i] - double{kRounds} * light.irradiance[i] * light.irradiance[i]) / double{kRounds - 1};
    light.deviation[i] = glm::sqrt(spread) * std::pow(double{kRounds}, -kSampleOrder);
  }
  return light;
}

}  // namespace farol
