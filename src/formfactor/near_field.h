// Factors between patches that are close to each other, where one centre point does not stand for the patch.
#pragma once

#include "formfactor/form_factors.h"
#include "formfactor/near_patches.h"
#include "patch/positions.h"
#include "trace/cover.h"

namespace farol {

// Area-to-area factor from patch i to patch j with nothing in between: the closed form of Lambert's contour sum from
// n x n Gauss points of patch i (Baum, Rushmeier and Winget 1989; Schroeder and Hanrahan 1993). n = 0 chooses by
// distance for a relative error of about 1e-6, or 1e-5 where the patches share an edge.
class UnoccludedFactor {
 public:
  // The references must outlive this.
  UnoccludedFactor(const FacetSet& facets, const PatchSet& patches);
  double operator()(uint32_t i, uint32_t j, int n = 0) const;
  double from(std::span<const Position> points, uint32_t i, uint32_t j) const;  // from points of patch i

  bool faceEachOther(uint32_t i, uint32_t j) const;
  // From the centre of patch i. Beyond three sizes of j by the kernel between the centres: squares that face each other are off
  // by 4 % there, and less beyond; of what only reaches above i's plane nothing counts. Tells what is near, not what F is.
  double fromCentre(uint32_t i, uint32_t j) const;
  const std::vector<Vec3>& centres() const { return centres_; }  // [unit coordinates]
  const std::vector<double>& sizes() const { return sizes_; }    // roots of the areas [unit coordinates]

 private:
  const FacetSet& facets_;
  const PatchSet& patches_;
  std::vector<Vec3> centres_;
  std::vector<double> sizes_, radii_;                     // radii: around the centre
  std::vector<std::vector<std::vector<Vec3>>> polygons_;  // per patch, one per cell
};

// Corrects a row made from the patch's centre: the entries with the largest predicted errors F (h / d)^2 (at most 16)
// become the closed form times the kernel-weighted visible share of 16 pairs of points (Embree), and the rest of the row,
// what missed the scene or met backs included, is scaled so that the whole stays 1. Where the rest is too small to make
// up for the change (a factor beyond 2 or below 1/2), it is kept, and the near entries divide their old sum as the closed
// forms do. Which entries these are does not depend on what was seen: where pixels are larger than patches, those that
// show by chance would all be corrected downwards, and those that do not would be missing.
class NearField {
 public:
  // Of a partly covered patch only the exposed part counts. Entries with a predicted error of at least `worthIt` are corrected.
  NearField(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const ExposedArea& exposed, uint64_t seed,
            double worthIt = 1e-6);

  // A row of all patches, or the entries of the patches `ids`, ascending, which may become more. Also scales the shares, and
  // sets their `correction`.
  void correct(uint32_t patch, std::span<float> row, RowShares& shares) const;
  void correct(uint32_t patch, std::vector<uint32_t>& ids, std::vector<float>& values, RowShares& shares) const;

 private:
  struct Entry {
    uint32_t patch;
    double value;  // the corrected factor
    size_t place;  // in the row
  };
  std::vector<Entry> nearEntries(uint32_t patch) const;
  void put(std::span<const Entry> near, std::span<float> row, RowShares& shares) const;
  std::vector<Position> exposedPoints(uint32_t i) const;
  double visibleShare(std::span<const Position> from, uint32_t i, uint32_t j) const;

  const Tracer& tracer_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  const ExposedArea& exposed_;
  uint64_t seed_;
  double worthIt_;
  UnoccludedFactor factor_;
  NearPatches nearest_;
};

// Why a scene's factors cannot all be had in closed form: the surface that may stand between two others. Empty when
// nothing can block: for every pair of facets that see each other's front, every other facet is separated from the
// space between them by a plane. Scenes of more than 64 facets are not looked at.
std::string whatMayBlock(const Scene& scene, const FacetSet& facets);

// Rows in closed form, for scenes where nothing can block.
class ExactRowMaker : public RowMaker {
 public:
  ExactRowMaker(const FacetSet& facets, const PatchSet& patches) : factor_(facets, patches), patches_(patches) {}
  void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) override;

 private:
  UnoccludedFactor factor_;
  const PatchSet& patches_;
};

}  // namespace farol
