#include "patch/facets.h"

#include "base/error.h"
#include "base/point_welder.h"
#include "patch/contacts.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>

namespace farol {
namespace {

// A triangle thinner than this share of its longest edge squared has no dependable normal in float32
// input: its direction is wrong by degrees.
constexpr double kSliverArea = 1e-6;
// Two triangles make a parallelogram when the fourth corner is this close to where it should be, as a
// share of the diagonal. (u,v) is then affine over both to the same accuracy.
constexpr double kParallelogramTolerance = 1e-5;
constexpr double kAttributeTolerance = 1e-4;  // same for texture coordinates and vertex colours

Frame frameOf(const Scene& scene) {
  Vec3 low(1e300), high(-1e300);
  for (const Surface& surface : scene.surfaces) {
    for (const auto& t : surface.triangles) {
      for (const uint32_t v : t) {
        low = glm::min(low, surface.positions[v]);
        high = glm::max(high, surface.positions[v]);
      }
    }
  }
  Frame frame;
  frame.centre = 0.5 * (low + high);
  frame.size = glm::distance(low, high);
  if (!(frame.size > 0) || !std::isfinite(frame.size)) throw Error("{}: the scene has no extent", scene.path);
  return frame;
}

struct Triangle {
  std::array<uint32_t, 3> corners, vertices;
  Vec3 normal;
  double area;
};

class FacetBuilder {
 public:
  explicit FacetBuilder(const Scene& scene) : scene_(scene), welder_(kWeldTolerance) { set_.frame = frameOf(scene); }

  FacetSet run() {
    for (uint32_t s = 0; s < scene_.surfaces.size(); ++s) addSurface(s);
    set_.points = welder_.points();
    set_.welded = welder_.movedCount();
    divideAtContacts();
    return std::move(set_);
  }

 private:
  void addSurface(uint32_t index) {
    const Surface& surface = scene_.surfaces[index];
    // A vertex that no triangle uses may lie anywhere.
    constexpr uint32_t kUnused = UINT32_MAX;
    std::vector<uint32_t> welded(surface.positions.size(), kUnused);
    std::vector<Triangle> triangles;
    for (const auto& t : surface.triangles) {
      for (const uint32_t v : t) {
        if (welded[v] == kUnused) welded[v] = welder_.add(set_.frame.toUnit(surface.positions[v]));
      }
      Triangle triangle{{welded[t[0]], welded[t[1]], welded[t[2]]}, t, Vec3(0), 0};
      if (measure(triangle) && isNew(triangle)) triangles.push_back(triangle);
    }
    merge(index, triangles);
  }

  // False for a triangle without a dependable normal.
  bool measure(Triangle& t) {
    const Vec3 &a = point(t.corners[0]), &b = point(t.corners[1]), &c = point(t.corners[2]);
    const Vec3 cross = glm::cross(b - a, c - a);
    const double doubled = glm::length(cross);
    const double longest = std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)});
    if (!(doubled > 2 * kSliverArea * longest)) {
      ++set_.degenerate;
      return false;
    }
    t.normal = cross / doubled;
    t.area = 0.5 * doubled;
    return true;
  }

  // Of triangles with the same corners and the same winding the first is kept.
  bool isNew(const Triangle& t) {
    std::array<uint32_t, 3> key = t.corners;
    std::rotate(key.begin(), std::min_element(key.begin(), key.end()), key.end());
    if (seen_.contains({key[0], key[2], key[1]})) set_.hasTwins = true;
    if (seen_.insert(key).second) return true;
    ++set_.duplicate;
    return false;
  }

  void merge(uint32_t surfaceIndex, const std::vector<Triangle>& triangles) {
    std::unordered_map<uint64_t, size_t> byEdge;  // directed edge -> triangle that has it
    const auto edge = [](uint32_t a, uint32_t b) { return uint64_t{a} << 32 | b; };
    for (size_t i = 0; i < triangles.size(); ++i) {
      for (size_t k = 0; k < 3; ++k) byEdge[edge(triangles[i].corners[k], triangles[i].corners[(k + 1) % 3])] = i;
    }
    std::vector<bool> used(triangles.size(), false);
    for (size_t i = 0; i < triangles.size(); ++i) {
      if (used[i]) continue;
      used[i] = true;
      const Triangle& t = triangles[i];
      bool merged = false;
      for (const size_t k : longestFirst(t)) {  // apex k, diagonal opposite to it
        if (merged) break;
        const auto it = byEdge.find(edge(t.corners[(k + 2) % 3], t.corners[(k + 1) % 3]));
        if (it == byEdge.end() || used[it->second]) continue;
        merged = tryPair(surfaceIndex, t, k, triangles[it->second]);
        if (merged) used[it->second] = true;
      }
      if (!merged) addTriangle(surfaceIndex, t);
    }
  }

  // Corners by the length of the opposite side: the diagonal of a rectangle is the longest, and in a row of rectangles a
  // triangle may make a parallelogram with one of the next rectangle too.
  std::array<size_t, 3> longestFirst(const Triangle& t) const {
    std::array<size_t, 3> apexes = {0, 1, 2};
    const auto opposite = [&](size_t k) { return glm::distance(point(t.corners[(k + 1) % 3]), point(t.corners[(k + 2) % 3])); };
    std::stable_sort(apexes.begin(), apexes.end(), [&](size_t a, size_t b) { return opposite(a) > opposite(b); });
    return apexes;
  }

  void addTriangle(uint32_t surfaceIndex, const Triangle& t) {
    Facet f = newFacet(surfaceIndex);
    std::copy(t.corners.begin(), t.corners.end(), f.corners.begin());
    std::copy(t.vertices.begin(), t.vertices.end(), f.vertices.begin());
    f.normal = t.normal;
    f.area = t.area;
    set_.facets.push_back(f);
  }

  // With apex a of t, diagonal b c and the far apex d of `other`: a parallelogram a b d c when a + d = b + c
  // in place and in every attribute that a material may read.
  bool tryPair(uint32_t surfaceIndex, const Triangle& t, size_t apex, const Triangle& other) {
    const Surface& surface = scene_.surfaces[surfaceIndex];
    const size_t kb = (apex + 1) % 3, kc = (apex + 2) % 3;
    size_t far = 0;
    while (other.corners[far] == t.corners[kb] || other.corners[far] == t.corners[kc]) {
      if (++far == 3) return false;
    }
    const Vec3 &a = point(t.corners[apex]), &b = point(t.corners[kb]), &c = point(t.corners[kc]), &d = point(other.corners[far]);
    if (glm::distance(a + d, b + c) > kParallelogramTolerance * glm::distance(b, c)) return false;
    if (glm::dot(t.normal, other.normal) < 0) return false;

    // Corner numbers of the diagonal in the other triangle: it runs the other way round.
    const uint32_t otherC = other.vertices[(far + 1) % 3], otherB = other.vertices[(far + 2) % 3];
    const std::array<uint32_t, 4> v = {t.vertices[apex], t.vertices[kb], other.vertices[far], t.vertices[kc]};
    const auto affine = [&](const auto& values) {
      if (values.empty()) return true;
      const auto fits = [](const auto& p, const auto& q) { return glm::length(p - q) <= kAttributeTolerance; };
      return fits(values[v[1]], values[otherB]) && fits(values[v[3]], values[otherC]) &&
             fits(values[v[0]] + values[v[2]], values[v[1]] + values[v[3]]);
    };
    if (scene_.materials[surface.material].textured() && !(affine(surface.texcoords[0]) && affine(surface.texcoords[1]))) {
      return false;
    }
    if (!affine(surface.colors)) return false;

    Facet f = newFacet(surfaceIndex);
    f.parallelogram = true;
    f.corners = {t.corners[apex], t.corners[kb], other.corners[far], t.corners[kc]};
    f.vertices = v;
    f.normal = t.normal;
    f.area = t.area + other.area;
    set_.facets.push_back(f);
    return true;
  }

  // Facets that lie on each other must be divided alike, or not at all.
  void divideAtContacts() {
    if (set_.hasTwins) return;
    const std::vector<ContactLines> lines = contactLines(set_);
    const std::vector<Facet> whole = std::move(set_.facets);
    set_.facets.clear();
    for (size_t f = 0; f < whole.size(); ++f) divide(whole[f], lines[f]);
    set_.points = welder_.points();
  }

  void divide(const Facet& whole, const ContactLines& lines) {
    if (lines.empty()) return set_.facets.push_back(whole);
    ++divided_;
    const std::vector<double> u = endsOf(lines.u), v = endsOf(lines.v);
    const std::vector<uint32_t> regions = regionsOf(lines);
    const std::array<Vec3, 4> corner = {point(whole.corners[0]), point(whole.corners[1]), point(whole.corners[2]),
                                        point(whole.corners[3])};
    const auto at = [&](double x, double y) {  // on the sides exactly, though four corners are never quite a parallelogram's
      return welder_.add((1 - y) * ((1 - x) * corner[0] + x * corner[1]) + y * ((1 - x) * corner[3] + x * corner[2]));
    };
    for (size_t j = 0; j + 1 < v.size(); ++j) {
      for (size_t i = 0; i + 1 < u.size(); ++i) {
        Facet part = whole;
        part.corners = {at(u[i], v[j]), at(u[i + 1], v[j]), at(u[i + 1], v[j + 1]), at(u[i], v[j + 1])};
        part.start = {u[i], v[j]};
        part.extent = {u[i + 1] - u[i], v[j + 1] - v[j]};
        part.area = whole.area * part.extent.x * part.extent.y;
        part.whole = divided_;
        part.region = regions[j * (u.size() - 1) + i];
        set_.facets.push_back(part);
      }
    }
  }

  Facet newFacet(uint32_t surfaceIndex) const {
    Facet f;
    f.surface = surfaceIndex;
    const Material& material = scene_.materials[scene_.surfaces[surfaceIndex].material];
    f.transmits = material.transmits();
    f.doubleSided = material.doubleSided || f.transmits;
    return f;
  }

  const Vec3& point(uint32_t i) const { return welder_.points()[i]; }

  const Scene& scene_;
  PointWelder welder_;
  FacetSet set_;
  uint32_t divided_ = 0;
  std::set<std::array<uint32_t, 3>> seen_;
};

// The distance to a plane whose normal is the cross product of two float32 edges errs by the product's rounding over its
// length, times the way to a corner.
double rayOffsetOf(const FacetSet& set, const Facet& f) {
  constexpr double kRounding = 0x1p-23, kLargest = 1e-3;
  double longest = 0;
  for (size_t k = 0; k < f.cornerCount(); ++k)
    longest = std::max(longest, glm::distance(set.points[f.corners[k]], set.points[f.corners[(k + 1) % f.cornerCount()]]));
  const double doubled = (f.parallelogram ? 1 : 2) * f.area;
  return std::clamp(kRounding * longest * longest * longest / doubled, kRayOffset, kLargest);
}

}  // namespace

FacetSet buildFacets(const Scene& scene, Log& log) {
  FacetSet set = FacetBuilder(scene).run();
  for (Facet& f : set.facets) f.rayOffset = rayOffsetOf(set, f);
  if (set.facets.empty()) throw Error("{}: the scene is empty: all {} triangles are degenerate", scene.path, set.degenerate);
  if (set.degenerate > 0)
    log.warn({"degenerate-triangles", fmt::format("{} degenerate triangles (no area, or slivers) were left out", set.degenerate)});
  if (set.duplicate > 0) log.warn({"duplicate-triangles", fmt::format("{} duplicate triangles were left out", set.duplicate)});
  return set;
}

PointAttributes attributesAt(const Surface& surface, const Facet& facet, double u, double v) {
  const uint32_t o = facet.vertices[0], pu = facet.vertices[1], pv = facet.vertices[facet.parallelogram ? 3 : 2];
  const Vec2 in = facet.inVertices(u, v);
  const auto blend = [&](const auto& values) {
    return values[o] + in.x * (values[pu] - values[o]) + in.y * (values[pv] - values[o]);
  };
  PointAttributes at;
  for (size_t set = 0; set < 2; ++set) {
    if (!surface.texcoords[set].empty()) at.uv[set] = blend(surface.texcoords[set]);
  }
  // Between colours of 0 or more; on an edge where one vanishes rounding may say a little less.
  if (!surface.colors.empty()) at.color = glm::max(blend(surface.colors), Rgb(0));
  return at;
}

}  // namespace farol
