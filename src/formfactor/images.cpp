#include "formfactor/images.h"

#include "base/error.h"

#include <algorithm>
#include <map>

namespace farol {
namespace {

constexpr double kInPlane = 1e-6;  // planes and polygons closer than this are one [unit coordinates]

// The part of a convex polygon with n . p > d.
std::vector<Vec3> clipped(const std::vector<Vec3>& polygon, const Vec3& n, double d) {
  std::vector<Vec3> kept;
  for (size_t k = 0; k < polygon.size(); ++k) {
    const Vec3 &a = polygon[k], &b = polygon[(k + 1) % polygon.size()];
    const double da = glm::dot(n, a) - d, db = glm::dot(n, b) - d;
    if (da > 0) kept.push_back(a);
    if ((da > 0) != (db > 0)) kept.push_back(a + (b - a) * (da / (da - db)));
  }
  return kept;
}

Vec3 areaVector(const std::vector<Vec3>& polygon) {
  Vec3 sum(0);
  for (size_t k = 2; k < polygon.size(); ++k) sum += 0.5 * glm::cross(polygon[k - 1] - polygon[0], polygon[k] - polygon[0]);
  return sum;
}

// What of a polygon is seen from the eye through a convex opening.
std::vector<Vec3> seenThrough(std::vector<Vec3> polygon, const std::vector<Vec3>& opening, const Vec3& eye) {
  Vec3 middle(0);
  for (const Vec3& p : opening) middle += p / static_cast<double>(opening.size());
  for (size_t k = 0; k < opening.size() && polygon.size() > 2; ++k) {
    Vec3 side = glm::cross(opening[k] - eye, opening[(k + 1) % opening.size()] - eye);
    const double length = glm::length(side);
    if (length < 1e-14) continue;
    side /= length;
    if (glm::dot(side, middle - eye) < 0) side = -side;
    polygon = clipped(polygon, side, glm::dot(side, eye) - kInPlane);
  }
  return polygon;
}

}  // namespace

struct ImageTrees::Node {
  MirrorImage image;
  std::vector<Polygon> openings;
  double importance = 0;
  uint32_t depth = 1;
};

ImageTrees::ImageTrees(const Scene& scene, const FacetSet& facets, const PatchSet& patches, const TreeLimits& limits,
                       uint32_t maxImages)
    : limits_(limits), maxImages_(maxImages), mirrorOfPatch_(patches.size(), kNone) {
  const auto refuse = [&](uint32_t surface, const char* what) {
    throw Error("{}: surface '{}' {}, which --method raster cannot mirror; use rays or hybrid", scene.path,
                scene.surfaces[surface].name, what);
  };
  std::map<std::pair<uint32_t, uint32_t>, Vec3> edges;  // of mirrors: the normal of the facet met first
  for (uint32_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches.patches[i];
    if (!p.isSpecular()) continue;
    if (maxChannel(p.transmission) > 0) refuse(p.surface, "is clear glass");
    const double distance = glm::dot(p.normal, facets.frame.toUnit(p.centre));
    uint32_t m = 0;
    while (m < mirrors_.size() && !(glm::distance(mirrors_[m].normal, p.normal) < kInPlane &&
                                    std::abs(mirrors_[m].distance - distance) < kInPlane && mirrors_[m].reflectance == p.mirror))
      ++m;
    if (m == mirrors_.size()) mirrors_.push_back({p.normal, distance, p.mirror, {}});
    mirrorOfPatch_[i] = m;
    const Cell& first = patches.cells[patches.cellsOf(i)[0]];
    const CellGrid& grid = patches.grids[first.facet];
    if (patches.cellsOf(i)[0] != (first.back ? grid.backCell : grid.frontCell)) continue;  // once per facet
    const Facet& facet = facets.facets[first.facet];
    Polygon outline;
    for (size_t k = 0; k < facet.cornerCount(); ++k) {
      outline.push_back(facets.points[facet.corners[k]]);
      const uint32_t a = facet.corners[k], b = facet.corners[(k + 1) % facet.cornerCount()];
      const auto [at, isNew] = edges.try_emplace(std::minmax(a, b), p.normal);
      constexpr double kShallow = 0.7;  // cosine of 45 degrees
      const double cosine = glm::dot(at->second, p.normal);
      if (!isNew && cosine > kShallow && cosine < 1 - 1e-9) refuse(p.surface, "is a curved mirror");
    }
    mirrors_[m].polygons.push_back(std::move(outline));
  }
  // A facet whose patches reflect differently is a mirror of each kind, as large as the facet: only their pixels count.
}

void ImageTrees::grow(const HemicubePose& pose, const Node* from, int parent, std::vector<Node>& queue) const {
  const Vec3& eye = pose.origin;
  for (uint32_t m = 0; m < mirrors_.size(); ++m) {
    const Mirror& mirror = mirrors_[m];
    const double height = glm::dot(mirror.normal, eye) - mirror.distance;
    if (height < kInPlane || (from != nullptr && from->image.mirror == m)) continue;
    Node node;
    node.image.weight = (from != nullptr ? from->image.weight : Rgb(1)) * mirror.reflectance;
    node.depth = from != nullptr ? from->depth + 1 : 1;
    if (maxChannel(node.image.weight) < limits_.minWeight || node.depth > limits_.maxDepth) continue;
    double solid = 0;
    for (const Polygon& outline : mirror.polygons) {
      std::vector<Polygon> seen;
      if (from == nullptr) {
        seen.push_back(clipped(outline, pose.z, glm::dot(pose.z, eye) + 1e-9));
      } else {
        const Polygon front = clipped(outline, from->image.clipNormal, from->image.clipDistance + kInPlane);
        for (const Polygon& opening : from->openings) seen.push_back(seenThrough(front, opening, eye));
      }
      for (Polygon& part : seen) {
        if (part.size() < 3) continue;
        const Vec3 area = areaVector(part), towards = part[0] - eye;
        const double distance = glm::length(towards);
        const double size = std::abs(glm::dot(area, towards)) / std::max(distance * distance * distance, 1e-18);
        if (glm::length(area) < 1e-14) continue;
        solid += size;
        node.openings.push_back(std::move(part));
      }
    }
    if (node.openings.empty()) continue;
    const auto reflectVector = [&](const Vec3& v) { return v - 2 * glm::dot(v, mirror.normal) * mirror.normal; };
    node.image.pose = {eye - 2 * height * mirror.normal, reflectVector(pose.x), reflectVector(pose.y), reflectVector(pose.z)};
    node.image.clipNormal = mirror.normal;
    node.image.clipDistance = mirror.distance;
    node.image.parent = parent;
    node.image.mirror = m;
    node.image.root = from != nullptr ? from->image.root : m;
    node.image.flipped = from == nullptr || !from->image.flipped;
    node.importance = maxChannel(node.image.weight) * solid;
    queue.push_back(std::move(node));
    std::push_heap(queue.begin(), queue.end(), [](const Node& a, const Node& b) { return a.importance < b.importance; });
  }
}

std::vector<MirrorImage> ImageTrees::of(const HemicubePose& pose) const {
  std::vector<MirrorImage> images;
  std::vector<Node> queue;
  grow(pose, nullptr, -1, queue);
  while (!queue.empty() && images.size() < maxImages_) {
    std::pop_heap(queue.begin(), queue.end(), [](const Node& a, const Node& b) { return a.importance < b.importance; });
    const Node node = std::move(queue.back());
    queue.pop_back();
    images.push_back(node.image);
    grow(node.image.pose, &node, static_cast<int>(images.size()) - 1, queue);
  }
  return images;
}

}  // namespace farol
