#include "solve/irradiance_error.h"

#include <Eigen/Dense>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr size_t kSmallScene = 256;  // patches

// Radiosity that F carries: without the emission of emitters apart.
std::vector<Rgb> carried(const PatchSet& patches, const DirectLight& direct, const Solution& s) {
  std::vector<Rgb> r = s.radiosity;
  for (size_t j = 0; j < r.size(); ++j) {
    if (direct.isApart(j)) r[j] -= patches.patches[j].emission;
  }
  return r;
}

// Variance of one sample of what row i gathers, per channel.
Rgb sampleVariance(const FormFactorMatrix& f, size_t i, const std::vector<Rgb>& r, const Rgb& sky) {
  const double missed = f.shares(i).missed;
  Rgb mean = missed * sky, square = missed * sky * sky;
  f[i].forEach([&](size_t j, double value) {
    mean += value * r[j];
    square += value * (r[j] * r[j]);
  });
  return glm::max(square - mean * mean, Rgb(0));
}

// Variances of all H from those of single rows: v_i = sum_k G_ik^2 s_k, G = (I - F rho)^-1.
void carryOn(const FormFactorMatrix& f, const PatchSet& patches, std::vector<Rgb>& variance) {
  const auto n = static_cast<Eigen::Index>(patches.size());
  for (int c = 0; c < 3; ++c) {
    Eigen::MatrixXd m = Eigen::MatrixXd::Identity(n, n);
    Eigen::VectorXd s(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      s[i] = variance[static_cast<size_t>(i)][c];
      f[static_cast<size_t>(i)].forEach([&](size_t j, double value) {
        m(i, static_cast<Eigen::Index>(j)) -= value * patches.patches[j].reflectance[c];
      });
    }
    const Eigen::MatrixXd g = m.partialPivLu().inverse();
    const Eigen::VectorXd v = g.cwiseAbs2() * s;
    for (Eigen::Index i = 0; i < n; ++i) variance[static_cast<size_t>(i)][c] = v[i];
  }
}

}  // namespace

std::vector<double> irradianceError(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct,
                                    const Solution& solution, const ProbeRows& probes, double samples,
                                    const IrradianceErrorOptions& options) {
  const size_t n = patches.size();
  const std::vector<Rgb> r = carried(patches, direct, solution);
  std::vector<Rgb> variance(n, Rgb(0));
  tbb::parallel_for(size_t{0}, n, [&](size_t i) { variance[i] = sampleVariance(f, i, r, options.sky) / samples; });

  // What the probes' rows gather against their references tells the factor.
  double squares = 0, law = 0;
  for (size_t k = 0; k < probes.times(); ++k) {
    for (const uint32_t p : probes.patches) {
      if (f.shares(p).exposed <= 0) continue;
      const std::vector<double> d = probes.error(f, k, p);
      Rgb change = (probes.made(f, k).shares(p).missed - probes.reference[0].shares(p).missed) * options.sky;
      for (size_t j = 0; j < n; ++j) change += d[j] * r[j];
      for (int c = 0; c < 3; ++c) {
        squares += change[c] * change[c];
        law += variance[p][c];
      }
    }
  }
  const double factor = law > 0 ? squares / law : 0;
  std::vector<double> error(n);
  double total = 0, area = 0;
  for (size_t i = 0; i < n; ++i) {
    variance[i] *= factor;
    if (direct.present()) variance[i] += std::pow(options.direct * direct.deviation[i], 2);
    total += patches.patches[i].area * maxChannel(r[i]);
    area += patches.patches[i].area;
  }
  if (n <= kSmallScene) carryOn(f, patches, variance);
  const double solver = area > 0 ? solution.error * total / area : 0;
  for (size_t i = 0; i < n; ++i) error[i] = std::sqrt(maxChannel(variance[i]) + solver * solver);
  return error;
}

}  // namespace farol
