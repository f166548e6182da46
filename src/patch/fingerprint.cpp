#include "patch/fingerprint.h"

#include <bit>

namespace farol {
namespace {

class Hash {
 public:
  void add(uint64_t bits) { value_ = mixBits(value_ ^ mixBits(bits + ++count_)); }
  void add(double value) { add(std::bit_cast<uint64_t>(value + 0.0)); }  // -0 and 0 are one
  uint64_t value() const { return value_; }

 private:
  uint64_t value_ = 0, count_ = 0;
};

}  // namespace

Fingerprint fingerprintOf(const FacetSet& facets, const PatchSet& patches) {
  Hash geometry, cells, specular;
  for (const Facet& f : facets.facets) {
    geometry.add(uint64_t{f.parallelogram} | uint64_t{f.doubleSided} << 1);
    for (size_t k = 0; k < f.cornerCount(); ++k) {
      // To 2^-36 of the scene's size: moved scenes round differently.
      for (int c = 0; c < 3; ++c) geometry.add(std::round(facets.points[f.corners[k]][c] * 0x1p36));
    }
  }
  for (const CellGrid& g : patches.grids) {
    cells.add(uint64_t{g.nu} << 32 | g.nv);
    cells.add(uint64_t{g.frontCell} << 32 | g.backCell);
  }
  for (const uint32_t p : patches.cellMap) cells.add(uint64_t{p});
  for (const Patch& p : patches.patches) {
    for (int c = 0; c < 3; ++c) specular.add(p.specular()[c]);
    if (p.isSpecular()) {
      for (int c = 0; c < 3; ++c) specular.add(p.mirror[c]);
      const Medium& m = patches.media[p.surface];
      specular.add(m.ior);
      specular.add(uint64_t{m.solid});
      for (int c = 0; c < 3; ++c) specular.add(m.attenuation[c]);
    }
  }
  return {geometry.value(), cells.value(), specular.value()};
}

}  // namespace farol
