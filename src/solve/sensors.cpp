#include "solve/sensors.h"

#include "formfactor/tile_rays.h"

#include <tbb/parallel_for.h>

namespace farol {

namespace {

// The radiosity that paths over mirrors and glass bring.
struct Gathered : PathSink {
  explicit Gathered(const std::vector<Rgb>& b) : radiosity(b) {}
  void met(const PathHit& hit) override { sum += hit.weight * radiosity[hit.patch]; }
  const std::vector<Rgb>& radiosity;
  Rgb sum{0};
};

}  // namespace

std::vector<SensorReading> readSensors(const RayTree& tree, const Tracer& tracer, const FacetSet& facets, const PatchSet& patches,
                                       const DirectIrradiance& lamps, const DirectLight& direct, const Solution& solution,
                                       std::span<const Sensor> sensors, const SensorOptions& options) {
  std::vector<Rgb> carried = solution.radiosity;
  for (size_t j = 0; j < carried.size(); ++j) {
    if (direct.isApart(j)) carried[j] -= patches.patches[j].emission;
  }
  const HitPatches hitPatches(facets, patches);
  const uint32_t perBlock = std::max(1u, options.rays / SampleTable::kBlocks);
  const SampleTable table(perBlock, options.seed);
  std::vector<SensorReading> readings(sensors.size());
  tbb::parallel_for(size_t{0}, sensors.size(), [&](size_t s) {
    const Vec3 n = sensors[s].normal, point = facets.frame.toUnit(sensors[s].position);
    const uint64_t seed = mixBits(options.seed * 0x100000001B3ull + s);
    const double turn = 2 * kPi * unitFromBits(seed);
    const Vec3 a = anyPerpendicular(n), b = glm::cross(n, a), origin = point + kRayOffset * n;
    const Vec3 t = std::cos(turn) * a + std::sin(turn) * b, u = std::cos(turn) * b - std::sin(turn) * a;
    std::vector<Rgb> block(SampleTable::kBlocks, Rgb(0));
    RayPacket packet;
    HitPacket hits;
    std::vector<SpecularHit> specular;
    for (uint32_t k = 0; k < SampleTable::kBlocks; ++k) {
      for (uint32_t first = 0; first < perBlock; first += kPacketSize) {
        const uint32_t lanes = std::min(kPacketSize, perBlock - first);
        for (uint32_t l = 0; l < lanes; ++l) {
          const size_t at = size_t{k} * perBlock + first + l;
          const Vec3 d = static_cast<double>(table.apart.dx[at]) * t + static_cast<double>(table.apart.dy[at]) * u +
                         static_cast<double>(table.apart.dz[at]) * n;
          packet.set(l, origin, d);
        }
        tracer.intersect(packet, lanes, hits);
        for (uint32_t l = 0; l < lanes; ++l) {
          if (hits.facet[l] == kNone) {
            block[k] += options.sky;
            continue;
          }
          const bool back = hitPatches.seenFromBehind(hits.facet[l], packet, l);
          const uint32_t patch = hitPatches.at(hits.facet[l], back, hits.u[l], hits.v[l]);
          if (patch == kNone) continue;
          block[k] += carried[patch];
          if (!tree.specular(patch)) continue;
          const uint32_t facet = hits.facet[l];
          specular.push_back({tree.pointOn(facet, static_cast<double>(hits.u[l]), static_cast<double>(hits.v[l])),
                              glm::normalize(Vec3(packet.dx[l], packet.dy[l], packet.dz[l])), Rgb(1), facet, patch, back, kNone,
                              0});
        }
      }
      if (!specular.empty()) {
        Gathered gathered(solution.radiosity);
        PathEnds ends;
        tree.follow(specular, gathered, ends);
        block[k] += gathered.sum + ends.missed * options.sky;
        specular.clear();
      }
      block[k] /= perBlock;
    }
    Rgb mean(0), squares(0);
    for (const Rgb& value : block) mean += value / double{SampleTable::kBlocks};
    for (const Rgb& value : block) squares += (value - mean) * (value - mean);
    const Rgb variance = squares / double{SampleTable::kBlocks * (SampleTable::kBlocks - 1)};
    const DirectIrradiance::Estimate straight = lamps.at(point, n, options.shadowRays, seed);
    readings[s].irradiance = mean + straight.irradiance;
    readings[s].error = std::sqrt(maxChannel(variance + straight.deviation * straight.deviation));
  });
  return readings;
}

}  // namespace farol
