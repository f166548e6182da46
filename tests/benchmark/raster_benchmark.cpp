// Rows per second of raster form factors on the Cornell box, by resolution and by number of patches on the same
// facets. Rows are made and thrown away, so that the cost of storing F does not hide the cost of a row.
#include "formfactor/raster.h"

#include <benchmark/benchmark.h>

namespace {

using namespace farol;

// Room for the rows of one batch, used again and again.
class Scratch : public RowStore {
 public:
  explicit Scratch(size_t patches) : rows_(256, std::vector<float>(patches)) {}
  std::span<float> row(uint32_t patch) override { return rows_[patch % rows_.size()]; }
  void hits(uint32_t patch, std::span<const uint32_t> ids, float /*weight*/) override {
    rows_[patch % rows_.size()].assign(ids.begin(), ids.end());
  }
  void finish(uint32_t /*patch*/, const RowShares& /*shares*/) override {}

 private:
  std::vector<std::vector<float>> rows_;
};

void rowsPerSecond(benchmark::State& state, Projection projection) {
  Log log(true);
  static const gpu::Device device;
  const Scene scene = loadScene(FAROL_SCENES "/cornell_box/cornell_box.gltf", log);
  const FacetSet facets = buildFacets(scene, log);
  const PatchSet patches = buildPatches(scene, facets, {static_cast<size_t>(state.range(1)), 0});
  RasterOptions options;
  options.resolution = static_cast<uint32_t>(state.range(0));
  options.projection = projection;
  RasterRowMaker maker(device, facets, patches, options);
  Scratch scratch(patches.size());
  // Patches spread over the scene, as many for every N, so that each run makes rows of the same kind.
  constexpr size_t kRows = 1024;
  std::vector<uint32_t> wanted(kRows);
  for (size_t k = 0; k < kRows; ++k) wanted[k] = static_cast<uint32_t>(k * patches.size() / kRows);
  maker.makeRows(wanted, scratch, [](size_t) {});
  for (auto _ : state) maker.makeRows(wanted, scratch, [](size_t) {});
  state.counters["rows/s"] = benchmark::Counter(static_cast<double>(kRows), benchmark::Counter::kIsIterationInvariantRate);
  state.counters["patches"] = static_cast<double>(patches.size());
  state.SetLabel(device.info().name);
}

BENCHMARK_CAPTURE(rowsPerSecond, hemicube, Projection::hemicube)
    ->ArgNames({"R", "N"})
    ->Args({32, 4000})
    ->Args({64, 1000})
    ->Args({64, 4000})
    ->Args({64, 16000})
    ->Args({128, 4000})
    ->Args({256, 4000})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(rowsPerSecond, tetrahedron, Projection::tetrahedron)
    ->ArgNames({"R", "N"})
    ->Args({64, 4000})
    ->Args({128, 4000})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
