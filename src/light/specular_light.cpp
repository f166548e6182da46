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

std::vector<Origin> originsOn(const FacetSet& facets, const PatchSet& patches, const RayTree& tree, std::span<const uint8_t> apart) {
  std::vector<Origin> origins;
  double sum = 0;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    const Rgb& emission = patches.patches[i].emission;
    if (apart[i] == 0 || maxChannel(emission) <= 0) continue;
    for (const Piece& piece : piecesOf(facets, patches, i)) {
      sum += piece.area * maxChannel(emission);
      origins.push_back({piece, emission / maxChannel(emission), sum, tree.mediumBehind(i), facets.facets[piece.facet].rayOffset});
    }
  }
  return origins;
}

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
  const std::vector<Origin> origins = originsOn(facets, patches, tree, apart);
  SpecularLight light;
  light.irradiance.assign(patches.size(), Rgb(0));
  light.deviation.assign(patches.size(), Rgb(0));
  if (origins.empty()) return light;
  const double power = origins.back().powerTo;
  // Rounds of a power of two, where the sequence is even; no more than its numbers reach.
  const size_t perRound = std::min(std::bit_ceil(std::max<size_t>(1, rays / kRounds)), size_t{1} << 30);
  light.rays = kRounds * perRound;
  const HitPatches hitPatches(facets, patches);
  std::array<uint32_t, 4> shift;
  for (size_t d = 0; d < shift.size(); ++d) shift[d] = static_cast<uint32_t>(mixBits(mixBits(seed) + d));

  const auto trace = [&](size_t first, size_t count, std::vector<Arrival>& arrivals) {
    RayPacket packet;
    HitPacket hits;
    Arrivals met;
    PathEnds ends;
    std::vector<SpecularHit> specular;
    std::array<const Origin*, kPacketSize> from{};
    for (size_t k = first; k < first + count; k += kPacketSize) {
      const auto lanes = static_cast<uint32_t>(std::min<size_t>(kPacketSize, first + count - k));
      for (uint32_t l = 0; l < lanes; ++l) {
        auto x = sobolPoint(static_cast<uint32_t>(k + l));
        std::array<double, 4> u;
        for (size_t d = 0; d < u.size(); ++d) u[d] = (x[d] ^ shift[d]) * 0x1p-32 + 0x1p-33;
        // The first number chooses the piece and is spread over [0,1) again.
        const auto at = std::upper_bound(origins.begin(), origins.end() - 1, u[0] * power, [](double p, const Origin& o) { return p < o.powerTo; });
        const double before = at == origins.begin() ? 0 : (at - 1)->powerTo;
        u[0] = std::clamp((u[0] * power - before) / (at->powerTo - before), 0.0, 1.0);
        if (at->piece.triangle && u[0] + u[1] > 1) {
          u[0] = 1 - u[0];
          u[1] = 1 - u[1];
        }
        from[l] = &*at;
        const Vec3& n = at->piece.normal;
        const Vec3 s = anyPerpendicular(n), t = glm::cross(n, s);
        const double r = std::sqrt(u[2]), angle = 2 * kPi * u[3];
        packet.set(l, at->piece.at(u[0], u[1]) + at->offset * n, r * std::cos(angle) * s + r * std::sin(angle) * t + std::sqrt(1 - u[2]) * n);
      }
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
      const Rgb mean = sums[i] * (power / (static_cast<double>(perRound) * patches.patches[i].area * exposed[i]));
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
