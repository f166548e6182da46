#include "solve/irradiance_error.h"

#include "formfactor/neighbourhood.h"
#include "solve/gather.h"
#include "solve/system.h"

#include <Eigen/Dense>
#include <array>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr size_t kGroups = 96;  // of patches whose errors are carried on
constexpr size_t kSmooth = 4;   // neighbours on each side whose laws are taken together

Channels columnsOf(const std::vector<Rgb>& values) {
  Channels columns(static_cast<Eigen::Index>(values.size()), 3);
  for (size_t i = 0; i < values.size(); ++i) columns.row(static_cast<Eigen::Index>(i)) << values[i].r, values[i].g, values[i].b;
  return columns;
}

// Radiosity that F carries: without the emission of emitters apart.
std::vector<Rgb> carried(const PatchSet& patches, const DirectLight& direct, const Solution& s) {
  std::vector<Rgb> r = s.radiosity;
  for (size_t j = 0; j < r.size(); ++j) {
    if (direct.isApart(j)) r[j] -= patches.patches[j].emission;
  }
  return r;
}

// Variance of one sample of what each row gathers, per channel, around what was gathered: the irradiance without direct light. (Of
// channels with an F of their own it holds for that which f is of.) Made for one patch of three, which its neighbours share: three
// are left where laws are smoothed.
std::vector<Rgb> sampleVariance(const FormFactorMatrix& f, const DirectLight& direct, const Solution& solution,
                                const std::vector<Rgb>& r, const Rgb& sky, const Neighbourhood& near) {
  constexpr size_t kShare = 3;
  const std::span<const uint32_t> order = near.order();
  const auto makerOf = [&](size_t k) { return order[std::min(k / kShare * kShare + kShare / 2, order.size() - 1)]; };
  std::vector<size_t> rows;
  for (size_t k = 0; k < order.size(); k += kShare) rows.push_back(makerOf(k));
  std::vector<Rgb> variance(r.size());
  const Field field(columnsOf(r).cwiseAbs2(), Reading::inFloat);
  forParts(rows, [&](std::span<const size_t> part, size_t) {
    std::array<Eigen::RowVector3d, kRowsAtOnce> sums;
    gather(f, part, field, sums.data());
    for (size_t k = 0; k < part.size(); ++k) {
      const size_t i = part[k];
      const Rgb mean = solution.irradiance[i] - (direct.present() ? direct.irradiance[i] : Rgb(0));
      const Rgb square = f.shares(i).missed * sky * sky + Rgb(sums[k][0], sums[k][1], sums[k][2]);
      variance[i] = glm::max(square - mean * mean, Rgb(0));
    }
  });
  for (size_t k = 0; k < order.size(); ++k) variance[order[k]] = variance[makerOf(k)];
  return variance;
}

// Adds what errors of other rows bring: sum_h M_gh^2 v_h + (sum_h M_gh b_h)^2 with M = (I - F rho)^-1 - I, between
// groups of neighbours; v is the variance of a group's mean, where rows err independently, and b the mean of what its
// replicates show that all rows have in common (`bias`, one per probe; zero for unbiased rows). A group's row of F is
// that of its replicated patches.
void carryOn(const FormFactorMatrix& f, const PatchSet& patches, const Neighbourhood& near, std::span<const uint32_t> probes,
             std::span<const Rgb> bias, std::vector<Rgb>& variance) {
  const std::vector<uint32_t> groupOf = near.groups(kGroups);
  const auto n = static_cast<Eigen::Index>(1 + *std::max_element(groupOf.begin(), groupOf.end()));
  std::vector<Rgb> reflectance(patches.size());  // by themselves, for the loop below to find in the cache
  for (size_t i = 0; i < reflectance.size(); ++i) reflectance[i] = patches.patches[i].reflectance;
  std::vector<std::vector<Rgb>> reflected(probes.size(), std::vector<Rgb>(static_cast<size_t>(n), Rgb(0)));  // F rho, by group
  tbb::parallel_for(size_t{0}, probes.size(), [&](size_t k) {
    f[probes[k]].forEach([&](size_t j, double value) { reflected[k][groupOf[j]] += value * reflectance[j]; });
  });
  tbb::parallel_for(0, 3, [&](int c) {
    Eigen::VectorXd area = Eigen::VectorXd::Zero(n), v = area, rows = area, b = area;
    for (size_t i = 0; i < groupOf.size(); ++i) {
      const double a = patches.patches[i].area;
      area[groupOf[i]] += a;
      v[groupOf[i]] += a * a * variance[i][c];
    }
    if (v.maxCoeff() <= 0) return;
    v = v.cwiseQuotient(area.cwiseAbs2());
    Eigen::MatrixXd m = Eigen::MatrixXd::Zero(n, n);
    for (size_t k = 0; k < probes.size(); ++k) {
      const auto g = static_cast<Eigen::Index>(groupOf[probes[k]]);
      ++rows[g];
      b[g] += bias[k][c];
      for (Eigen::Index h = 0; h < n; ++h) m(g, h) += reflected[k][static_cast<size_t>(h)][c];
    }
    const Eigen::VectorXd share = rows.cwiseMax(1.0).cwiseInverse();
    m = Eigen::MatrixXd::Identity(n, n) - share.asDiagonal() * m;
    const Eigen::MatrixXd carried = m.partialPivLu().inverse() - Eigen::MatrixXd::Identity(n, n);
    const Eigen::VectorXd more = carried.cwiseAbs2() * v + (carried * share.cwiseProduct(b)).cwiseAbs2();
    for (size_t i = 0; i < groupOf.size(); ++i) variance[i][c] += more[groupOf[i]];
  });
}

// Variances from the squares that the nearest replicates show: three parts in the proportions of the law smoothed over
// neighbours, one part as they are, since no law knows of everything. One standard deviation of such an estimate is
// added, 1 / sqrt(2 m) for m replicates. A patch of which little is exposed has as many samples less: neighbours must not
// take its error for theirs.
std::vector<double> scaled(const Neighbourhood& near, const std::vector<double>& law, std::span<const uint32_t> probes,
                           const std::vector<double>& squares, const std::vector<double>& exposed) {
  constexpr size_t kWindow = 24;
  constexpr double kLaw = 0.75;
  const std::vector<double> smooth = near.smoothed(law, kSmooth);
  std::vector<double> result(law.size(), 0.0);
  near.forEachWindow(probes, kWindow, [&](uint32_t i, std::span<const uint32_t> window) {
    if (window.empty()) return;
    double found = 0, expected = 0;
    for (const uint32_t p : window) {
      found += squares[p] * exposed[probes[p]];
      expected += smooth[probes[p]];
    }
    const auto count = static_cast<double>(window.size());
    const double mean = found / count, byLaw = expected > 0 ? smooth[i] * found / expected : mean;
    const double above = 1 + 1 / std::sqrt(2 * count);
    result[i] = above * above * (kLaw * byLaw + (1 - kLaw) * mean) / exposed[i];
  });
  return result;
}

}  // namespace

std::vector<Rgb> irradianceError(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct,
                                 const Solution& solution, const Replicates& replicates, double samples, const Rgb& sky) {
  const size_t n = patches.size(), probes = replicates.patches.size();
  const std::vector<Rgb> r = carried(patches, direct, solution);
  const Neighbourhood near(patches);
  std::vector<Rgb> variance(n, Rgb(0));
  constexpr double kLeastExposed = 1e-3;
  std::vector<double> exposed(n);
  for (size_t i = 0; i < n; ++i) exposed[i] = std::max(f.shares(i).exposed, kLeastExposed);
  std::vector<Rgb> bias(probes, Rgb(0)), found(probes);
  if (replicates.rows) {
    variance = sampleVariance(f, direct, solution, r, sky, near);
    for (Rgb& v : variance) v /= samples;
    const Field field(columnsOf(r));
    const std::vector<size_t> rows(replicates.patches.begin(), replicates.patches.end());
    forParts(rows, [&](std::span<const size_t> part, size_t at) {
      std::array<Eigen::RowVector3d, kRowsAtOnce> own, again;
      gather(f, part, field, own.data());
      gather(*replicates.rows, part, field, again.data());
      for (size_t k = 0; k < part.size(); ++k) {
        const Eigen::RowVector3d carries = own[k] - again[k];
        const Rgb change =
            (f.shares(part[k]).missed - replicates.rows->shares(part[k]).missed) * sky + Rgb(carries[0], carries[1], carries[2]);
        found[at + k] = (replicates.better ? 1.0 : 0.5) * change * change;
        if (replicates.better) bias[at + k] = change;
      }
    });
    tbb::parallel_for(0, 3, [&](int c) {
      std::vector<double> law(n), squares(probes);
      for (size_t i = 0; i < n; ++i) law[i] = variance[i][c];
      for (size_t k = 0; k < probes; ++k) squares[k] = found[k][c];
      const std::vector<double> own = scaled(near, law, replicates.patches, squares, exposed);
      for (size_t i = 0; i < n; ++i) variance[i][c] = own[i];
    });
  }
  if (!direct.deviation.empty()) {
    constexpr size_t kHalf = 4;  // nine patches, each of three differences
    tbb::parallel_for(0, 3, [&](int c) {
      std::vector<double> law(n);
      for (size_t i = 0; i < n; ++i) law[i] = direct.deviation[i][c] * direct.deviation[i][c] * exposed[i];
      const std::vector<double> own = near.smoothed(law, kHalf);
      for (size_t i = 0; i < n; ++i) variance[i][c] += own[i] / exposed[i];
    });
  }
  carryOn(f, patches, near, replicates.patches, bias, variance);
  double total = 0, area = 0;
  for (size_t i = 0; i < n; ++i) {
    total += patches.patches[i].area * maxChannel(r[i]);
    area += patches.patches[i].area;
  }
  const double solver = area > 0 ? solution.error * total / area : 0;
  std::vector<Rgb> error(n);
  for (size_t i = 0; i < n; ++i) error[i] = glm::sqrt(variance[i] + solver * solver);
  return error;
}

}  // namespace farol
