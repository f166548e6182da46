#include "formfactor/raster_tables.h"

#include "formfactor/images.h"

namespace farol {

using shader::toVec4;

std::vector<shader::FacetRecord> facetRecords(const FacetSet& facets, const PatchSet& patches) {
  std::vector<shader::FacetRecord> records;
  for (size_t i = 0; i < facets.facets.size(); ++i) {
    const CellGrid& g = patches.grids[i];
    const Facet& f = facets.facets[i];
    const double distance = glm::dot(f.normal, facets.points[f.corners[0]]);
    records.push_back({toVec4(f.normal, distance), g.frontCell, g.backCell, g.nu, f.parallelogram ? g.nv : 0});
  }
  return records;
}

std::vector<uint32_t> itemBins(const PatchSet& patches) {
  const auto count = static_cast<uint32_t>(patches.size());
  std::vector<uint32_t> bins;
  bins.reserve(patches.cellMap.size() + 2);
  for (const uint32_t patch : patches.cellMap) bins.push_back(patch == kNone ? count + 1 : patch);
  bins.insert(bins.end(), {count, count + 1, count + 2});
  return bins;
}

std::vector<uint32_t> itemMirrors(const PatchSet& patches, const ImageTrees* images) {
  std::vector<uint32_t> mirrors;
  if (images == nullptr) return mirrors;
  for (const uint32_t patch : patches.cellMap) mirrors.push_back(patch == kNone ? kNone : images->mirrorOfPatch()[patch]);
  mirrors.insert(mirrors.end(), 3, shader::kNoCell);
  return mirrors;
}

std::vector<shader::FaceRecord> faceRecordsOf(const ProjectionLayout& layout) {
  std::vector<shader::FaceRecord> records;
  for (const ProjectionFace& f : layout.faces)
    records.push_back({toVec4(f.right, f.low), toVec4(f.up, f.bottom), toVec4(f.forward)});
  return records;
}

bool isIdentity(const PatchSet& patches) {
  for (uint32_t c = 0; c < patches.cellMap.size(); ++c) {
    if (patches.cellMap[c] != c) return false;
  }
  return true;
}

}  // namespace farol
