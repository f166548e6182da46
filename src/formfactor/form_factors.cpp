#include "formfactor/form_factors.h"

#include "base/error.h"
#include "formfactor/packing.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <numeric>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

double sumOf(std::span<const float> values) {
  constexpr size_t kLanes = 8;  // side by side, to hide the latency of additions
  std::array<double, kLanes> sums{};
  size_t k = 0;
  for (; k + kLanes <= values.size(); k += kLanes) {
    for (size_t l = 0; l < kLanes; ++l) sums[l] += static_cast<double>(values[k + l]);
  }
  for (; k < values.size(); ++k) sums[0] += static_cast<double>(values[k]);
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

// The dense row that this thread packed last. Freed and allocated anew, it would leave holes that packed rows fill, so that
// the next one finds no room: five times the memory of F.
thread_local std::vector<float> spareRow;

}  // namespace

void RowStore::entries(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values) {
  const std::span<float> to = row(patch);
  std::fill(to.begin(), to.end(), 0.0f);
  for (size_t k = 0; k < ids.size(); ++k) to[ids[k]] = values[k];
}

double FormFactorRow::at(size_t j) const {
  if (!dense.empty()) return static_cast<double>(dense[j]);
  if (!values.empty()) {
    const auto place = std::lower_bound(ids.begin(), ids.end(), j);
    if (place != ids.end() && *place == j) return static_cast<double>(values[static_cast<size_t>(place - ids.begin())]);
  }
  if (!steps.empty()) return steps[j] * static_cast<double>(weight);
  if (!values.empty()) return 0;
  return static_cast<double>(weight) * static_cast<double>(std::count(ids.begin(), ids.end(), j));
}

std::vector<float> FormFactorRow::expanded() const {
  std::vector<float> row(dense.begin(), dense.end());
  if (row.empty()) {
    row.resize(patches);
    for (size_t j = 0; j < steps.size(); ++j) row[j] = static_cast<float>(steps[j]) * weight;
    for (size_t k = 0; k < values.size(); ++k) row[ids[k]] = values[k];
    if (!values.empty() || !steps.empty()) return row;
    std::vector<uint32_t> counts(patches + 1, 0);
    for (const uint32_t j : ids) ++counts[j];
    for (size_t j = 0; j < patches; ++j) row[j] = static_cast<float>(counts[j]) * weight;
  }
  return row;
}

void FormFactorMatrix::addChannels() {
  maxBytes_ /= 3;
  while (others_.size() < 2) others_.emplace_back(rows_.size(), maxBytes_, storage_);
}

uint64_t FormFactorMatrix::bytes() const {
  uint64_t sum = bytes_;
  for (const FormFactorMatrix& other : others_) sum += other.bytes_;
  return sum;
}

void FormFactorMatrix::book(uint64_t rowBytes) {
  if ((std::atomic_ref(bytes_) += rowBytes) > maxBytes_) {
    throw Error(
        "form factors of {} patches do not fit: more than {} rows of {} bytes would exceed the {} bytes allowed; "
        "ask for fewer patches, or allow more with --memory",
        rows_.size(), maxBytes_ / rowBytes, rowBytes, maxBytes_);
  }
}

FormFactorMatrix::List FormFactorMatrix::listOf(std::vector<uint32_t> ids, std::vector<float> values) {
  const auto owner =
      std::make_shared<const std::pair<std::vector<uint32_t>, std::vector<float>>>(std::move(ids), std::move(values));
  return {owner->first, owner->second, owner};
}

std::span<float> FormFactorMatrix::row(uint32_t patch) {
  sums_[patch] = std::nan("");
  std::vector<float>& dense = rows_[patch].dense;
  if (dense.empty()) {
    book(rows_.size() * sizeof(float));
    if (spareRow.capacity() == rows_.size()) dense = std::move(spareRow);
    dense.assign(rows_.size(), 0.0f);
  }
  return dense;
}

void FormFactorMatrix::hits(uint32_t patch, std::span<const uint32_t> ids, float weight) {
  Row& row = rows_[patch];
  // A list costs a random access per hit where a dense row is read straight through: it must be much shorter.
  constexpr size_t kWorthAList = 4;
  if (kWorthAList * ids.size() > rows_.size()) {
    const std::span<float> to = this->row(patch);
    std::fill(to.begin(), to.end(), 0.0f);
    for (const uint32_t j : ids) {
      if (j < to.size()) ++to[j];
    }
    for (float& value : to) value *= weight;
    return;
  }
  if (row.list.ids.empty()) book(ids.size_bytes());
  row.list = listOf({ids.begin(), ids.end()}, {});
  row.weight = weight;
}

void FormFactorMatrix::finish(uint32_t patch, const RowShares& shares) {
  shares_[patch] = shares;
  if (!rows_[patch].dense.empty()) pack(rows_[patch]);
  sums_[patch] = sumOf(rows_[patch]);
}

void FormFactorMatrix::pack(Row& row) {
  const size_t n = row.dense.size();
  const size_t filled = n - static_cast<size_t>(std::count(row.dense.begin(), row.dense.end(), 0.0f));
  if (worthAList(filled)) {
    std::vector<uint32_t> ids;
    std::vector<float> values;
    ids.reserve(filled);
    values.reserve(filled);
    for (uint32_t j = 0; j < n; ++j) {
      if (row.dense[j] == 0) continue;
      ids.push_back(j);
      values.push_back(row.dense[j]);
    }
    row.list = listOf(std::move(ids), std::move(values));
  } else if (storage_ == Storage::bits16) {
    PackedRow packed = packRow(row.dense);
    row.steps = std::move(packed.steps);
    row.list = listOf(std::move(packed.ids), std::move(packed.values));
    row.weight = packed.step;
    row.packingError = static_cast<float>(packed.error);
  } else {
    return;
  }
  spareRow = std::move(row.dense);
  row.dense = {};
  const uint64_t bytes = row.steps.size() * sizeof(uint16_t) + row.list.ids.size() * (sizeof(uint32_t) + sizeof(float));
  std::atomic_ref(bytes_) -= n * sizeof(float) - bytes;
}

double FormFactorMatrix::packingError() const {
  double most = 0;
  for (const Row& r : rows_) most = std::max(most, static_cast<double>(r.packingError));
  return most;
}

// A list takes twice the bytes of dense entries, four times those of 16 bits, and a random access for each.
bool FormFactorMatrix::worthAList(size_t entries) const { return (storage_ == Storage::bits16 ? 3 : 2) * entries <= rows_.size(); }

void FormFactorMatrix::entries(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values) {
  if (worthAList(ids.size())) {
    book(ids.size_bytes() + values.size_bytes());
    rows_[patch].list = listOf({ids.begin(), ids.end()}, {values.begin(), values.end()});
    return;
  }
  RowStore::entries(patch, ids, values);
}

void FormFactorMatrix::borrow(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values,
                              std::shared_ptr<const void> owner) {
  book(ids.size_bytes() + values.size_bytes());
  rows_[patch].list = {ids, values, std::move(owner)};
}

void FormFactorMatrix::replace(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values) {
  Row& row = rows_[patch];
  const auto sizeOf = [](const auto& v) { return std::span(v).size_bytes(); };
  std::atomic_ref(bytes_) -= sizeOf(row.dense) + sizeOf(row.steps) + sizeOf(row.list.ids) + sizeOf(row.list.values);
  row = {};
  entries(patch, ids, values);
  sums_[patch] = sumOf(row);
}

double FormFactorMatrix::rowSum(size_t patch) const { return std::isnan(sums_[patch]) ? sumOf(rows_[patch]) : sums_[patch]; }

double FormFactorMatrix::sumOf(const Row& r) const {
  const std::span<const uint32_t> ids = r.list.ids;
  const std::span<const float> values = r.list.values;
  if (!values.empty() || !r.steps.empty()) {
    return static_cast<double>(r.weight) * static_cast<double>(std::accumulate(r.steps.begin(), r.steps.end(), uint64_t{0})) +
           farol::sumOf(values);
  }
  if (!r.dense.empty()) return farol::sumOf(r.dense);
  const auto nothing = static_cast<uint32_t>(rows_.size());
  return static_cast<double>(r.weight) *
         static_cast<double>(std::count_if(ids.begin(), ids.end(), [nothing](uint32_t j) { return j != nothing; }));
}

void FormFactorMatrix::keep(const std::vector<uint32_t>& patches) {
  for (FormFactorMatrix& other : others_) other.keep(patches);
  const auto nothing = static_cast<uint32_t>(patches.size());
  std::vector<uint32_t> renumbered(rows_.size() + 1, nothing);
  for (uint32_t k = 0; k < patches.size(); ++k) renumbered[patches[k]] = k;
  std::vector<Row> rows;
  std::vector<RowShares> shares;
  rows.reserve(patches.size());
  for (const uint32_t p : patches) {
    Row row;
    if (!rows_[p].dense.empty()) {
      row.dense.reserve(patches.size());
      for (const uint32_t q : patches) row.dense.push_back(rows_[p].dense[q]);
    }
    if (!rows_[p].steps.empty()) {
      row.steps.reserve(patches.size());
      for (const uint32_t q : patches) row.steps.push_back(rows_[p].steps[q]);
    }
    const List& list = rows_[p].list;
    std::vector<uint32_t> ids;
    std::vector<float> values;
    for (size_t k = 0; k < list.values.size(); ++k) {
      if (renumbered[list.ids[k]] == nothing) continue;
      ids.push_back(renumbered[list.ids[k]]);
      values.push_back(list.values[k]);
    }
    if (list.values.empty() && rows_[p].steps.empty()) {
      ids.assign(list.ids.begin(), list.ids.end());
      for (uint32_t& j : ids) j = renumbered[j];
    }
    if (!list.ids.empty()) row.list = listOf(std::move(ids), std::move(values));
    row.weight = rows_[p].weight;
    row.packingError = rows_[p].packingError;
    rows_[p] = {};
    rows.push_back(std::move(row));
    shares.push_back(shares_[p]);
  }
  rows_ = std::move(rows);
  shares_ = std::move(shares);
  sums_.clear();
  for (const Row& row : rows_) sums_.push_back(sumOf(row));
}

std::vector<uint32_t> makeFormFactors(RowMaker& maker, PatchSet& patches, bool sky, const Log& log, FormFactorMatrix& f) {
  std::vector<bool> active(patches.size(), false);
  std::vector<uint32_t> all, next;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    if (!patches.patches[i].back || patches.patches[i].emits() || sky) next.push_back(i);
  }
  Progress progress(log, "form factors", "rows", next.size());
  while (!next.empty()) {
    for (const uint32_t i : next) active[i] = true;
    const size_t before = all.size();
    std::vector<uint32_t> gathering = next;
    std::erase_if(gathering, [&](uint32_t i) { return patches.patches[i].passesAll(); });
    maker.makeRows(gathering, f, [&](size_t rows) { progress.update(before + rows); });
    all.insert(all.end(), next.begin(), next.end());
    if (all.size() == patches.size()) break;
    // Whatever the new rows see and nobody has asked for yet comes next.
    std::vector<uint32_t> found;
    for (const uint32_t i : next) {
      f[i].forEach([&](size_t j, double) {
        if (active[j]) return;
        active[j] = true;
        found.push_back(static_cast<uint32_t>(j));
      });
    }
    std::sort(found.begin(), found.end());
    progress.growTotal(found.size());
    next = std::move(found);
  }
  if (all.size() == patches.size()) return {};
  std::sort(all.begin(), all.end());
  f.keep(all);
  keepPatches(patches, all);
  return all;
}

namespace {

// All that takes pairs of patches: both directions of a pair side by side, for an even choice of patches.
void checkPairs(const FormFactorMatrix& f, const PatchSet& patches, FormFactorChecks& c) {
  constexpr size_t kMost = 512;
  const size_t n = f.size(), m = std::min(n, kMost);
  std::vector<uint32_t> chosen(m), placeOf(n, kNone);
  for (size_t k = 0; k < m; ++k) {
    chosen[k] = static_cast<uint32_t>(k * n / m);
    placeOf[chosen[k]] = static_cast<uint32_t>(k);
  }
  std::vector<double> block(m * m, 0.0);  // an entry may come in many parts: floats would not add up
  tbb::parallel_for(size_t{0}, m, [&](size_t k) {
    const FormFactorRow row = f[chosen[k]];
    if (!row.dense.empty()) {
      for (size_t l = 0; l < m; ++l) block[k * m + l] = static_cast<double>(row.dense[chosen[l]]);
    } else {
      row.forEach([&](size_t j, double value) {
        if (placeOf[j] != kNone) block[k * m + placeOf[j]] += value;
      });
    }
  });
  struct Part {
    double difference = 0, size = 0, smallest = 0, largest = 0, worstArea = 0;
    size_t worst = 0;
  };
  std::vector<Part> parts(m);
  const auto areaOf = [&](size_t k) { return patches.patches[chosen[k]].area * f.shares(chosen[k]).exposed; };
  std::vector<double> area(m);
  for (size_t k = 0; k < m; ++k) area[k] = areaOf(k);
  tbb::parallel_for(size_t{0}, m, [&](size_t k) {
    if (!f[chosen[k]].made()) return;
    Part& part = parts[k];
    for (size_t l = 0; l < m; ++l) {
      if (!f[chosen[l]].made()) continue;
      const double value = block[k * m + l];
      const double kl = area[k] * value, lk = area[l] * block[l * m + k];
      part.difference += (kl - lk) * (kl - lk);
      part.size += kl * kl;
      if (patches.patches[chosen[k]].isSpecular() || patches.patches[chosen[l]].isSpecular()) continue;
      part.smallest = std::min(part.smallest, value);
      part.largest = std::max(part.largest, value);
      const double bound = std::min(area[k], area[l]);
      if (kl > part.worstArea * bound && bound > 0) {
        part.worstArea = kl / bound;
        part.worst = l;
      }
    }
  });
  double difference = 0, size = 0;
  for (size_t k = 0; k < m; ++k) {
    difference += parts[k].difference;
    size += parts[k].size;
    c.smallest = std::min(c.smallest, parts[k].smallest);
    c.largest = std::max(c.largest, parts[k].largest);
    if (parts[k].worstArea > c.worstArea) {
      c.worstArea = parts[k].worstArea;
      c.worstFrom = chosen[k];
      c.worstTo = chosen[parts[k].worst];
    }
  }
  c.pairPatches = m;
  if (size > 0) c.reciprocityRms = std::sqrt(difference / size);
}

}  // namespace

FormFactorChecks checkFormFactors(const FormFactorMatrix& f, const PatchSet& patches) {
  FormFactorChecks c;
  const size_t n = f.size();
  std::vector<double> sums(n);
  tbb::parallel_for(size_t{0}, n, [&](size_t i) { sums[i] = f.rowSum(i); });
  c.rowSumMin = 1e300;
  c.rowSumMax = -1e300;
  double area = 0, exposedArea = 0;
  for (size_t i = 0; i < n; ++i) {
    const RowShares& s = f.shares(i);
    const double a = patches.patches[i].area * s.exposed;
    area += patches.patches[i].area;
    exposedArea += a;
    c.missed += a * s.missed;
    c.backs += a * s.backs;
    c.cut += a * s.cut;
    c.absorbed += a * s.absorbed;
    c.specular += a * s.specular;
    c.rowSumMean += a * sums[i];
    c.correctionMin = std::min(c.correctionMin, s.correction);
    c.correctionMax = std::max(c.correctionMax, s.correction);
    if (s.exposed > 0 && !patches.patches[i].passesAll()) {
      c.rowSumMin = std::min(c.rowSumMin, sums[i]);
      c.rowSumMax = std::max(c.rowSumMax, sums[i]);
    }
  }
  if (exposedArea > 0) {
    c.missed /= exposedArea;
    for (double* share : {&c.backs, &c.cut, &c.absorbed, &c.specular}) *share /= exposedArea;
    c.rowSumMean /= exposedArea;
  } else {
    c.rowSumMin = c.rowSumMax = 0;
  }
  c.covered = area > 0 ? 1 - exposedArea / area : 0;
  checkPairs(f, patches, c);
  return c;
}

}  // namespace farol
