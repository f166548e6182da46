#include "solve/host_sweeps.h"

#include "solve/gather.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr double kWellBelow = 0.3;

// What is gathered of floats errs by so much of it, which stays in the residual: they are read where that is well below what may
// be left.
Reading readingOf(double gathered, double left) {
  constexpr double kFloatRounding = 2e-7;
  return kFloatRounding * gathered < kWellBelow * left ? Reading::inFloat : Reading::inDouble;
}

constexpr size_t kBlock = 128;  // rows that Gauss-Seidel gathers together

// Calls `use(place, factor)` for parts of entries of row i that lie in the block (ascending patches).
template <typename Use>
void forEachWithin(const FormFactorRow& row, std::span<const size_t> block, Use&& use) {
  const size_t first = block.front(), last = block.back();
  const auto inOrder = [&](size_t j, double value) {
    const auto at = std::lower_bound(block.begin(), block.end(), j);
    if (at != block.end() && *at == j) use(static_cast<size_t>(at - block.begin()), value);
  };
  for (size_t k = 0; k < block.size() && !row.dense.empty(); ++k) use(k, static_cast<double>(row.dense[block[k]]));
  for (size_t k = 0; k < block.size() && !row.steps.empty(); ++k) use(k, row.steps[block[k]] * static_cast<double>(row.weight));
  if (!row.values.empty()) {
    for (auto at = std::lower_bound(row.ids.begin(), row.ids.end(), first); at != row.ids.end() && *at <= last; ++at)
      inOrder(*at, static_cast<double>(row.values[static_cast<size_t>(at - row.ids.begin())]));
  } else if (row.steps.empty()) {
    for (const uint32_t j : row.ids) {
      if (j - first <= last - first) inOrder(j, static_cast<double>(row.weight));
    }
  }
}

// What conjugate residuals learn of A = I - rho F in one channel: in the directions q_k that they span, one from step to
// step, A r_k = sum_j images(j, k) q_j and r_k - r_{k+1} = steps[k] q_k.
struct Spanned {
  static constexpr size_t kMost = 64;
  Eigen::MatrixXd images = Eigen::MatrixXd::Zero(kMost, kMost);
  std::vector<double> steps;
  double left = 0;  // of the residual

  void add(size_t j, size_t k, double part) {
    if (k < kMost) images(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = part;
  }
  // The largest eigenvalue of rho F, projected onto them (a Ritz value). A q_k needs A r_{k+1}, which is known up to the last
  // step, and is nothing where nothing was left.
  double radius() const {
    const size_t known =
        left < 1e-6 * std::abs(steps.empty() ? 0.0 : steps.back()) ? steps.size() : std::max<size_t>(steps.size(), 1) - 1;
    const auto n = static_cast<Eigen::Index>(std::min(known, kMost - 1));
    if (n == 0) return 0;
    Eigen::MatrixXd projected(n, n);
    for (Eigen::Index k = 0; k < n; ++k)
      projected.col(k) = (images.col(k) - images.col(k + 1)).head(n) / steps[static_cast<size_t>(k)];
    return 1 - projected.eigenvalues().real().minCoeff();
  }
};

// Rows of vectors that are worked on together, on all cores: what is summed over them is the same to the last bit on any number of
// cores. `use(rows first to first + count, sums)` adds to Count x 3 sums, a column per channel.
constexpr Eigen::Index kRowsTogether = 2048;
template <int Count>
using Sums = Eigen::Matrix<double, Count, 3>;

template <int Count, typename Use>
Sums<Count> summed(Eigen::Index rows, const Use& use) {
  std::vector<Sums<Count>> parts(static_cast<size_t>((rows + kRowsTogether - 1) / kRowsTogether), Sums<Count>::Zero());
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t part) {
    const Eigen::Index first = static_cast<Eigen::Index>(part) * kRowsTogether;
    use(first, std::min(kRowsTogether, rows - first), parts[part]);
  });
  Sums<Count> all = Sums<Count>::Zero();
  for (const auto& part : parts) all += part;
  return all;
}

}  // namespace

HostSweeps::HostSweeps(const System& system, const PatchSet& patches) : system_(system), weights_(system.reflectance) {
  for (Eigen::Index i = 0; i < weights_.rows(); ++i) {
    const auto patch = static_cast<size_t>(i);
    const double area = patches.patches[patch].area * system.factors().shares(patch).exposed;
    for (int c = 0; c < 3; ++c) weights_(i, c) = system.reflectance(i, c) > 0 ? area / system.reflectance(i, c) : 0.0;
  }
}

// Truncated generalised conjugate residuals (Eisenstat, Elman and Schultz, 1983), each channel with its own: a step
// takes from the residual what the last directions can. In the weights rho F is self-adjoint but for its errors, so that few
// directions do. Where it is far from that they may not: after so many steps that have not halved the residual it is stuck.
Reflections HostSweeps::conjugateResiduals(const Channels& r, size_t mostSweeps, const Goal& goal) {
  constexpr size_t kDirections = 8, kPatience = 64;
  constexpr double kMargin = 0.7, kRounding = 1e-14;
  if (mostSweeps < 2) return {Channels::Zero(r.rows(), 3), {largest(r)}};
  Reflections result{Channels::Zero(r.rows(), 3), {largest(r)}};
  // A residual hides an error of up to 1 / (1 - radius) of it.
  const auto leftWhere = [&](double radius) { return kMargin * (1 - radius) * goal(result.sum, result.changes.size() - 1); };
  const auto enough = [&] { return result.changes.back() <= leftWhere(result.radius); };
  const auto reading = [&] { return readingOf(result.changes.back(), leftWhere(system_.bound)); };
  // What lies on black patches is reflected once, and is no part of the residual afterwards.
  Channels residual = system_.reflectOnce(Field(r, reading()));
  result.changes.push_back(largest(residual));
  std::vector<Channels> directions(kDirections), images(kDirections, Channels(r.rows(), 3));
  std::array<Spanned, 3> spanned;
  Field packed(residual);
  const Eigen::Index rows = r.rows();
  const auto tellLeft = [&](const Sums<1>& squares) {
    for (int c = 0; c < 3; ++c) spanned[static_cast<size_t>(c)].left = std::sqrt(squares[c]);
  };
  tellLeft(summed<1>(rows, [&](Eigen::Index first, Eigen::Index count, Sums<1>& sums) {
    sums = weights_.middleRows(first, count).cwiseProduct(residual.middleRows(first, count).cwiseAbs2()).colwise().sum();
  }));
  const auto lookAtRadius = [&] {
    for (const Spanned& own : spanned) result.radius = std::max(result.radius, own.radius());
  };
  for (size_t k = 0; result.changes.size() < mostSweeps && result.changes.back() > kRounding * result.changes[1]; ++k) {
    if (enough()) {
      lookAtRadius();
      if (enough()) return result;
    }
    const size_t n = result.changes.size();
    result.stuck = n > kPatience && result.changes[n - 1] > 0.5 * result.changes[n - 1 - kPatience];
    if (result.stuck) break;
    Channels &p = directions[k % kDirections], &image = images[k % kDirections];
    p = residual;
    packed.assign(residual, reading());
    const Channels reflected = system_.reflectOnce(packed);
    const size_t oldest = k < kDirections ? 0 : k + 1 - kDirections;
    // Images are orthonormal: what of the new one lies along each can be told at once.
    const auto along = summed<kDirections>(rows, [&](Eigen::Index first, Eigen::Index count, auto& sums) {
      image.middleRows(first, count) = residual.middleRows(first, count) - reflected.middleRows(first, count);
      const Channels weighted = weights_.middleRows(first, count).cwiseProduct(image.middleRows(first, count));
      for (size_t j = oldest; j < k; ++j) {
        const auto at = static_cast<Eigen::Index>(j % kDirections);
        sums.row(at) = images[j % kDirections].middleRows(first, count).cwiseProduct(weighted).colwise().sum();
      }
    });
    // Of what is left of it: its square, and its product with the residual.
    const auto left = summed<2>(rows, [&](Eigen::Index first, Eigen::Index count, Sums<2>& sums) {
      const auto weights = weights_.middleRows(first, count).array();
      for (Eigen::Index c = 0; c < 3; ++c) {
        for (size_t j = oldest; j < k; ++j) {
          const double part = along(static_cast<Eigen::Index>(j % kDirections), c);
          image.col(c).segment(first, count) -= part * images[j % kDirections].col(c).segment(first, count);
          p.col(c).segment(first, count) -= part * directions[j % kDirections].col(c).segment(first, count);
        }
      }
      sums.row(0) = (weights * image.middleRows(first, count).array().square()).colwise().sum();
      sums.row(1) = (weights * image.middleRows(first, count).array() * residual.middleRows(first, count).array()).colwise().sum();
    });
    Sums<1> steps = Sums<1>::Zero(), shares = Sums<1>::Ones();
    for (Eigen::Index c = 0; c < 3; ++c) {
      Spanned& own = spanned[static_cast<size_t>(c)];
      for (size_t j = oldest; j < k; ++j) own.add(j, k, along(static_cast<Eigen::Index>(j % kDirections), c));
      if (own.left <= kRounding * std::abs(own.steps.empty() ? own.left : own.steps[0])) continue;  // nothing, or dark
      const double norm = std::sqrt(left(0, c));
      own.add(k, k, norm);
      shares[c] = 1 / norm;
      steps[c] = left(1, c) / norm;
      own.steps.push_back(steps[c]);
    }
    const auto squares = summed<1>(rows, [&](Eigen::Index first, Eigen::Index count, Sums<1>& sums) {
      for (Eigen::Index c = 0; c < 3; ++c) {
        auto own = image.col(c).segment(first, count), direction = p.col(c).segment(first, count),
             rest = residual.col(c).segment(first, count);
        own *= shares[c];
        direction *= shares[c];
        result.sum.col(c).segment(first, count) += steps[c] * direction;
        rest -= steps[c] * own;
        sums[c] = weights_.col(c).segment(first, count).dot(rest.cwiseAbs2());
      }
    });
    tellLeft(squares);
    result.changes.push_back(largest(residual));
  }
  lookAtRadius();
  return result;
}

double HostSweeps::jacobi(const Channels& r, Field& d) {
  Channels change = Channels::Zero(r.rows(), 3);
  forParts(system_.reflecting, [&](std::span<const size_t> patches, size_t) {
    std::array<Eigen::RowVector3d, kRowsAtOnce> sums;
    system_.gather(patches, d, sums.data());
    for (size_t k = 0; k < patches.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(patches[k]);
      change.row(i) = r.row(i) + system_.reflectance.row(i).cwiseProduct(sums[k]) - d.columns().row(i);
    }
  });
  d.add(change);
  return change.size() > 0 ? change.cwiseAbs().maxCoeff() : 0.0;
}

// In place. Rows of a block are gathered together, on all cores, from the values before the block; what changes within the
// block is then added in order: Gauss-Seidel up to rounding.
double HostSweeps::gaussSeidel(const Channels& r, Field& d) {
  double change = 0;
  std::array<Eigen::RowVector3d, kBlock> sums, changes;
  const std::span<const size_t> reflecting = system_.reflecting;
  for (size_t first = 0; first < reflecting.size(); first += kBlock) {
    const auto block = reflecting.subspan(first, std::min(kBlock, reflecting.size() - first));
    forParts(block, [&](std::span<const size_t> patches, size_t at) { system_.gather(patches, d, &sums[at]); });
    for (size_t k = 0; k < block.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(block[k]);
      forEachWithin(system_.factors()[block[k]], block.first(k + 1), [&](size_t l, double factor) {
        if (l < k) sums[k] += factor * changes[l];
      });
      const Eigen::RowVector3d next = r.row(i) + system_.reflectance.row(i).cwiseProduct(sums[k]);
      changes[k] = next - d.columns().row(i);
      change = std::max(change, changes[k].cwiseAbs().maxCoeff());
      d.set(i, next);
    }
  }
  return change;
}

Reflections HostSweeps::reflections(SolverKind kind, const Channels& r, size_t mostSweeps, const Goal& goal) {
  if (kind == SolverKind::conjugateResiduals) return conjugateResiduals(r, mostSweeps, goal);
  Field d(r);
  Reflections result{Channels::Zero(r.rows(), 3), {largest(r)}};
  double enough = goal(result.sum, 0), reflected = system_.bound * result.changes[0];  // at most
  for (bool more = result.changes.size() < mostSweeps; more;) {
    d.readIn(readingOf(reflected, (1 - system_.bound) * enough));
    result.changes.push_back(kind == SolverKind::gaussSeidel ? gaussSeidel(r, d) : jacobi(r, d));
    result.sum = d.columns() - r;
    reflected = largest(result.sum);
    enough = goal(result.sum, result.changes.size() - 1);
    more = sweepsMissing(result.changes, kWellBelow * enough) > 0 && result.changes.size() < mostSweeps;
  }
  return result;
}

}  // namespace farol
