// Form factors F_ij: the share of the diffuse power leaving patch i that reaches patch j. Row i belongs to
// the gathering patch i: H_i = sum_j F_ij B_j. A_i F_ij = A_j F_ji.
#pragma once

#include "base/log.h"
#include "patch/patches.h"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace farol {

// What became of a row besides its entries. missed + backs + sum_j F_ij = 1 for an exposed patch.
struct RowShares {
  double missed = 0;   // share that saw nothing: it leaves the scene
  double backs = 0;    // share that met black back sides
  double exposed = 1;  // share of the patch's positions that do not lie inside a solid; 0: the row is empty
};

// Receives finished rows, possibly from several threads, each row once.
class RowStore {
 public:
  virtual ~RowStore() = default;
  virtual std::span<float> row(uint32_t patch) = 0;  // [patches], to be filled completely
  virtual void finish(uint32_t patch, const RowShares& shares) = 0;
};

// Dense F in float32 [rows x columns]; rows are allocated when first asked for. Throws Error when they would
// need more than `maxBytes`.
class FormFactorMatrix : public RowStore {
 public:
  explicit FormFactorMatrix(size_t patches, uint64_t maxBytes = UINT64_MAX)
      : maxBytes_(maxBytes), rows_(patches), shares_(patches) {}

  std::span<float> row(uint32_t patch) override;
  void finish(uint32_t patch, const RowShares& shares) override { shares_[patch] = shares; }

  size_t size() const { return rows_.size(); }
  std::span<const float> operator[](size_t patch) const { return rows_[patch]; }
  const RowShares& shares(size_t patch) const { return shares_[patch]; }
  double rowSum(size_t patch) const;  // in double; 0 for a row that was not made

  // Keeps the rows and columns of these patches, in this order.
  void keep(const std::vector<uint32_t>& patches);

 private:
  uint64_t maxBytes_;
  uint64_t bytes_ = 0;  // of rows so far; rows come from several threads
  std::vector<std::vector<float>> rows_;
  std::vector<RowShares> shares_;
};

// Makes rows of F. Implementations sample the same integral and differ in who finds the visible facet.
class RowMaker {
 public:
  virtual ~RowMaker() = default;
  // Fills one row per patch listed. `done` is called now and then with the number of rows finished.
  virtual void makeRows(std::span<const uint32_t> patches, RowStore& store,
                        const std::function<void(size_t)>& done) = 0;
};

// Makes the rows of all patches that light can reach: the front sides, emitting back sides, and every other
// back side that one of these sees (with `sky` light, all). Patches that are left out are removed from
// `patches`, and `f`, made for all of them, gets the size of what is left.
void makeFormFactors(RowMaker& maker, PatchSet& patches, bool sky, const Log& log, FormFactorMatrix& f);

// Figures that tell how good F is.
struct FormFactorChecks {
  double rowSumMin = 0, rowSumMean = 0, rowSumMax = 0;  // area-weighted mean
  double missed = 0, backs = 0;                         // area-weighted mean shares
  double reciprocityRms = 0;  // rms over pairs of A_i F_ij - A_j F_ji, relative to the rms of A_i F_ij
  double covered = 0;         // area inside solids, as a share of the whole
};
FormFactorChecks checkFormFactors(const FormFactorMatrix& f, const PatchSet& patches);

}  // namespace farol
