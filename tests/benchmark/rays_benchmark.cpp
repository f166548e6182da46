// Rows per second by rays on the Cornell box, beside a bare loop that traces the same rays, made beforehand, and throws
// the hits away.
#include "formfactor/rays.h"

#include <benchmark/benchmark.h>
#include <tbb/parallel_for.h>

namespace {

using namespace farol;

class NoStore : public RowStore {
 public:
  std::span<float> row(uint32_t /*patch*/) override { return {}; }
  void hits(uint32_t /*patch*/, std::span<const uint32_t> ids, float /*weight*/) override { benchmark::DoNotOptimize(ids.data()); }
  void finish(uint32_t /*patch*/, const RowShares& /*shares*/) override {}
};

struct Cornell {
  Log log{true};
  Scene scene = loadScene(FAROL_SCENES "/cornell_box/cornell_box.gltf", log);
  FacetSet facets = buildFacets(scene, log);
  PatchSet patches = buildPatches(scene, facets, {4000, 0});
  Tracer tracer{facets};

  // Patches spread over the scene, whole tiles of 16 neighbours.
  std::vector<uint32_t> wanted(size_t rays) const {
    const size_t rows = std::min<size_t>(patches.size(), std::max<size_t>(256, (size_t{1} << 21) / rays));
    std::vector<uint32_t> chosen;
    for (size_t k = 0; k < rows / 16; ++k) {
      for (uint32_t l = 0; l < 16; ++l) chosen.push_back(static_cast<uint32_t>(k * (patches.size() - 16) / (rows / 16)) + l);
    }
    chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
    return chosen;
  }
};

void count(benchmark::State& state, size_t rows) {
  const auto rays = static_cast<double>(state.range(0));
  state.counters["rows/s"] = benchmark::Counter(static_cast<double>(rows), benchmark::Counter::kIsIterationInvariantRate);
  state.counters["rays/s"] = benchmark::Counter(static_cast<double>(rows) * rays, benchmark::Counter::kIsIterationInvariantRate);
}

void rowsByRays(benchmark::State& state) {
  static const Cornell box;
  const auto k = static_cast<uint32_t>(state.range(0));
  const std::vector<uint32_t> wanted = box.wanted(k);
  RayRowMaker maker(box.tracer, box.facets, box.patches, {.rays = k});
  NoStore store;
  for (auto _ : state) maker.makeRows(wanted, store, [](size_t) {});
  count(state, wanted.size());
  state.SetLabel(box.tracer.description());
}

void bareLoop(benchmark::State& state) {
  static const Cornell box;
  const auto k = static_cast<uint32_t>(state.range(0));
  const std::vector<uint32_t> wanted = box.wanted(k);
  const RayOptions options{.rays = k};
  const SampleTable table(k, options.seed);
  std::vector<RayPacket> packets;
  for (const uint32_t& patch : wanted) {
    TileRays rays(box.facets, box.patches, table, options.spread, options.seed, std::span(&patch, 1));
    std::array<uint32_t, kPacketSize> member{};
    RayPacket packet;
    while (rays.next(packet, member) > 0) packets.push_back(packet);
  }
  for (auto _ : state) {
    tbb::parallel_for(size_t{0}, packets.size(), [&](size_t p) {
      HitPacket hits;
      box.tracer.intersect(packets[p], kPacketSize, hits);
      benchmark::DoNotOptimize(hits);
    });
  }
  count(state, wanted.size());
}

BENCHMARK(rowsByRays)->ArgName("K")->Arg(256)->Arg(1024)->Arg(4096)->Arg(16384)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(bareLoop)->ArgName("K")->Arg(256)->Arg(1024)->Arg(4096)->Arg(16384)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
