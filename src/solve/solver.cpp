#include "solve/solver.h"

#include "base/error.h"

#include <Eigen/Core>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

// N x 3, a column per channel: the three systems are advanced together and share every load of F.
using Channels = Eigen::Matrix<double, Eigen::Dynamic, 3>;

// sums[c] = sum_j row[j] b[c n + j] for three channels. Eight partial sums per channel, always in the same order,
// so that every instruction set gives the same bits; the processor's widest is chosen at run time.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
__attribute__((target_clones("default", "avx2", "avx512f")))
#endif
void gatherRow(const float* row, const double* b, size_t n, double* sums) {
  constexpr size_t kLanes = 8;
  double partial[3][kLanes] = {};
  size_t j = 0;
  for (; j + kLanes <= n; j += kLanes) {
    for (size_t k = 0; k < kLanes; ++k) {
      const double f = static_cast<double>(row[j + k]);
      partial[0][k] += f * b[j + k];
      partial[1][k] += f * b[n + j + k];
      partial[2][k] += f * b[2 * n + j + k];
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    sums[c] = 0;
    for (const double p : partial[c]) sums[c] += p;
    for (size_t tail = j; tail < n; ++tail) sums[c] += static_cast<double>(row[tail]) * b[c * n + tail];
  }
}

// The same for a row that is a list of hits: `b` holds four doubles per patch and a last patch of zeros.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
__attribute__((target_clones("default", "avx2")))
#endif
void gatherHits(const uint32_t* ids, size_t count, double weight, const double* b, double* sums) {
  constexpr size_t kLanes = 4;  // hits side by side, to hide the additions' latency
  double partial[kLanes][4] = {};
  size_t k = 0;
  for (; k + kLanes <= count; k += kLanes) {
    for (size_t l = 0; l < kLanes; ++l) {
      const double* from = b + size_t{4} * ids[k + l];
      for (size_t c = 0; c < 4; ++c) partial[l][c] += from[c];
    }
  }
  for (; k < count; ++k) {
    for (size_t c = 0; c < 4; ++c) partial[0][c] += b[size_t{4} * ids[k] + c];
  }
  for (size_t c = 0; c < 3; ++c)
    sums[c] = weight * ((partial[0][c] + partial[1][c]) + (partial[2][c] + partial[3][c]));
}

// The same for a list of entries.
void gatherEntries(const uint32_t* ids, const float* values, size_t count, const double* b, double* sums) {
  constexpr size_t kLanes = 2;
  double partial[kLanes][4] = {};
  size_t k = 0;
  for (; k + kLanes <= count; k += kLanes) {
    for (size_t l = 0; l < kLanes; ++l) {
      const double* from = b + size_t{4} * ids[k + l];
      for (size_t c = 0; c < 4; ++c) partial[l][c] += static_cast<double>(values[k + l]) * from[c];
    }
  }
  for (; k < count; ++k) {
    for (size_t c = 0; c < 4; ++c) partial[0][c] += static_cast<double>(values[k]) * b[size_t{4} * ids[k] + c];
  }
  for (size_t c = 0; c < 3; ++c) sums[c] = partial[0][c] + partial[1][c];
}

// A value per patch and channel, kept in the two orders that dense rows and lists of hits read fastest.
class Field {
 public:
  explicit Field(Channels values) : columns_(std::move(values)), packed_(4 * (static_cast<size_t>(columns_.rows()) + 1), 0.0) {
    for (Eigen::Index i = 0; i < columns_.rows(); ++i) pack(i);
  }
  void set(Eigen::Index i, const Eigen::RowVector3d& value) {
    columns_.row(i) = value;
    pack(i);
  }
  const Channels& columns() const { return columns_; }
  const double* packed() const { return packed_.data(); }

 private:
  void pack(Eigen::Index i) {
    for (int c = 0; c < 3; ++c) packed_[4 * static_cast<size_t>(i) + static_cast<size_t>(c)] = columns_(i, c);
  }
  Channels columns_;
  std::vector<double> packed_;
};

class System {
 public:
  System(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Rgb& sky) : f_(f) {
    const auto n = static_cast<Eigen::Index>(patches.size());
    emission = Channels::Zero(n, 3);
    reflectance = Channels::Zero(n, 3);
    source = Channels::Zero(n, 3);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Patch& p = patches.patches[static_cast<size_t>(i)];
      const RowShares& shares = f.shares(static_cast<size_t>(i));
      for (int c = 0; c < 3; ++c) {
        emission(i, c) = direct.isApart(static_cast<size_t>(i)) ? 0.0 : p.emission[c];
        reflectance(i, c) = p.reflectance[c];
        source(i, c) = shares.missed * sky[c];  // irradiance from the sky
        if (direct.present()) source(i, c) += direct.irradiance[static_cast<size_t>(i)][c];
      }
      if (maxChannel(p.reflectance) > 0) reflecting.push_back(static_cast<size_t>(i));
    }
  }

  Channels start() const { return emission + reflectance.cwiseProduct(source); }

  // sum_j F_ij b_j for three channels.
  Eigen::RowVector3d gather(size_t i, const Field& b) const {
    const FormFactorRow row = f_[i];
    Eigen::RowVector3d sums = Eigen::RowVector3d::Zero();
    if (!row.dense.empty())
      gatherRow(row.dense.data(), b.columns().data(), row.dense.size(), sums.data());
    else if (!row.values.empty())
      gatherEntries(row.ids.data(), row.values.data(), row.ids.size(), b.packed(), sums.data());
    else if (!row.ids.empty())
      gatherHits(row.ids.data(), row.ids.size(), static_cast<double>(row.weight), b.packed(), sums.data());
    return sums;
  }

  // What patch i's radiosity should be, given the others.
  Eigen::RowVector3d updated(size_t i, const Field& b) const {
    const auto k = static_cast<Eigen::Index>(i);
    return emission.row(k) + reflectance.row(k).cwiseProduct(source.row(k) + gather(i, b));
  }

  double rowSum(size_t i) const { return f_.rowSum(i); }

  Channels emission, reflectance, source;  // emission: without emitters apart; source: irradiance without F
  // Black patches have B = E: they stay out of the iteration.
  std::vector<size_t> reflecting;

 private:
  const FormFactorMatrix& f_;
};

// E + rho (source + F b) - b over the reflecting patches; zero elsewhere.
Channels residualOf(const System& s, const Field& b) {
  Channels r = Channels::Zero(b.columns().rows(), 3);
  tbb::parallel_for(size_t{0}, s.reflecting.size(), [&](size_t k) {
    const auto i = static_cast<Eigen::Index>(s.reflecting[k]);
    r.row(i) = s.updated(s.reflecting[k], b) - b.columns().row(i);
  });
  return r;
}

// rho F v: one Jacobi sweep applied to a difference.
Channels reflectOnce(const System& s, const Field& v) {
  Channels out = Channels::Zero(v.columns().rows(), 3);
  tbb::parallel_for(size_t{0}, s.reflecting.size(), [&](size_t k) {
    const auto i = static_cast<Eigen::Index>(s.reflecting[k]);
    out.row(i) = s.reflectance.row(i).cwiseProduct(s.gather(s.reflecting[k], v));
  });
  return out;
}

double largest(const Channels& v) {
  return v.size() > 0 ? v.cwiseAbs().maxCoeff() : 0.0;
}

// One sweep in place; returns the largest change.
double sweepGaussSeidel(const System& s, Field& b) {
  double change = 0;
  for (const size_t i : s.reflecting) {
    const auto k = static_cast<Eigen::Index>(i);
    const Eigen::RowVector3d next = s.updated(i, b);
    change = std::max(change, (next - b.columns().row(k)).cwiseAbs().maxCoeff());
    b.set(k, next);
  }
  return change;
}

double sweepJacobi(const System& s, Field& b) {
  const Channels r = residualOf(s, b);  // the change of a Jacobi sweep is the residual before it
  b = Field(b.columns() + r);
  return largest(r);
}

// Radiosity that errors are measured against: the mean of the brightest channel over patches that do not emit,
// or over all patches when every patch emits.
double referenceRadiosity(const PatchSet& patches, const Channels& b) {
  Eigen::RowVector3d others = Eigen::RowVector3d::Zero(), all = others;
  double otherArea = 0, allArea = 0;
  for (size_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches.patches[i];
    const Eigen::RowVector3d flux = p.area * b.row(static_cast<Eigen::Index>(i));
    all += flux;
    allArea += p.area;
    if (p.emits()) continue;
    others += flux;
    otherArea += p.area;
  }
  const double fromOthers = otherArea > 0 ? others.maxCoeff() / otherArea : 0;
  return fromOthers > 0 ? fromOthers : all.maxCoeff() / allArea;
}

// A patch from which light can reach no absorber, no black back and no opening keeps it for ever. Light
// that is made there has no steady state. `drained` grows from every absorber along the rows of F.
void requireSteadyState(const FormFactorMatrix& f, const PatchSet& patches, const Scene& scene, const Rgb& sky) {
  for (int c = 0; c < 3; ++c) {
    std::vector<size_t> undrained;
    std::vector<bool> drained(patches.size(), false);
    for (size_t i = 0; i < patches.size(); ++i) {
      const RowShares& s = f.shares(i);
      drained[i] = patches.patches[i].reflectance[c] < 1 || s.missed > 0 || s.backs > 0 || s.exposed == 0;
      if (!drained[i]) undrained.push_back(i);
    }
    for (bool changed = !undrained.empty(); changed;) {
      changed = false;
      std::vector<size_t> left;
      for (const size_t i : undrained) {
        f[i].forEach([&](size_t j, double) {
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

}  // namespace

Solution solveRadiosity(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct,
                        const Scene& scene, const SolveOptions& options, const Log& log) {
  requireSteadyState(f, patches, scene, options.sky);
  const System system(f, patches, direct, options.sky);
  Field b(system.start());
  Solution result;
  Progress progress(log, "solve", "sweeps", 0);

  double bound = 0;  // no operator norm exceeds this
  for (const size_t i : system.reflecting)
    bound = std::max(bound, maxChannel(patches.patches[i].reflectance) * system.rowSum(i));

  Channels r = residualOf(system, b);
  result.residual = largest(r);
  const double firstResidual = result.residual;
  double patience = 1;  // the true residual is looked at when a sweep's change suggests that it is small enough
  result.converged = firstResidual == 0;
  while (!result.converged && result.sweeps < options.maxSweeps) {
    const double change =
        options.kind == SolverKind::gaussSeidel ? sweepGaussSeidel(system, b) : sweepJacobi(system, b);
    progress.update(++result.sweeps);
    const double reference = referenceRadiosity(patches, b.columns());
    const bool lastSweep = result.sweeps == options.maxSweeps;
    if (!std::isfinite(change) || change > 1e3 * firstResidual) {
      throw Error(
          "{}: the solution diverges: after {} sweeps a sweep changes radiosity by {:.3g}, the first residual was "
          "{:.3g}; "
          "reflectance times row sum reaches {:.6f}",
          scene.path, result.sweeps, change, firstResidual, bound);
    }
    if (change > patience * options.residual * reference && !lastSweep) continue;

    r = residualOf(system, b);
    result.residual = largest(r);
    // One more sweep on the residual shows how much a sweep still takes off the slowest part.
    const double next = largest(reflectOnce(system, Field(r)));
    result.contraction = result.residual > 0 ? std::min(next / result.residual, bound) : 0;
    const double room = 1 - result.contraction;
    result.error = reference > 0 && room > 0 ? result.residual / room / reference : result.residual > 0 ? 1e300 : 0;
    result.converged = result.error <= options.residual;
    // Ask again when the change has fallen by what is still missing, but after a few sweeps at the latest.
    patience *= std::clamp(0.9 * options.residual / std::max(result.error, 1e-300), 1e-3, 0.5);
  }

  result.radiosity.resize(patches.size());
  result.irradiance.resize(patches.size());
  tbb::parallel_for(size_t{0}, patches.size(), [&](size_t i) {
    const auto k = static_cast<Eigen::Index>(i);
    const Eigen::RowVector3d h = system.source.row(k) + system.gather(i, b);
    result.irradiance[i] = {h[0], h[1], h[2]};
    result.radiosity[i] = {b.columns()(k, 0), b.columns()(k, 1), b.columns()(k, 2)};
    if (direct.isApart(i)) result.radiosity[i] += patches.patches[i].emission;
  });
  return result;
}

EnergyBalance energyBalance(const FormFactorMatrix& f, const PatchSet& patches, const Solution& solution,
                            const Rgb& sky, const std::vector<Rgb>& fromPunctual) {
  EnergyBalance e;
  for (size_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches.patches[i];
    const RowShares& s = f.shares(i);
    const double area = p.area * s.exposed;
    e.emitted += area * p.emission;
    if (!fromPunctual.empty()) e.fromPunctual += area * fromPunctual[i];
    e.fromSky += area * s.missed * sky;
    e.absorbed += area * (Rgb(1) - p.reflectance) * solution.irradiance[i];
    e.toOpen += area * s.missed * solution.radiosity[i];
    e.toBacks += area * s.backs * solution.radiosity[i];
  }
  for (int c = 0; c < 3; ++c) {
    const double in = e.emitted[c] + e.fromSky[c] + e.fromPunctual[c];
    if (in > 0)
      e.relativeError = std::max(e.relativeError, std::abs(e.absorbed[c] + e.toOpen[c] + e.toBacks[c] - in) / in);
  }
  return e;
}

}  // namespace farol
