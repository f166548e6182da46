// Form factors F_ij: the share of the diffuse power leaving patch i that reaches patch j. Row i belongs to
// the gathering patch i: H_i = sum_j F_ij B_j. A_i F_ij = A_j F_ji.
#pragma once

#include "base/log.h"
#include "patch/patches.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace farol {

// What became of a row besides its entries. missed + backs + cut + absorbed + sum_j F_ij (1 - s_j - t_j) = 1 for an exposed
// patch, with the mirror and transmission shares s and t of what it meets.
struct RowShares {
  double missed = 0;      // share that saw nothing: it leaves the scene
  double backs = 0;       // share that met black back sides
  double exposed = 1;     // share of the patch's area on which nothing stands; 0: the row is empty
  double correction = 1;  // factor by which the near-field correction scaled the far entries, or near ones (near_field.h)
  double cut = 0;         // share that was not followed to its end among mirrors and glass
  double absorbed = 0;    // share that solids took on the way
  double specular = 0;    // share that met a mirror or glass first
};

// Receives finished rows, possibly from several threads, each row once, as `row`, `hits` or `entries`.
class RowStore {
 public:
  virtual ~RowStore() = default;
  virtual std::span<float> row(uint32_t patch) = 0;  // [patches], to be filled completely
  // The row as a list: each id adds `weight` to its entry; the id [patches] adds nothing.
  virtual void hits(uint32_t patch, std::span<const uint32_t> ids, float weight) = 0;
  // The row from its entries, ids ascending.
  virtual void entries(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values);
  virtual void finish(uint32_t patch, const RowShares& shares) = 0;
  // Where rows go whose factors are those of green (1) or blue (2), when coloured mirrors make them differ; null: the
  // channels are alike.
  virtual RowStore* channel(int /*c*/) { return nullptr; }
};

// One row as it is kept: dense; a list of ids that each add `weight` to their entry; a list of ids, ascending, with
// their entries; or in 16 bits: steps of `weight`, and such a list of the largest entries beside them (packing.h).
struct FormFactorRow {
  std::span<const float> dense;     // [patches]
  std::span<const uint16_t> steps;  // [patches]
  std::span<const uint32_t> ids;
  std::span<const float> values;  // [ids], or empty: `weight` each
  float weight = 0;
  size_t patches = 0;

  bool made() const { return !dense.empty() || !steps.empty() || !ids.empty(); }

  // Calls `use(j, value)` for parts of entries that are not 0: an entry of a list may come in several parts.
  template <typename Use>
  void forEach(Use&& use) const {
    for (size_t j = 0; j < dense.size(); ++j) {
      if (dense[j] != 0) use(j, static_cast<double>(dense[j]));
    }
    for (size_t j = 0; j < steps.size(); ++j) {
      if (steps[j] != 0) use(j, steps[j] * static_cast<double>(weight));
    }
    for (size_t k = 0; k < ids.size(); ++k) {
      if (ids[k] < patches) use(size_t{ids[k]}, static_cast<double>(values.empty() ? weight : values[k]));
    }
  }

  double at(size_t j) const;            // one entry; slow on lists
  std::vector<float> expanded() const;  // [patches]; zeros for a row that was not made
};

enum class Storage { float32, bits16 };  // of dense rows

// F [rows x columns], a row dense or, where less than half of it is filled (with 16 bits: a third), as a list; rows are allocated
// when first asked for, and packed when finished. Throws Error when they would need more than `maxBytes`.
class FormFactorMatrix : public RowStore {
 public:
  explicit FormFactorMatrix(size_t patches, uint64_t maxBytes = UINT64_MAX, Storage storage = Storage::float32)
      : maxBytes_(maxBytes), storage_(storage), rows_(patches), shares_(patches), sums_(patches, std::nan("")) {}

  std::span<float> row(uint32_t patch) override;
  void hits(uint32_t patch, std::span<const uint32_t> ids, float weight) override;
  void entries(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values) override;
  void finish(uint32_t patch, const RowShares& shares) override;

  // Where coloured mirrors or glass make F depend on the channel, this is red's and green and blue have their own beside.
  void addChannels();
  bool coloured() const { return !others_.empty(); }
  const FormFactorMatrix& ofChannel(int c) const { return c == 0 || others_.empty() ? *this : others_[static_cast<size_t>(c - 1)]; }
  FormFactorMatrix& ofChannel(int c) { return c == 0 || others_.empty() ? *this : others_[static_cast<size_t>(c - 1)]; }
  RowStore* channel(int c) override { return others_.empty() ? nullptr : &ofChannel(c); }

  // The same without a copy: `owner` keeps what the spans show.
  void borrow(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values, std::shared_ptr<const void> owner);
  // Whether entries are kept as a list, and not in a dense row.
  bool worthAList(size_t entries) const;
  // The same for a row that was made: its shares stay. Not packed.
  void replace(uint32_t patch, std::span<const uint32_t> ids, std::span<const float> values);

  size_t size() const { return rows_.size(); }
  FormFactorRow operator[](size_t patch) const {
    const Row& r = rows_[patch];
    return {r.dense, r.steps, r.list.ids, r.list.values, r.weight, rows_.size()};
  }
  const RowShares& shares(size_t patch) const { return shares_[patch]; }
  double rowSum(size_t patch) const;                        // in double; 0 for a row that was not made
  uint64_t bytes() const;                                   // of all channels
  size_t denseRows() const { return count(&Row::dense); }   // in float32
  size_t packedRows() const { return count(&Row::steps); }  // in 16 bits
  double packingError() const;                              // L1 error that 16 bits added to a row, at most

  // Keeps the rows and columns of these patches, in this order.
  void keep(const std::vector<uint32_t>& patches);

 private:
  struct List {  // never changed, so that copies share it
    std::span<const uint32_t> ids;
    std::span<const float> values;
    std::shared_ptr<const void> owner;
  };
  static List listOf(std::vector<uint32_t> ids, std::vector<float> values);
  struct Row {
    std::vector<float> dense;
    std::vector<uint16_t> steps;
    List list;
    float weight = 0;
    float packingError = 0;
  };
  void book(uint64_t bytes);
  void pack(Row& row);
  double sumOf(const Row& row) const;
  template <typename Member>
  size_t count(Member member) const {
    return static_cast<size_t>(std::count_if(rows_.begin(), rows_.end(), [&](const Row& r) { return !(r.*member).empty(); }));
  }

  uint64_t maxBytes_;
  uint64_t bytes_ = 0;  // of rows so far; rows come from several threads
  Storage storage_;
  std::vector<Row> rows_;
  std::vector<RowShares> shares_;
  std::vector<double> sums_;              // of finished rows; NaN: not known
  std::vector<FormFactorMatrix> others_;  // of green and blue, or none
};

// Makes rows of F. Implementations sample the same integral and differ in who finds the visible facet.
class RowMaker {
 public:
  virtual ~RowMaker() = default;
  // Fills one row per patch listed. `done` is called now and then with the number of rows finished.
  virtual void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) = 0;
};

// Makes the rows of all patches that light can reach: the front sides, emitting back sides, and every other
// back side that one of these sees (with `sky` light, all). Inner sides of perfectly clear glass stay without a row. Patches that
// are left out are removed from `patches`, and `f`, made for all of them, gets the size of what is left. Returns the patches kept,
// ascending, where some were left out; empty otherwise.
std::vector<uint32_t> makeFormFactors(RowMaker& maker, PatchSet& patches, bool sky, const Log& log, FormFactorMatrix& f);

// Figures that tell how good F is. Areas are exposed areas. What takes pairs looks at all pairs of 512
// patches, an even choice.
struct FormFactorChecks {
  double rowSumMin = 0, rowSumMean = 0, rowSumMax = 0;                // area-weighted mean
  double missed = 0, backs = 0, cut = 0, absorbed = 0, specular = 0;  // area-weighted mean shares (RowShares)
  double covered = 0;                                                 // area under objects, as a share of the whole
  size_t pairPatches = 0;                                             // patches whose pairs were looked at
  double reciprocityRms = 0;  // rms over pairs of A_i F_ij - A_j F_ji, relative to the rms of A_i F_ij
  // What no F may break where nothing is specular: F_ij in [0,1], A_i F_ij <= min(A_i, A_j).
  double smallest = 0, largest = 0;             // entries
  double worstArea = 0;                         // largest A_i F_ij / min(A_i, A_j)
  uint32_t worstFrom = 0, worstTo = 0;          // and its patches
  double correctionMin = 1, correctionMax = 1;  // near-field factors
};
FormFactorChecks checkFormFactors(const FormFactorMatrix& f, const PatchSet& patches);

}  // namespace farol
