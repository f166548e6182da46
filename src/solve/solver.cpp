#include "solve/solver.h"

#include "base/error.h"
#include "base/machine.h"
#include "solve/gather.h"
#include "solve/gpu_jacobi.h"
#include "solve/host_sweeps.h"
#include "solve/system.h"

#include <array>
#include <numeric>

namespace farol {
namespace {

// Radiosity that errors are measured against: the mean of the brightest channel over patches that do not emit,
// or over all patches when every patch emits or the others are black.
class Reference {
 public:
  explicit Reference(const PatchSet& patches) : all_(static_cast<Eigen::Index>(patches.size())), others_(all_.size()) {
    for (size_t i = 0; i < patches.size(); ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      all_[k] = patches.patches[i].area;
      others_[k] = patches.patches[i].emits() ? 0 : all_[k];
    }
    all_ /= std::max(all_.sum(), 1e-300);
    if (others_.sum() > 0) others_ /= others_.sum();
  }
  double of(const Channels& b) const {
    const double others = (others_.transpose() * b).maxCoeff();
    return others > 0 ? others : (all_.transpose() * b).maxCoeff();
  }

 private:
  Eigen::VectorXd all_, others_;  // weights
};

// A patch from which light can reach no absorber, no black back and no opening keeps it for ever. Light
// that is made there has no steady state. `drained` grows from every absorber along the rows of F.
void requireSteadyState(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene, const Rgb& sky) {
  for (int c = 0; c < 3; ++c) {
    std::vector<size_t> undrained;
    std::vector<bool> drained(patches.size(), false);
    const FormFactorMatrix& own = f.ofChannel(c);
    for (size_t i = 0; i < patches.size(); ++i) {
      const RowShares& s = own.shares(i);
      drained[i] = (patches.patches[i].reflectance + patches.patches[i].specular())[c] < 1 || s.missed > 0 || s.backs > 0 ||
                   s.cut > 0 || s.absorbed > 0 || s.exposed == 0;
      if (!drained[i]) undrained.push_back(i);
    }
    for (bool changed = !undrained.empty(); changed;) {
      changed = false;
      std::vector<size_t> left;
      for (const size_t i : undrained) {
        own[i].forEach([&](size_t j, double) {
          if (drained[j]) drained[i] = true;
        });
        if (drained[i])
          changed = true;
        else
          left.push_back(i);
      }
      undrained = std::move(left);
    }
    for (const size_t i : undrained) {
      if (patches.patches[i].emission[c] > 0 || sky[c] * f.shares(i).missed > 0) {
        throw Error(
            "{}: surface '{}', {} channel: light is emitted into a closed space that absorbs none "
            "(reflectance 1 all around), so there is no steady state",
            scene.path, surfaceNameOf(scene, patches.patches[i]),
            c == 0   ? "red"
            : c == 1 ? "green"
                     : "blue");
      }
    }
  }
}

Solution solveOneF(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Scene& scene,
                   const SolveOptions& options, const Log& log) {
  requireSteadyState(f, patches, scene, options.sky);
  System system(f, patches, direct, options.sky);
  const std::optional<Rgb> colour = system.makeOneColour();
  Solution result;
  result.kind = options.kind;
  result.channels = colour ? 1 : 3;
  result.bound = system.bound;
  Progress progress(log, "solve", "sweeps", 0);
  const auto refuse = [&](const std::string& found) {
    throw Error("{}: the solution diverges: after {} sweeps {}; reflectance times row sum reaches {:.6f} in row {}", scene.path,
                result.sweeps, found, system.bound, system.worstRow);
  };
  std::optional<GpuJacobi> onDevice;
  HostSweeps onHost(system, patches);
  // A device that fails is left: b and r are the host's, so nothing is lost but time.
  const auto triedOnDevice = [&](const auto& work) {
    try {
      work();
      return true;
    } catch (const gpu::OutOfMemory& e) {
      result.deviceFailure = e.what();
    } catch (const gpu::DeviceLost& e) {
      result.deviceFailure = e.what();
    }
    onDevice.reset();
    return false;
  };
  if (options.device != nullptr)
    triedOnDevice([&] { onDevice.emplace(*options.device, f, system.reflecting, system.reflectance); });

  const Reference meanRadiosity(patches);
  // The residual of B = 0 is E + rho S, and takes no sweep; that of any other B takes as long as one.
  Field b(Channels::Zero(static_cast<Eigen::Index>(patches.size()), 3));
  Channels r = system.start(), gathered = b.columns();
  double seen = 0;  // of the contraction, by sweeps
  bool free = !onDevice;
  if (!free) {  // a device knows of reflecting patches only
    b.add(r);
    r = system.residualOf(b, gathered);
  }
  result.residual = largest(r);
  const double firstResidual = result.residual;
  result.converged = firstResidual == 0;
  result.history.push_back(firstResidual);
  while (!result.converged && result.sweeps < options.maxSweeps) {
    // Sweeps for what r still lacks: the sum of all its reflections. A device makes them in float32.
    size_t most = options.maxSweeps - result.sweeps + (free ? 1 : 0);
    constexpr size_t kFirstLook = 8;  // at sums that may grow
    const bool krylov = result.kind == SolverKind::conjugateResiduals && !onDevice;
    if (system.bound > 1 && !krylov) most = std::min(most, std::max(kFirstLook, result.sweeps) + (free ? 1 : 0));
    Reflections made;
    if (onDevice) {
      const double goal = options.residual * meanRadiosity.of(b.columns());
      if (!triedOnDevice([&] { made = onDevice->reflections(r, goal, most); })) continue;
    } else {
      const Channels start = b.columns() + r;
      made = onHost.reflections(result.kind, r, most, [&](const Channels& sum, size_t sweeps) {
        progress.update(result.sweeps + sweeps);
        return options.residual * meanRadiosity.of(start + sum);
      });
    }
    b.add(r);
    b.add(made.sum);
    result.sweeps += made.changes.size() - (free ? 1 : 0);
    result.history.insert(result.history.end(), made.changes.begin() + (free ? 1 : 0), made.changes.end());
    free = false;
    const double change = made.changes.back();
    progress.update(result.sweeps);
    if (!std::isfinite(change) || change > 1e3 * firstResidual)
      refuse(fmt::format("a sweep changes radiosity by {:.3g}, the first residual was {:.3g}", change, firstResidual));
    if (made.radius >= 1 && result.sweeps < options.maxSweeps) {
      // Conjugate residuals would end at what no light adds up to. Whether it grows, or rows are far from reciprocal, sweeps
      // from the start tell.
      result.kind = SolverKind::gaussSeidel;
      b = Field(Channels::Zero(r.rows(), 3));
      r = system.start();
      free = true;
      continue;
    }

    r = system.residualOf(b, gathered);
    result.residual = largest(r);
    // One more Jacobi sweep on the residual shows how much a sweep still takes off the slowest part; after Gauss-Seidel,
    // which leaves that part small beside the others, the ratio of its last changes does. Conjugate residuals know.
    const Contraction found = krylov ? Contraction{} : contractionOn(system, patches, r);
    if (made.stuck) result.kind = SolverKind::gaussSeidel;
    if (system.bound > 1 && !krylov && result.sweeps >= kFirstLook && change > 0 &&
        change >= result.history[result.history.size() / 2]) {
      // Over two sweeps: rows that are not reciprocal may grow in one and shrink in the next.
      const double growth = std::sqrt(found.ofNorm * contractionOn(system, patches, system.reflectOnce(Field(r))).ofNorm);
      if (growth >= 1) refuse(fmt::format("a sweep multiplies the residual by {:.4f}", growth));
    }
    const size_t n = result.history.size();
    const double before = n > 2 ? result.history[n - 3] : 0, shrinks = before > 0 ? std::sqrt(change / before) : 0;
    seen = std::max(seen, krylov ? made.radius : shrinks);
    result.contraction = std::min(std::max({found.ofLargest, found.ofNorm, seen}), system.bound);
    const double room = 1 - result.contraction, reference = meanRadiosity.of(b.columns());
    result.error = reference > 0 && room > 0 ? result.residual / room / reference : result.residual > 0 ? 1e300 : 0;
    result.converged = result.error <= options.residual;
  }

  // Black patches are no part of the residual: their irradiance is gathered here.
  std::vector<size_t> rest;
  for (size_t i = 0, k = 0; i < patches.size(); ++i) {
    if (firstResidual > 0 && k < system.reflecting.size() && system.reflecting[k] == i)
      ++k;
    else
      rest.push_back(i);
  }
  forParts(rest, [&](std::span<const size_t> part, size_t) {
    std::array<Eigen::RowVector3d, kRowsAtOnce> sums;
    system.gather(part, b, sums.data());
    for (size_t l = 0; l < part.size(); ++l) gathered.row(static_cast<Eigen::Index>(part[l])) = sums[l];
  });
  // What was gathered from a B that converged makes one more Jacobi sweep of it, and B = E + rho H to the last bit.
  result.radiosity.resize(patches.size());
  result.irradiance.resize(patches.size());
  for (size_t i = 0; i < patches.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const Eigen::RowVector3d h = system.source.row(k) + gathered.row(k);
    const Eigen::RowVector3d out = result.converged ? system.updated(k, gathered.row(k)) : Eigen::RowVector3d(b.columns().row(k));
    result.irradiance[i] = {h[0], h[1], h[2]};
    result.radiosity[i] = {out[0], out[1], out[2]};
    if (colour) {
      result.irradiance[i] *= *colour;
      result.radiosity[i] *= *colour;
    }
    if (direct.isApart(i)) result.radiosity[i] += patches.patches[i].emission;
  }
  return result;
}

}  // namespace

// Three F: each channel is solved with its own.
Solution solveRadiosity(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Scene& scene,
                        const SolveOptions& options, const Log& log) {
  Solution result = solveOneF(f, patches, direct, scene, options, log);
  for (int c = 1; c < 3 && f.coloured(); ++c) {
    const Solution own = solveOneF(f.ofChannel(c), patches, direct, scene, options, log);
    for (size_t i = 0; i < patches.size(); ++i) {
      result.radiosity[i][c] = own.radiosity[i][c];
      result.irradiance[i][c] = own.irradiance[i][c];
    }
    result.converged &= own.converged;
    if (result.deviceFailure.empty()) result.deviceFailure = own.deviceFailure;
    result.sweeps += own.sweeps;
    result.residual = std::max(result.residual, own.residual);
    result.contraction = std::max(result.contraction, own.contraction);
    result.bound = std::max(result.bound, own.bound);
    result.error = std::max(result.error, own.error);
  }
  return result;
}

SweepSeconds measureSweeps(const FormFactorMatrix& f, const PatchSet& patches, const gpu::Device& device) {
  constexpr uint32_t kSweeps = 4;
  const System system(f, patches, {}, Rgb(0));
  SweepSeconds seconds;
  Stopwatch watch;
  GpuJacobi onDevice(device, f, system.reflecting, system.reflectance);
  seconds.upload = watch.seconds();
  const Channels r = system.reflectance;
  onDevice.reflections(r, 0, 3);  // the first ones wait for a driver to compile shaders
  watch = {};
  onDevice.sweep(kSweeps);
  seconds.device = watch.seconds() / kSweeps;
  watch = {};
  system.reflectOnce(Field(r));
  seconds.host = watch.seconds();
  return seconds;
}

EnergyBalance energyBalance(const FormFactorMatrix& f, const PatchSet& patches, const Solution& solution, const Rgb& sky,
                            const std::vector<Rgb>& fromPunctual) {
  EnergyBalance e;
  for (size_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches.patches[i];
    const auto share = [&](double RowShares::*what) {
      return Rgb(f.shares(i).*what, f.ofChannel(1).shares(i).*what, f.ofChannel(2).shares(i).*what);
    };
    const double area = p.area * f.shares(i).exposed;
    const Rgb missed = share(&RowShares::missed);
    e.emitted += area * p.emission;
    if (!fromPunctual.empty()) e.fromPunctual += area * (Rgb(1) - p.specular()) * fromPunctual[i];
    // Light is counted where it ends: of what arrives at a mirror only what the mirror does not pass on.
    const Rgb ending = Rgb(1) - p.specular();
    e.fromSky += area * missed * ending * sky;
    e.absorbed += area * (ending - p.reflectance) * solution.irradiance[i];
    e.toOpen += area * missed * solution.radiosity[i];
    e.toBacks += area * share(&RowShares::backs) * solution.radiosity[i];
    e.inSolids += area * share(&RowShares::absorbed) * solution.radiosity[i];
    e.cut += area * share(&RowShares::cut) * solution.radiosity[i];
  }
  for (int c = 0; c < 3; ++c) {
    const double in = e.emitted[c] + e.fromSky[c] + e.fromPunctual[c];
    if (in > 0)
      e.relativeError =
          std::max(e.relativeError, std::abs(e.absorbed[c] + e.toOpen[c] + e.toBacks[c] + e.inSolids[c] + e.cut[c] - in) / in);
  }
  return e;
}

}  // namespace farol
