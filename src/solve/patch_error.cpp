#include "solve/patch_error.h"

#include "solve/system.h"

#include <numeric>

namespace farol {
namespace {

// Means over joined patches, by exposed area.
class Joined {
 public:
  Joined(const FormFactorMatrix& f, const PatchSet& patches, std::span<const uint32_t> joined) : joined_(joined) {
    uint32_t count = 0;
    for (const uint32_t j : joined) count = std::max(count, j + 1);
    area_ = Eigen::VectorXd::Zero(count);
    for (size_t i = 0; i < joined.size(); ++i) {
      weight_.push_back(patches.patches[i].area * f.shares(i).exposed);
      area_[joined[i]] += weight_.back();
    }
  }
  Channels means(const Channels& values) const {
    Channels m = Channels::Zero(area_.size(), 3);
    for (size_t i = 0; i < joined_.size(); ++i) m.row(joined_[i]) += weight_[i] * values.row(static_cast<Eigen::Index>(i));
    for (Eigen::Index k = 0; k < area_.size(); ++k) m.row(k) /= std::max(area_[k], 1e-300);
    return m;
  }
  Channels spread(const Channels& means) const {
    Channels values(static_cast<Eigen::Index>(joined_.size()), 3);
    for (size_t i = 0; i < joined_.size(); ++i) values.row(static_cast<Eigen::Index>(i)) = means.row(joined_[i]);
    return values;
  }
  const Eigen::VectorXd& area() const { return area_; }

 private:
  std::span<const uint32_t> joined_;
  std::vector<double> weight_;
  Eigen::VectorXd area_;
};

}  // namespace

JoiningError joiningError(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Solution& solution,
                          std::span<const uint32_t> joined) {
  const auto n = static_cast<Eigen::Index>(patches.size());
  const System system(f, patches, direct, Rgb(0));
  const Joined groups(f, patches, joined);
  std::vector<size_t> all(patches.size());
  std::iota(all.begin(), all.end(), size_t{0});
  const auto gathered = [&](const Channels& b) {
    Channels h(n, 3);
    const Field field(b);
    forParts(all, [&](std::span<const size_t> part, size_t) {
      std::array<Eigen::RowVector3d, 16> sums;
      system.gather(part, field, sums.data());
      for (size_t k = 0; k < part.size(); ++k) h.row(static_cast<Eigen::Index>(part[k])) = sums[k];
    });
    return h;
  };
  Channels b(n, 3), h(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<size_t>(i);
    for (int c = 0; c < 3; ++c) {
      b(i, c) = solution.radiosity[k][c] - (direct.isApart(k) ? patches.patches[k].emission[c] : 0.0);
      h(i, c) = solution.irradiance[k][c];
    }
  }
  const Channels source = groups.means(gathered(b - groups.spread(groups.means(b))));
  // What is reflected of the change; the rest of the series by its ratio, which two reflections show as well as four (1 %).
  constexpr int kSweeps = 2;
  Channels change = source, term = source;
  double last = term.norm(), ratio = 0;
  for (int k = 0; k < kSweeps && last > 0; ++k) {
    term = groups.means(gathered(system.reflectance.cwiseProduct(groups.spread(term))));
    change += term;
    ratio = term.norm() / last;
    last = term.norm();
  }
  if (ratio < 1) change += term * (ratio / (1 - ratio));
  JoiningError result;
  const Channels mean = groups.means(h);
  const double area = groups.area().sum();
  for (int c = 0; c < 3; ++c) {
    const double squares = groups.area().dot(change.col(c).cwiseAbs2()), total = groups.area().dot(mean.col(c));
    if (total > 0) result.relative = std::max(result.relative, std::sqrt(squares / area) / (total / area));
  }
  for (Eigen::Index k = 0; k < change.rows(); ++k) result.change.push_back(change.row(k).norm() / std::sqrt(3.0));
  return result;
}

}  // namespace farol
