// F kept in a file, to be solved again under new light: a NumPy archive (.npz, zip64, uncompressed) with the members of
// scipy.sparse.save_npz (F as CSR, float32) and, beside them, what the matrix does not say: farol_*.npy.
#pragma once

#include "formfactor/form_factors.h"
#include "patch/fingerprint.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace farol {

struct KeptFactors {
  std::string method;  // as `farol compare` takes it
  uint64_t seed = 1;
  PatchOptions patches;
  Fingerprint fingerprint;
};

// Rows of some patches made once more, which tell the error of F's: kept beside it, since making them again would cost more
// than to light the scene anew.
struct KeptReplicates {
  std::vector<uint32_t> patches;
  FormFactorMatrix rows;  // [all patches], those of `patches` made
};

// Needs a row per patch of the whole set. Appears whole or not at all. `rows`, those of the patches `again`, may be null.
void writeFactorsNpz(const std::string& path, const FormFactorMatrix& f, const PatchSet& patches, const KeptFactors& about,
                     const std::vector<uint32_t>& again, const FormFactorMatrix* rows);

// Reading. Throws Error with the file's name when it is not such an archive, is damaged (every member has a checksum), or
// does not belong to the patches.
class FactorArchive {
 public:
  explicit FactorArchive(const std::string& path);
  ~FactorArchive();
  FactorArchive(const FactorArchive&) = delete;
  FactorArchive& operator=(const FactorArchive&) = delete;

  const KeptFactors& about() const;

  // Throws Error when geometry, patches or specular properties differ, naming which.
  void requireSame(const Fingerprint& scene, const std::string& scenePath) const;
  FormFactorMatrix load(size_t patches, uint64_t maxBytes) const;
  std::optional<KeptReplicates> replicates(size_t patches) const;  // none where none were kept

 private:
  void loadRows(FormFactorMatrix& f, int c, const std::string& prefix, const std::vector<uint32_t>& rows,
                const std::function<RowShares(size_t)>& sharesOf) const;

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace farol
