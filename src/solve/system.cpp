#include "solve/system.h"

#include "solve/gather.h"

#include <array>
#include <tbb/parallel_for.h>

namespace farol {

Field::Field(Channels values, Reading reading) : columns_(std::move(values)), reading_(reading) { pack(); }

void Field::assign(const Channels& values, Reading reading) {
  columns_ = values;
  reading_ = reading;
  pack();
}

void Field::set(Eigen::Index i, const Eigen::RowVector3d& value) {
  columns_.row(i) = value;
  if (alike_ && !(value[0] == value[1] && value[0] == value[2]))
    pack();
  else
    pack(i);
}

void Field::add(const Channels& change) {
  columns_ += change;
  pack();
}

void Field::readIn(Reading reading) {
  if (reading == reading_) return;
  reading_ = reading;
  pack();
}

void Field::pack() {
  alike_ = columns_.col(0) == columns_.col(1) && columns_.col(0) == columns_.col(2);
  const size_t channels = alike_ ? 1 : 3, numbers = (alike_ ? 1 : 4) * (static_cast<size_t>(columns_.rows()) + 1);
  if (reading_ == Reading::inDouble) {
    packed_.assign(numbers, 0.0);
  } else {
    const double most = largest(columns_);
    scale_ = most > 0 && std::isfinite(most) ? std::exp2(std::ilogb(most)) : 1.0;
    packedFloats_.assign(numbers, 0.0F);
    floats_.resize(channels * static_cast<size_t>(columns_.rows()));
  }
  for (Eigen::Index i = 0; i < columns_.rows(); ++i) pack(i);
}

void Field::pack(Eigen::Index i) {
  const size_t channels = alike_ ? 1 : 3, stride = alike_ ? 1 : 4;
  const auto k = static_cast<size_t>(i), n = static_cast<size_t>(columns_.rows());
  for (size_t c = 0; c < channels; ++c) {
    const double value = columns_.data()[c * n + k];
    if (reading_ == Reading::inDouble)
      packed_[stride * k + c] = value;
    else
      packedFloats_[stride * k + c] = floats_[c * n + k] = static_cast<float>(value / scale_);
  }
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

std::optional<Rgb> System::makeOneColour() {
  constexpr double kRounding = 1e-13;
  if (reflectance.col(0) != reflectance.col(1) || reflectance.col(0) != reflectance.col(2)) return std::nullopt;
  const Eigen::RowVector3d light = emission.colwise().sum() + source.colwise().sum();
  Eigen::Index brightest = 0;
  if (light.maxCoeff(&brightest) <= 0) return std::nullopt;
  const Eigen::RowVector3d tint = light / light[brightest];
  for (Channels* field : {&emission, &source}) {
    const Eigen::VectorXd given = field->col(brightest);
    if ((*field - given * tint).cwiseAbs().maxCoeff() > kRounding * given.cwiseAbs().maxCoeff()) return std::nullopt;
  }
  for (Channels* field : {&emission, &source}) *field = Eigen::VectorXd(field->col(brightest)).replicate(1, 3);
  return Rgb(tint[0], tint[1], tint[2]);
}

namespace {

// Rows of one kind among some, and where each belongs.
template <typename Row>
struct Kind {
  std::array<Row, kRowsAtOnce> rows;
  std::array<size_t, kRowsAtOnce> places;
  size_t count = 0;

  void add(size_t place, const Row& row) {
    places[count] = place;
    rows[count++] = row;
  }
  std::span<const Row> all() const { return std::span(rows).first(count); }
};

template <size_t Count>
void gatherChannels(const FormFactorMatrix& f, std::span<const size_t> patches, const Field& b, Eigen::RowVector3d* sums) {
  Kind<const float*> dense;
  Kind<const uint16_t*> packed;
  Kind<ListRow> entries, hits;  // entries also beside packed rows
  for (size_t k = 0; k < patches.size(); ++k) {
    const FormFactorRow row = f[patches[k]];
    const ListRow list{row.ids.data(), row.values.data(), row.ids.size()};
    sums[k].setZero();
    if (!row.dense.empty())
      dense.add(k, row.dense.data());
    else if (!row.steps.empty())
      packed.add(k, row.steps.data());
    if (!row.values.empty())
      entries.add(k, list);
    else if (!row.ids.empty())
      hits.add(k, list);
  }
  double found[kRowsAtOnce][Count];
  const auto put = [&](const auto& kind, const auto& weightOf) {
    for (size_t k = 0; k < kind.count; ++k) {
      const double weight = weightOf(patches[kind.places[k]]);
      for (size_t c = 0; c < 3; ++c) sums[kind.places[k]][static_cast<Eigen::Index>(c)] += weight * found[k][c % Count];
    }
  };
  const auto own = [&](size_t i) { return static_cast<double>(f[i].weight); };
  b.read([&](const auto& read) {
    const auto one = [&](size_t) { return read.scale; };
    const auto each = [&](size_t i) { return read.scale * own(i); };
    if (dense.count > 0) gatherRows(dense.all(), read.columns, f.size(), found);
    put(dense, one);
    if (packed.count > 0) gatherRows(packed.all(), read.columns, f.size(), found);
    put(packed, each);
    gatherLists<Count, true>(entries.all(), read.packed, found);
    put(entries, one);
    gatherLists<Count, false>(hits.all(), read.packed, found);
    put(hits, each);
  });
}

}  // namespace

void gather(const FormFactorMatrix& f, std::span<const size_t> patches, const Field& b, Eigen::RowVector3d* sums) {
  if (b.alike())
    gatherChannels<1>(f, patches, b, sums);
  else
    gatherChannels<3>(f, patches, b, sums);
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
