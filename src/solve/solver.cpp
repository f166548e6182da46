#include "solve/solver.h"

#include "base/error.h"

#include <Eigen/Core>
#include <array>
#include <bit>
#include <cstring>
#if defined(__x86_64__)
#include <immintrin.h>
#endif
#include <tbb/parallel_for.h>

namespace farol {
namespace {

// N x 3, a column per channel: the three systems are advanced together and share every load of F.
using Channels = Eigen::Matrix<double, Eigen::Dynamic, 3>;

// sum_j rows[r][j] b[c n + j] for three channels and several rows, which share every load of b. Eight partial sums per
// row and channel, always in the same order: neither the number of rows nor, where multiply and add are fused, the
// instruction set changes a bit.
constexpr size_t kLanes = 8;
using Partial = double[3][kLanes];

// Adds what j below `last`, a multiple of eight, bring.
using Gather = void (*)(const float* const* rows, const double* b, size_t n, size_t last, Partial* sums);

template <size_t Rows>
void gatherPlain(const float* const* rows, const double* b, size_t n, size_t last, Partial* sums) {
  for (size_t j = 0; j < last; j += kLanes) {
    for (size_t r = 0; r < Rows; ++r) {
      for (size_t k = 0; k < kLanes; ++k) {
        const auto f = static_cast<double>(rows[r][j + k]);
        for (size_t c = 0; c < 3; ++c) sums[r][c][k] += f * b[c * n + j + k];
      }
    }
  }
}

#if defined(__x86_64__)
template <size_t Rows>
[[gnu::target("avx2,fma")]] void gatherAvx2(const float* const* rows, const double* b, size_t n, size_t last,
                                            Partial* sums) {
  if constexpr (Rows > 2) {  // sixteen registers hold the sums of two rows
    gatherAvx2<2>(rows, b, n, last, sums);
    gatherAvx2<Rows - 2>(rows + 2, b, n, last, sums + 2);
  } else {
    __m256d part[Rows][3][2];
    std::memcpy(part, sums, sizeof part);
    for (size_t j = 0; j < last; j += kLanes) {
      for (size_t r = 0; r < Rows; ++r) {
        for (size_t h = 0; h < 2; ++h) {
          const __m256d f = _mm256_cvtps_pd(_mm_loadu_ps(rows[r] + j + 4 * h));
          for (size_t c = 0; c < 3; ++c)
            part[r][c][h] = _mm256_fmadd_pd(f, _mm256_loadu_pd(b + c * n + j + 4 * h), part[r][c][h]);
        }
      }
    }
    std::memcpy(sums, part, sizeof part);
  }
}

template <size_t Rows>
[[gnu::target("avx512f")]] void gatherAvx512(const float* const* rows, const double* b, size_t n, size_t last,
                                              Partial* sums) {
  __m512d part[Rows][3];
  std::memcpy(part, sums, sizeof part);
  for (size_t j = 0; j < last; j += kLanes) {
    const __m512d from[3] = {_mm512_loadu_pd(b + j), _mm512_loadu_pd(b + n + j), _mm512_loadu_pd(b + 2 * n + j)};
    for (size_t r = 0; r < Rows; ++r) {
      const __m512d f = __builtin_convertvector(_mm256_loadu_ps(rows[r] + j), __m512d);
      for (size_t c = 0; c < 3; ++c) part[r][c] = _mm512_fmadd_pd(f, from[c], part[r][c]);
    }
  }
  std::memcpy(sums, part, sizeof part);
}
#endif

// For the processor that runs this.
template <size_t Rows>
Gather chosenGather() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f")) return gatherAvx512<Rows>;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return gatherAvx2<Rows>;
#endif
  return gatherPlain<Rows>;
}

// sums[r] of at most kRowsAtOnce dense rows.
constexpr size_t kRowsAtOnce = 16, kGroup = 8;
void gatherRows(std::span<const float* const> rows, const double* b, size_t n, Eigen::RowVector3d* sums) {
  static const Gather one = chosenGather<1>(), group = chosenGather<kGroup>();
  alignas(64) Partial partial[kRowsAtOnce] = {};
  const size_t even = n / kLanes * kLanes;
  size_t done = 0;
  for (; done + kGroup <= rows.size(); done += kGroup) group(rows.data() + done, b, n, even, partial + done);
  for (; done < rows.size(); ++done) one(rows.data() + done, b, n, even, partial + done);
  for (size_t r = 0; r < rows.size(); ++r) {
    for (size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (const double p : partial[r][c]) sum += p;
      for (size_t j = even; j < n; ++j) sum += static_cast<double>(rows[r][j]) * b[c * n + j];
      sums[r][static_cast<Eigen::Index>(c)] = sum;
    }
  }
}

// The same for a row that is a list of hits: `b` holds four doubles per patch and a last patch of zeros.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
__attribute__((target_clones("default", "avx2")))
#endif
void gatherHits(const uint32_t* ids, size_t count, double weight, const double* b, double* sums) {
  constexpr size_t kSide = 4;  // hits side by side, to hide the additions' latency
  double partial[kSide][4] = {};
  size_t k = 0;
  for (; k + kSide <= count; k += kSide) {
    for (size_t l = 0; l < kSide; ++l) {
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
  constexpr size_t kSide = 2;
  double partial[kSide][4] = {};
  size_t k = 0;
  for (; k + kSide <= count; k += kSide) {
    for (size_t l = 0; l < kSide; ++l) {
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
  void add(const Channels& change) {
    columns_ += change;
    for (Eigen::Index i = 0; i < columns_.rows(); ++i) pack(i);
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

// Calls `use(part, place)` for parts of at most kRowsAtOnce patches, on all cores.
template <typename Use>
void forParts(std::span<const size_t> patches, Use&& use) {
  tbb::parallel_for(size_t{0}, (patches.size() + kRowsAtOnce - 1) / kRowsAtOnce, [&](size_t part) {
    const size_t at = part * kRowsAtOnce;
    use(patches.subspan(at, std::min(kRowsAtOnce, patches.size() - at)), at);
  });
}

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
    const float* dense = denseRow(i);
    if (dense != nullptr)
      gatherRows(std::span(&dense, 1), b.columns().data(), f_.size(), &sums);
    else if (!row.values.empty())
      gatherEntries(row.ids.data(), row.values.data(), row.ids.size(), b.packed(), sums.data());
    else if (!row.ids.empty())
      gatherHits(row.ids.data(), row.ids.size(), static_cast<double>(row.weight), b.packed(), sums.data());
    return sums;
  }

  // The same for at most kRowsAtOnce patches, in `sums` one after the other.
  void gather(std::span<const size_t> patches, const Field& b, Eigen::RowVector3d* sums) const {
    std::array<const float*, kRowsAtOnce> rows;
    for (size_t k = 0; k < patches.size(); ++k) rows[k] = denseRow(patches[k]);
    if (std::find(rows.begin(), rows.begin() + patches.size(), nullptr) == rows.begin() + patches.size()) {
      gatherRows(std::span(rows).first(patches.size()), b.columns().data(), f_.size(), sums);
    } else {
      for (size_t k = 0; k < patches.size(); ++k) sums[k] = gather(patches[k], b);
    }
  }
  // The same for all reflecting patches, on all cores; `use(k, sum)` for the k-th.
  template <typename Use>
  void gatherAll(const Field& b, Use&& use) const {
    forParts(reflecting, [&](std::span<const size_t> patches, size_t) {
      std::array<Eigen::RowVector3d, kRowsAtOnce> sums;
      gather(patches, b, sums.data());
      for (size_t k = 0; k < patches.size(); ++k) use(static_cast<Eigen::Index>(patches[k]), sums[k]);
    });
  }
  const float* denseRow(size_t i) const {  // null for a list
    const std::span<const float> row = f_[i].dense;
    return row.empty() ? nullptr : row.data();
  }

  // What patch i's radiosity should be where the others send `gathered`.
  Eigen::RowVector3d updated(Eigen::Index i, const Eigen::RowVector3d& gathered) const {
    return emission.row(i) + reflectance.row(i).cwiseProduct(source.row(i) + gathered);
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
  s.gatherAll(b, [&](Eigen::Index i, const Eigen::RowVector3d& sum) { r.row(i) = s.updated(i, sum) - b.columns().row(i); });
  return r;
}

// rho F v: one Jacobi sweep applied to a difference.
Channels reflectOnce(const System& s, const Field& v) {
  Channels out = Channels::Zero(v.columns().rows(), 3);
  s.gatherAll(v, [&](Eigen::Index i, const Eigen::RowVector3d& sum) { out.row(i) = s.reflectance.row(i).cwiseProduct(sum); });
  return out;
}

double largest(const Channels& v) {
  return v.size() > 0 ? v.cwiseAbs().maxCoeff() : 0.0;
}

// One sweep in place; returns the largest change. Rows of a block are gathered together, on all cores, from the radiosity
// before the block; what changes within the block is then added in order: Gauss-Seidel up to rounding.
double sweepGaussSeidel(const System& s, Field& b) {
  constexpr size_t kBlock = 128;
  double change = 0;
  std::array<Eigen::RowVector3d, kBlock> sums, changes;
  for (size_t first = 0; first < s.reflecting.size(); first += kBlock) {
    const auto block = std::span(s.reflecting).subspan(first, std::min(kBlock, s.reflecting.size() - first));
    const bool dense = std::all_of(block.begin(), block.end(), [&](size_t i) { return s.denseRow(i) != nullptr; });
    if (dense) {
      forParts(block, [&](std::span<const size_t> patches, size_t at) { s.gather(patches, b, &sums[at]); });
    }
    for (size_t k = 0; k < block.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(block[k]);
      if (dense) {
        const float* row = s.denseRow(block[k]);
        for (size_t l = 0; l < k; ++l) sums[k] += static_cast<double>(row[block[l]]) * changes[l];
      } else {
        sums[k] = s.gather(block[k], b);
      }
      const Eigen::RowVector3d next = s.updated(i, sums[k]);
      changes[k] = next - b.columns().row(i);
      change = std::max(change, changes[k].cwiseAbs().maxCoeff());
      b.set(i, next);
    }
  }
  return change;
}

double sweepJacobi(const System& s, Field& b) {
  const Channels r = residualOf(s, b);  // the change of a Jacobi sweep is the residual before it
  b.add(r);
  return largest(r);
}

// The factor by which a Jacobi sweep reduces the residual r: what it does to the largest value, and to the norm with
// weights A / rho (of the worst channel), in which rho F is self-adjoint: the spectral radius is not below that.
struct Contraction {
  double ofLargest = 0, ofNorm = 0;
};
Contraction contractionOn(const System& s, const PatchSet& patches, const Channels& r) {
  const double size = largest(r);
  if (size == 0) return {};
  const Channels next = reflectOnce(s, Field(r));
  Contraction contraction{largest(next) / size, 0};
  for (int c = 0; c < 3; ++c) {
    double after = 0, before = 0;
    for (const size_t i : s.reflecting) {
      const auto k = static_cast<Eigen::Index>(i);
      if (s.reflectance(k, c) <= 0) continue;
      const double weight = patches.patches[i].area / s.reflectance(k, c);
      after += weight * next(k, c) * next(k, c);
      before += weight * r(k, c) * r(k, c);
    }
    if (before > 0) contraction.ofNorm = std::max(contraction.ofNorm, std::sqrt(after / before));
  }
  return contraction;
}

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
  size_t worstRow = 0;
  for (const size_t i : system.reflecting) {
    const double norm = maxChannel(patches.patches[i].reflectance) * system.rowSum(i);
    if (norm > bound) worstRow = i;
    bound = std::max(bound, norm);
  }
  const auto refuse = [&](const std::string& found) {
    throw Error("{}: the solution diverges: after {} sweeps {}; reflectance times row sum reaches {:.6f} in row {}",
                scene.path, result.sweeps, found, bound, worstRow);
  };

  const Reference meanRadiosity(patches);
  Channels r = residualOf(system, b);
  result.residual = largest(r);
  const double firstResidual = result.residual;
  double patience = 1;  // the true residual is looked at when a sweep's change suggests that it is small enough
  result.converged = firstResidual == 0;
  while (!result.converged && result.sweeps < options.maxSweeps) {
    const double change =
        options.kind == SolverKind::gaussSeidel ? sweepGaussSeidel(system, b) : sweepJacobi(system, b);
    progress.update(++result.sweeps);
    const double reference = meanRadiosity.of(b.columns());
    const bool lastSweep = result.sweeps == options.maxSweeps;
    if (!std::isfinite(change) || change > 1e3 * firstResidual)
      refuse(fmt::format("a sweep changes radiosity by {:.3g}, the first residual was {:.3g}", change, firstResidual));
    if (bound > 1 && result.sweeps >= 8 && std::has_single_bit(result.sweeps) && change > 0) {
      // Over two sweeps: rows that are not reciprocal may grow in one and shrink in the next.
      const Channels before = residualOf(system, b), after = reflectOnce(system, Field(before));
      const double growth =
          std::sqrt(contractionOn(system, patches, before).ofNorm * contractionOn(system, patches, after).ofNorm);
      if (growth >= 1) refuse(fmt::format("a sweep multiplies the residual by {:.4f}", growth));
    }
    if (change > patience * options.residual * reference && !lastSweep) continue;

    r = residualOf(system, b);
    result.residual = largest(r);
    // One more sweep on the residual shows how much a sweep still takes off the slowest part.
    const Contraction found = contractionOn(system, patches, r);
    result.contraction = std::min(std::max(found.ofLargest, found.ofNorm), bound);
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
