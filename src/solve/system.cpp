#include "solve/system.h"

#include "solve/gather.h"

#include <array>
#include <tbb/parallel_for.h>

namespace farol {

Field::Field(Channels values)
    : columns_(std::move(values)), packed_(4 * (static_cast<size_t>(columns_.rows()) + 1), 0.0) {
  for (Eigen::Index i = 0; i < columns_.rows(); ++i) pack(i);
}

void Field::add(const Channels& change) {
  columns_ += change;
  for (Eigen::Index i = 0; i < columns_.rows(); ++i) pack(i);
}

void forParts(std::span<const size_t> patches, const std::function<void(std::span<const size_t>, size_t)>& use) {
  tbb::parallel_for(size_t{0}, (patches.size() + kRowsAtOnce - 1) / kRowsAtOnce, [&](size_t part) {
    const size_t at = part * kRowsAtOnce;
    use(patches.subspan(at, std::min(kRowsAtOnce, patches.size() - at)), at);
  });
}

System::System(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Rgb& sky) : f_(f) {
  const auto n = static_cast<Eigen::Index>(patches.size());
  emission = Channels::Zero(n, 3);
  reflectance = Channels::Zero(n, 3);
  source = Channels::Zero(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<size_t>(i);
    const Patch& p = patches.patches[k];
    const RowShares& shares = f.shares(k);
    for (int c = 0; c < 3; ++c) {
      emission(i, c) = direct.isApart(k) ? 0.0 : p.emission[c];
      reflectance(i, c) = p.reflectance[c];
      source(i, c) = shares.missed * sky[c];  // irradiance from the sky
      if (direct.present()) source(i, c) += direct.irradiance[k][c];
    }
    if (maxChannel(p.reflectance) > 0) reflecting.push_back(k);
  }
  std::vector<double> norms(reflecting.size());
  const bool specular = patches.anySpecular();
  tbb::parallel_for(size_t{0}, norms.size(), [&](size_t k) {
    const Patch& p = patches.patches[reflecting[k]];
    if (!specular) {
      norms[k] = maxChannel(p.reflectance) * f.rowSum(reflecting[k]);
      return;
    }
    // What ends at a patch is what is not passed on: with entries above 1 towards mirrors, that is what must not grow.
    Rgb ends(0);
    f[reflecting[k]].forEach([&](size_t j, double value) { ends += value * (Rgb(1) - patches.patches[j].specular()); });
    norms[k] = maxChannel(p.reflectance * ends / glm::max(Rgb(1) - p.specular(), Rgb(1e-12)));
  });
  for (size_t k = 0; k < norms.size(); ++k) {
    if (norms[k] > bound) worstRow = reflecting[k];
    bound = std::max(bound, norms[k]);
  }
}

void System::gather(std::span<const size_t> patches, const Field& b, Eigen::RowVector3d* sums) const {
  std::array<const float*, kRowsAtOnce> dense;
  std::array<const uint16_t*, kRowsAtOnce> packed;
  std::array<size_t, kRowsAtOnce> densePlaces, packedPlaces;
  size_t denseCount = 0, packedCount = 0;
  for (size_t k = 0; k < patches.size(); ++k) {
    const FormFactorRow row = f_[patches[k]];
    sums[k].setZero();
    if (!row.dense.empty()) {
      densePlaces[denseCount] = k;
      dense[denseCount++] = row.dense.data();
    } else if (!row.steps.empty()) {
      packedPlaces[packedCount] = k;
      packed[packedCount++] = row.steps.data();
    } else if (!row.values.empty()) {
      gatherEntries(row.ids, row.values, b.packed(), sums[k].data());
    } else if (!row.ids.empty()) {
      gatherHits(row.ids, static_cast<double>(row.weight), b.packed(), sums[k].data());
    }
  }
  double found[kRowsAtOnce][3];
  if (denseCount > 0) gatherRows(std::span(dense).first(denseCount), b.columns().data(), f_.size(), found);
  for (size_t k = 0; k < denseCount; ++k) sums[densePlaces[k]] = Eigen::Map<Eigen::RowVector3d>(found[k]);
  if (packedCount > 0) gatherRows(std::span(packed).first(packedCount), b.columns().data(), f_.size(), found);
  for (size_t k = 0; k < packedCount; ++k) {
    const FormFactorRow row = f_[patches[packedPlaces[k]]];
    Eigen::RowVector3d listed;
    gatherEntries(row.ids, row.values, b.packed(), listed.data());
    sums[packedPlaces[k]] = static_cast<double>(row.weight) * Eigen::Map<Eigen::RowVector3d>(found[k]) + listed;
  }
}

template <typename Use>
void System::gatherAll(const Field& b, Use&& use) const {
  forParts(reflecting, [&](std::span<const size_t> patches, size_t) {
    std::array<Eigen::RowVector3d, kRowsAtOnce> sums;
    gather(patches, b, sums.data());
    for (size_t k = 0; k < patches.size(); ++k) use(static_cast<Eigen::Index>(patches[k]), sums[k]);
  });
}

Channels System::residualOf(const Field& b, Channels& gathered) const {
  Channels r = Channels::Zero(b.columns().rows(), 3);
  gatherAll(b, [&](Eigen::Index i, const Eigen::RowVector3d& sum) {
    gathered.row(i) = sum;
    r.row(i) = updated(i, sum) - b.columns().row(i);
  });
  return r;
}

Channels System::reflectOnce(const Field& v) const {
  Channels out = Channels::Zero(v.columns().rows(), 3);
  gatherAll(v, [&](Eigen::Index i, const Eigen::RowVector3d& sum) { out.row(i) = reflectance.row(i).cwiseProduct(sum); });
  return out;
}

double sweepsMissing(std::span<const double> changes, double target) {
  constexpr size_t kWhile = 8;
  const size_t n = changes.size();
  const double last = changes[n - 1], before = n > 1 ? changes[n - 2] : last;
  if (!std::isfinite(last) || last == 0 || (n > kWhile && last >= changes[n - 1 - kWhile])) return 0;
  const double factor = last / before;
  if (factor >= 1) return 1;
  const double left = last * factor / (1 - factor);
  return left > target ? std::ceil(std::log(target / left) / std::log(factor)) : 0;
}

Contraction contractionOn(const System& s, const PatchSet& patches, const Channels& r) {
  const double size = largest(r);
  if (size == 0) return {};
  const Channels next = s.reflectOnce(Field(r));
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

}  // namespace farol
