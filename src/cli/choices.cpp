#include "cli/choices.h"

#include "base/error.h"
#include "base/machine.h"
#include "formfactor/error_model.h"
#include "formfactor/near_field.h"
#include "solve/solver.h"

namespace farol {
namespace {

std::vector<gpu::DeviceInfo> usableDevices() {
  try {
    std::vector<gpu::DeviceInfo> all = gpu::listDevices();
    std::erase_if(all, [](const gpu::DeviceInfo& d) { return !d.refusal.empty(); });
    return all;
  } catch (const Error&) {  // no Vulkan here: rays and the CPU need none
    return {};
  }
}

// Those that are no CPU in disguise.
std::vector<gpu::DeviceInfo> hardwareDevices() {
  std::vector<gpu::DeviceInfo> all = usableDevices();
  std::erase_if(all, [](const gpu::DeviceInfo& d) { return d.type == "CPU"; });
  return all;
}

double cores(const Options& options) { return static_cast<double>(coresFor(options)); }

}  // namespace

MethodSpec specFrom(const Options& o, MethodSpec::Kind kind) {
  return {kind, o.resolution, o.projection, o.positions, o.nearField, "", raysOf(o), o.seed};
}

// Mirrors and glass need a method that follows them.
void requireFollowed(const Situation& at, MethodSpec::Kind kind) {
  if (kind != MethodSpec::Kind::exact) return;
  for (const Patch& p : at.patches.patches) {
    if (!p.isSpecular()) continue;
    throw Error(
        "{}: surface '{}' is a mirror or clear glass, which --method {} does not follow; use rays, hybrid or, for planar mirrors, "
        "raster",
        at.scene.path, surfaceNameOf(at.scene, p), methodName(kind));
  }
}

// Closed forms where nothing can block and they cost little; rays, unless there is a GPU: then both make some rows and
// rays must lead by 20 %.
MethodChoice chooseMethod(const Situation& at) {
  using Kind = MethodSpec::Kind;
  const Options& o = at.options;
  if (o.method == "exact") {
    const std::string blocker = whatMayBlock(at.scene, at.facets);
    if (!blocker.empty()) {
      throw Error("{}: closed forms hold only where nothing can block: {}; use --method rays or raster", o.scene, blocker);
    }
  }
  if (o.method != "auto") {
    const Kind asked = o.method == "raster"   ? Kind::raster
                       : o.method == "rays"   ? Kind::rays
                       : o.method == "hybrid" ? Kind::hybrid
                                              : Kind::exact;
    requireFollowed(at, asked);
    return {specFrom(o, asked), "asked for"};
  }
  constexpr double kSecondsPerPair = 6e-7, kExactSeconds = 5;
  const double n = static_cast<double>(at.patches.frontPatchCount);
  if (o.command == Command::factors && o.rays == 0 && !at.patches.anySpecular() &&
      n * n * kSecondsPerPair / cores(o) < kExactSeconds && whatMayBlock(at.scene, at.facets).empty()) {
    return {specFrom(o, Kind::exact), "nothing in the scene can block, and closed forms of all pairs cost little"};
  }
  const MethodSpec byRays = specFrom(o, Kind::rays), byRaster = specFrom(o, at.patches.anySpecular() ? Kind::hybrid : Kind::raster);
  // Looking for a GPU takes longer than many a scene's rays.
  constexpr double kSecondsPerRay = 3e-8, kWorthLooking = 1;
  if (n * raysOf(o) * kSecondsPerRay / cores(o) < kWorthLooking) return {byRays, "rays take less time than looking for a GPU"};
  const std::vector<gpu::DeviceInfo> hardware = hardwareDevices();
  if (hardware.empty()) return {byRays, "no GPU: a software device is slower than rays"};
  const double rays = probeRows(at, byRays).rowsPerSecond, raster = probeRows(at, byRaster).rowsPerSecond;
  // At equal row errors: hemicubes 0.31 s^-0.57, rays 0.38 s^-0.6 (s samples per visible patch).
  const double pixels = 3.0 * o.resolution * o.resolution;
  const double worth = std::pow(0.31 / 0.38, 2) * std::pow(pixels, -1.14) / std::pow(raysOf(o), -1.2);
  return {rays > 1.2 * raster / worth ? byRays : byRaster,
          fmt::format("measured on {}: {:.0f} rows/s by raster, {:.0f} by rays; equal errors cost {:.2g} times", hardware[0].name,
                      raster, rays, raster / worth / rays)};
}

// Rows spread over the scene: neighbours would all be as cheap or as dear as their wall.
RowProbe probeRows(const Situation& at, const MethodSpec& spec, double seconds) {
  const std::unique_ptr<RowMaker> maker = at.methods.maker(spec);
  const size_t n = at.patches.size(), fronts = at.patches.frontPatchCount;
  FormFactorMatrix warmUp(n);  // the first rows wait for a driver to compile shaders
  maker->makeRows(std::vector<uint32_t>{0}, warmUp, [](size_t) {});
  const size_t chunk =
      spec.kind == MethodSpec::Kind::rays ? 256 : std::max<size_t>(32, at.methods.softwareDevices * at.methods.batch);
  size_t rows = 0, bytes = 0;
  double spent = 0;
  std::vector<bool> backs(n - fronts, false);
  while (rows < fronts && spent < seconds) {
    std::vector<uint32_t> probe;
    for (size_t k = 0; k < chunk && rows < fronts; ++k, ++rows) probe.push_back(static_cast<uint32_t>(rows * 7919 % fronts));
    FormFactorMatrix store(n);
    if (at.patches.colouredSpecular()) store.addChannels();
    const Stopwatch watch;
    maker->makeRows(probe, store, [](size_t) {});
    spent += watch.seconds();
    bytes += store.bytes();
    for (const uint32_t p : probe) {
      store[p].forEach([&](size_t j, double) {
        if (j >= fronts) backs[j - fronts] = true;
      });
    }
  }
  RowProbe result{static_cast<double>(rows) / spent, static_cast<double>(bytes) / static_cast<double>(std::max<size_t>(rows, 1)),
                  fronts};
  for (size_t k = 0; k < backs.size(); ++k) result.rows += backs[k] || at.patches.patches[fronts + k].emits() ? 1 : 0;
  return result;
}

uint64_t allowedBytes(const Options& options) {
  if (options.memory > 0) return options.memory;
  const uint64_t free = availableMemoryBytes();
  return free > 0 ? free / 5 * 4 : UINT64_MAX;
}

StorageChoice chooseStorage(const Situation& at, const MethodSpec& spec) {
  const auto n = static_cast<double>(at.patches.size()), rows = static_cast<double>(at.patches.frontPatchCount);
  const auto allowed = static_cast<double>(allowedBytes(at.options));
  const bool lists = spec.kind == MethodSpec::Kind::rays && !at.patches.anySpecular();  // paths fill rows
  if (lists && 4.0 * spec.rays <= n && rows * 4.0 * spec.rays <= allowed)
    return {Storage::float32, rows * 4.0 * spec.rays, "rows are lists of hits, much shorter than dense rows"};
  const double channels = at.patches.colouredSpecular() ? 3 : 1;
  if (channels * 4 * rows * n <= allowed) return {Storage::float32, channels * 4 * rows * n, "float32 fits"};
  // How much of a row is filled: some rows tell.
  constexpr size_t kProbes = 16;
  const std::vector<uint32_t> probes = chooseProbes(at.patches, kProbes);
  FormFactorMatrix f(at.patches.size(), UINT64_MAX, Storage::bits16);
  at.methods.maker(spec)->makeRows(probes, f, [](size_t) {});
  const double bytes = channels * static_cast<double>(f.bytes()) * rows / static_cast<double>(std::max<size_t>(probes.size(), 1));
  const bool sparse = f.packedRows() == 0;
  if (bytes > allowed) {
    throw Error(
        "{}: form factors of {} patches need {:.3g} GB in float32 and {:.3g} GB in {}; {:.3g} GB are allowed; ask for "
        "fewer patches (--patches), or allow more with --memory",
        at.options.scene, at.patches.size(), 4e-9 * channels * rows * n, bytes * 1e-9, sparse ? "lists of entries" : "16 bits",
        allowed * 1e-9);
  }
  return {Storage::bits16, bytes,
          fmt::format("float32 would take {:.3g} GB of the {:.3g} GB allowed; {}", 4e-9 * channels * rows * n, allowed * 1e-9,
                      sparse ? "rows are filled by less than a third" : "a row's sum is kept")};
}

PlaceChoice chooseSolvePlace(const Situation& at, const FormFactorMatrix& f) {
  const Options& o = at.options;
  if (o.solveOn != "auto") return {o.solveOn == "gpu", "asked for"};
  if (o.gave("--solver") && o.solver != SolverKind::jacobi)
    return {false, fmt::format("{} is made on the CPU", solverName(o.solver))};
  // Some ten sweeps at a rate that any machine reaches, against what opening a device takes.
  constexpr double kSweeps = 10, kBytesPerSecond = 1e10, kWorthLooking = 0.5;
  if (static_cast<double>(f.bytes()) * kSweeps / kBytesPerSecond < kWorthLooking)
    return {false, "the CPU takes less time than looking for a GPU"};
  if (hardwareDevices().empty()) return {false, "no GPU: a software device reads F no faster than the CPU"};
  const gpu::Device& device = at.methods.device();
  const SweepSeconds seconds = measureSweeps(f, at.patches, device);
  // Jacobi needs at least twice the sweeps of conjugate residuals; a winner must lead by 20 %.
  const double onDevice = seconds.upload + 2 * kSweeps * seconds.device, here = kSweeps * seconds.host;
  return {1.2 * onDevice < here,
          fmt::format("measured: a sweep takes {:.3g} s here and {:.3g} s on {}, to which F comes in {:.3g} s", seconds.host,
                      seconds.device, device.info().name, seconds.upload)};
}

}  // namespace farol
