#include "formfactor/hybrid.h"

namespace farol {

void ContinuedEntries::clear(size_t patches, int channels) {
  channels_ = channels;
  for (int c = 0; c < channels; ++c) sums_[static_cast<size_t>(c)].assign(patches, 0.0);
  ends = {};
  specular = 0;
}

PixelPaths::PixelPaths(const RayTree& tree, const FacetSet& facets, const PatchSet& patches, const ProjectionLayout& layout,
                       const std::vector<uint32_t>& deltaFactors)
    : tree_(tree), facets_(facets), patches_(patches), layout_(layout) {
  constexpr double kFullHemisphere = 4294967295.0;
  for (const uint32_t f : deltaFactors) deltaFactors_.push_back(f / kFullHemisphere);
  for (const uint32_t patch : patches.cellMap) specularItems_.push_back(patch != kNone && tree.specular(patch) ? 1 : 0);
  specularItems_.insert(specularItems_.end(), {0, 0});  // nothing seen; a black back
}

void PixelPaths::follow(const uint32_t* items, const HemicubePose& pose, double weight, std::span<const double> factors,
                        uint32_t medium, ContinuedEntries& entries) const {
  std::vector<SpecularHit> hits;
  for (const ProjectionFace& face : layout_.faces) {
    for (uint32_t py = 0; py < face.height; ++py) {
      for (uint32_t px = 0; px < face.width; ++px) {
        const size_t pixel = size_t{face.y + py} * layout_.width + face.x + px;
        const uint32_t item = items[pixel];
        if (specularItems_[item] == 0 || deltaFactors_[pixel] == 0) continue;
        const double a = face.low + (px + 0.5) / face.width * (1 - face.low);
        const double b = face.bottom + (py + 0.5) / face.height * (1 - face.bottom);
        const Vec3 local = a * face.right + b * face.up + face.forward;
        const Vec3 direction = glm::normalize(local.x * pose.x + local.y * pose.y + local.z * pose.z);
        const Cell& cell = patches_.cells[item];
        const Facet& facet = facets_.facets[cell.facet];
        const Vec3& corner = facets_.points[facet.corners[0]];
        const double slope = glm::dot(facet.normal, direction);
        if (slope == 0) continue;
        const Vec3 point = pose.origin + direction * (glm::dot(facet.normal, corner - pose.origin) / slope) - corner;
        const Vec3 u = facets_.points[facet.corners[1]] - corner, v = facets_.points[facet.vCorner()] - corner;
        const double uu = glm::dot(u, u), uv = glm::dot(u, v), vv = glm::dot(v, v), det = uu * vv - uv * uv;
        const double pu = glm::dot(point, u), pv = glm::dot(point, v);
        const Vec3 inside = tree_.pointOn(cell.facet, (vv * pu - uv * pv) / det, (uu * pv - uv * pu) / det);
        const uint32_t patch = patches_.cellMap[item];
        const double carried = weight * deltaFactors_[pixel] * (factors.empty() ? 1.0 : factors[patch]);
        entries.specular += carried;
        hits.push_back({inside, direction, Rgb(carried), cell.facet, patch, cell.back, medium, 0, carried});
      }
    }
  }
  tree_.follow(hits, entries, entries.ends);
}

}  // namespace farol
