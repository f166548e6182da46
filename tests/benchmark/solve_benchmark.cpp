// Sweeps of the solve in bytes of F per second, beside the machine's own read bandwidth over the same bytes; and how many
// of them scenes take in which light fades slowly.
#include "base/machine.h"
#include "factor_run.h"
#include "gpu/gpu.h"
#include "solve/gpu_jacobi.h"
#include "solve/solver.h"

#include <benchmark/benchmark.h>
#include <map>
#include <tbb/parallel_for.h>

namespace {

using namespace farol;

// A dense F of n patches that sums to 1, with rho 0.5: only its size matters.
struct GivenSystem {
  explicit GivenSystem(size_t n) : f(n) {
    scene.path = "given";
    patches.patches.resize(n);
    for (uint32_t i = 0; i < n; ++i) {
      const auto row = f.row(i);
      for (size_t j = 0; j < n; ++j) row[j] = static_cast<float>((0.5 + unitFromBits(mixBits(i * n + j))) / static_cast<double>(n));
      f.finish(i, {});
      Patch& p = patches.patches[i];
      p.area = 1;
      p.reflectance = Rgb(0.5, 0.4, 0.3);
      p.emission = Rgb(i % 100 == 0 ? 1 : 0);
    }
  }
  // Of a solve to the usual residual: the seconds that `sweeps` sweeps after the first take, fewer than it needs.
  double seconds(SolverKind kind, size_t sweeps) const {
    SolveOptions o;
    o.kind = kind;
    const auto run = [&](size_t most) {
      o.maxSweeps = most;
      const Stopwatch watch;
      const Solution solution = solveRadiosity(f, patches, {}, scene, o, Log(true));
      if (solution.sweeps != most) throw std::logic_error("fewer sweeps than are measured");
      return watch.seconds();
    };
    const double one = run(1);
    return run(1 + sweeps) - one;
  }
  Scene scene;
  PatchSet patches;
  FormFactorMatrix f;
};

const GivenSystem& systemOf(size_t n) {
  static std::map<size_t, GivenSystem> systems;
  return systems.try_emplace(n, n).first->second;
}

void sweep(benchmark::State& state, SolverKind kind) {
  const auto n = static_cast<size_t>(state.range(0));
  const GivenSystem& system = systemOf(n);
  constexpr size_t kSweeps = 5;
  const size_t repeats = std::max<size_t>(1, 80000000 / (n * n));
  for (auto _ : state) {
    double seconds = 0;
    for (size_t r = 0; r < repeats; ++r) seconds += system.seconds(kind, kSweeps);
    state.SetIterationTime(seconds / static_cast<double>(repeats * kSweeps));
  }
  state.SetBytesProcessed(state.iterations() * static_cast<int64_t>(4 * n * n));
}

#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
__attribute__((target_clones("default", "avx2", "avx512f")))
#endif
float sumOf(const float* values, size_t n) {
  float partial[64] = {};
  for (size_t k = 0; k + 64 <= n; k += 64) {
    for (size_t l = 0; l < 64; ++l) partial[l] += values[k + l];
  }
  float sum = 0;
  for (const float p : partial) sum += p;
  return sum;
}

void read(benchmark::State& state) {
  const auto n = static_cast<size_t>(state.range(0));
  const GivenSystem& system = systemOf(n);
  const size_t repeats = std::max<size_t>(4, 400000000 / (n * n));
  for (auto _ : state) {
    const Stopwatch watch;
    for (size_t r = 0; r < repeats; ++r) {
      tbb::parallel_for(size_t{0}, n, [&](size_t i) { benchmark::DoNotOptimize(sumOf(system.f[i].dense.data(), n)); });
    }
    state.SetIterationTime(watch.seconds() / static_cast<double>(repeats));
  }
  state.SetBytesProcessed(state.iterations() * static_cast<int64_t>(4 * n * n));
}

// On the device that a run would take; FAROL_DEVICE names another.
void jacobiOnDevice(benchmark::State& state) {
  const auto n = static_cast<size_t>(state.range(0));
  const GivenSystem& system = systemOf(n);
  const char* wanted = std::getenv("FAROL_DEVICE");
  const gpu::Device device(wanted != nullptr ? wanted : "");
  const System equations(system.f, system.patches, {}, Rgb(0));
  GpuJacobi jacobi(device, system.f, equations.reflecting, equations.reflectance);
  const Channels r = equations.start();
  jacobi.reflections(r, 0, 3);  // shaders are compiled by now
  const size_t sweeps = std::max<size_t>(4, 400000000 / (n * n));
  for (auto _ : state) {
    const Stopwatch watch;
    jacobi.sweep(static_cast<uint32_t>(sweeps));
    state.SetIterationTime(watch.seconds() / static_cast<double>(sweeps));
  }
  state.SetBytesProcessed(state.iterations() * static_cast<int64_t>(4 * n * n));
  state.SetLabel(device.info().name);
}

// A closed box of white walls whose end shines: 1 x 1 x 20, the corridor of truth B7, or a cube. Rows by rays.
struct SlowScene {
  SlowScene(double length, double rho)
      : run(test::loadSurfaces([&] {
              auto box = test::closedBox({1, 1, length}, Rgb(rho));
              box[4].emission = Rgb(1);
              return box;
            }()),
            {1500, 0}, [] {
              RayOptions o;
              o.rays = 1024;
              return o;
            }()) {
    run.makeAll();
  }
  test::RayRun run;
};

void slowly(benchmark::State& state, SolverKind kind) {
  static std::map<std::pair<int64_t, int64_t>, SlowScene> scenes;
  const auto length = state.range(0), rho = state.range(1);
  const auto& run =
      scenes.try_emplace({length, rho}, static_cast<double>(length), 1e-3 * static_cast<double>(rho)).first->second.run;
  SolveOptions o;
  o.kind = kind;
  Solution s;
  for (auto _ : state) s = solveRadiosity(run.f, run.patches, {}, run.scene, o, Log(true));
  state.counters["sweeps"] = static_cast<double>(s.sweeps);
  state.counters["error"] = s.error;
  state.counters["radius"] = s.contraction;
}
void slowScenes(benchmark::internal::Benchmark* b) {
  b->ArgNames({"length", "rho_1000"})
      ->Args({20, 500})
      ->Args({20, 950})
      ->Args({20, 990})
      ->Args({1, 990})
      ->Args({1, 999})
      ->Unit(benchmark::kMillisecond);
}
BENCHMARK_CAPTURE(slowly, jacobi, SolverKind::jacobi)->Apply(slowScenes);
BENCHMARK_CAPTURE(slowly, gauss_seidel, SolverKind::gaussSeidel)->Apply(slowScenes);
BENCHMARK_CAPTURE(slowly, conjugate_residuals, SolverKind::conjugateResiduals)->Apply(slowScenes);

void sizes(benchmark::internal::Benchmark* b) {
  b->ArgName("N")->Arg(4000)->Arg(16000)->UseManualTime()->Iterations(3)->Unit(benchmark::kMillisecond);
}
BENCHMARK(read)->Apply(sizes);
BENCHMARK_CAPTURE(sweep, jacobi, SolverKind::jacobi)->Apply(sizes);
BENCHMARK_CAPTURE(sweep, gauss_seidel, SolverKind::gaussSeidel)->Apply(sizes);
BENCHMARK(jacobiOnDevice)->Apply(sizes);

}  // namespace
