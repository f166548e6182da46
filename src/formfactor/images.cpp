#include "formfactor/images.h"

#include "base/error.h"

#include <algorithm>

namespace farol {
namespace {

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
    : limits_(limits), maxImages_(maxImages), mirrors_(facets, patches) {
  const auto refuse = [&](uint32_t surface, const char* what) {
    throw Error("{}: surface '{}' {}, which --method raster cannot mirror; use rays or hybrid", scene.path,
                scene.surfaces[surface].name, what);
  };
  if (mirrors_.tooMany())
    throw Error("{}: mirrors lie in more than {} planes, which --method raster cannot mirror; use rays or hybrid", scene.path,
                PlanarMirrors::kMostPlanes);
  if (mirrors_.clearSurface() != kNone) refuse(mirrors_.clearSurface(), "is clear glass");
  if (mirrors_.curvedSurface() != kNone) refuse(mirrors_.curvedSurface(), "is a curved mirror");
}

void ImageTrees::grow(const HemicubePose& pose, const Node* from, int parent, std::vector<Node>& queue) const {
  const Vec3& eye = pose.origin;
  for (uint32_t m = 0; m < mirrors_.all().size(); ++m) {
    const PlanarMirror& mirror = mirrors_.all()[m];
    if (mirror.height(eye) < kInPlane || (from != nullptr && from->image.mirror == m)) continue;
    Node node;
    node.image.weight = (from != nullptr ? from->image.weight : Rgb(1)) * mirror.reflectance;
    node.depth = from != nullptr ? from->depth + 1 : 1;
    if (maxChannel(node.image.weight) < limits_.minWeight || node.depth > limits_.maxDepth) continue;
    double solid = 0;
    for (const Polygon& outline : mirror.outlines) {
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
    node.image.pose = {mirror.reflected(eye), mirror.turned(pose.x), mirror.turned(pose.y), mirror.turned(pose.z)};
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
