#include "solve/node_irradiance.h"

#include "base/point_welder.h"

#include <algorithm>
#include <glm/vector_relational.hpp>
#include <tbb/parallel_for.h>
#include <unordered_set>

namespace farol {
namespace {

// Normals at a point within this cosine are one smooth surface (8 degrees), provided that the facets
// themselves do not fold by more than 60 degrees.
constexpr double kSmoothNormal = 0.99, kSmoothFold = 0.5;

// Number of the node (i,j) of a grid.
uint32_t nodeNumber(const CellGrid& g, bool parallelogram, uint32_t i, uint32_t j) {
  if (parallelogram) return j * (g.nu + 1) + i;
  return j * (g.nu + 1) - j * (j - 1) / 2 + i;  // rows of n+1, n, n-1, ... nodes; j (j - 1) is 0 for j = 0
}

// Calls `use` with the nodes at a cell's corners.
template <typename Use>
void forNodesOf(const CellGrid& g, bool parallelogram, const Cell& cell, Use&& use) {
  const uint32_t i = cell.u, j = cell.v;
  if (parallelogram || !cell.inverted) use(nodeNumber(g, parallelogram, i, j));
  use(nodeNumber(g, parallelogram, i + 1, j));
  use(nodeNumber(g, parallelogram, i, j + 1));
  if (parallelogram || cell.inverted) use(nodeNumber(g, parallelogram, i + 1, j + 1));
}

// Value at (u,v) from the nodes of a grid: bilinear within a parallelogram's cell, linear within a triangle's.
Rgb interpolate(const CellGrid& g, bool parallelogram, const Rgb* nodes, double u, double v) {
  const auto node = [&](uint32_t i, uint32_t j) -> const Rgb& { return nodes[nodeNumber(g, parallelogram, i, j)]; };
  const double x = std::clamp(u, 0.0, 1.0) * g.nu, y = std::clamp(v, 0.0, 1.0) * g.nv;
  const uint32_t j = std::min(static_cast<uint32_t>(y), g.nv - 1);
  if (parallelogram) {
    const uint32_t i = std::min(static_cast<uint32_t>(x), g.nu - 1);
    const double s = x - i, t = y - j;
    return (1 - t) * ((1 - s) * node(i, j) + s * node(i + 1, j)) + t * ((1 - s) * node(i, j + 1) + s * node(i + 1, j + 1));
  }
  const uint32_t i = std::min(static_cast<uint32_t>(x), g.nu - 1 - j);
  const double s = x - i, t = y - j;
  if (s + t <= 1 || i + j + 1 >= g.nu) return node(i, j) + s * (node(i + 1, j) - node(i, j)) + t * (node(i, j + 1) - node(i, j));
  const Rgb& far = node(i + 1, j + 1);
  return far + (1 - s) * (node(i, j + 1) - far) + (1 - t) * (node(i + 1, j) - far);
}

struct Sum {
  Rgb value{0};
  double weight = 0;
};

class Builder {
 public:
  Builder(const Scene& scene, const FacetSet& facets, const PatchSet& patches, const FormFactorMatrix* f,
          const std::vector<Rgb>& irradiance)
      : scene_(scene), facets_(facets), patches_(patches), f_(f), irradiance_(irradiance), welder_(kWeldTolerance) {
    for (const uint32_t patch : patches.cellMap) cellValues_.push_back(patch == kNone ? Rgb(0) : irradiance[patch]);
    for (uint32_t p = 0; p < patches.size(); ++p) mostCells_ = std::max(mostCells_, patches.cellsOf(p).size());
  }

  void run(std::vector<uint32_t>& firstNode, std::vector<Rgb>& values) {
    groupByPlane();
    firstNode.assign(2 * facets_.facets.size(), kNone);
    for (uint32_t side = 0; side < firstNode.size(); ++side) {
      if (!hasPatches(side / 2, side % 2 == 1)) continue;
      firstNode[side] = static_cast<uint32_t>(nodes_.size());
      addNodes(side / 2, side % 2 == 1);
    }
    if (mostCells_ > 1) smooth(firstNode);
    values = valuesOfNodes();
    for (const Node& node : nodes_) {
      if (node.border) addAcrossBorder(node, firstNode, values);
    }
    for (Cluster& cluster : clusters_) {
      cluster.sum.value += cluster.across.value;
      cluster.sum.weight += cluster.across.weight;
    }
    values = valuesOfNodes();
  }

 private:
  struct Cluster {
    const Facet* facet;  // the first one
    Vec3 shading, geometric;
    Sum sum, across;        // from cells around the point; from neighbours without a node here
    uint32_t next = kNone;  // another cluster at the same point
  };

  struct Node {
    uint32_t cluster, facet;
    bool back, border;
    Vec3 point;
  };

  std::vector<Rgb> valuesOfNodes() const {
    std::vector<Rgb> values;
    values.reserve(nodes_.size());
    for (const Node& node : nodes_) {
      const Sum& s = clusters_[node.cluster].sum;
      values.push_back(s.weight > 0 ? s.value / s.weight : Rgb(0));
    }
    return values;
  }

  bool hasPatches(uint32_t facet, bool back) const {
    const CellGrid& g = patches_.grids[facet];
    const uint32_t first = back ? g.backCell : g.frontCell;
    return first != kNone && patches_.cellMap[first] != kNone;
  }

  void addNodes(uint32_t facet, bool back) {
    const Facet& f = facets_.facets[facet];
    const CellGrid& g = patches_.grids[facet];
    for (uint32_t j = 0; j <= g.nv; ++j) {
      const uint32_t width = f.parallelogram ? g.nu : g.nu - j;
      for (uint32_t i = 0; i <= width; ++i) {
        const double u = static_cast<double>(i) / g.nu, v = static_cast<double>(j) / g.nv;
        const Vec3 p = facets_.point(f, u, v);
        const double sign = back ? -1 : 1;
        const uint32_t cluster = clusterAt(p, f, sign * shadingNormal(f, u, v), sign * f.normal);
        addCells(facet, back, u, v, clusters_[cluster].sum, cluster);
        const bool border = i == 0 || j == 0 || i == width || (f.parallelogram && j == g.nv);
        nodes_.push_back({cluster, facet, back, border, p});
      }
    }
  }

  Vec3 shadingNormal(const Facet& f, double u, double v) const {
    const Surface& s = scene_.surfaces[f.surface];
    if (s.normals.empty()) return f.normal;
    const Vec3 &o = s.normals[f.vertices[0]], &a = s.normals[f.vertices[1]], &b = s.normals[f.vertices[f.parallelogram ? 3 : 2]];
    const Vec2 in = f.inVertices(u, v);
    const Vec3 n = o + in.x * (a - o) + in.y * (b - o);
    const double length = glm::length(n);
    return length > 0 && glm::dot(n, f.normal) > 0 ? n / length : f.normal;
  }

  uint32_t clusterAt(const Vec3& p, const Facet& facet, const Vec3& shading, const Vec3& geometric) {
    const uint32_t point = welder_.add(p);
    if (point == firstCluster_.size()) firstCluster_.push_back(kNone);
    for (uint32_t c = firstCluster_[point]; c != kNone; c = clusters_[c].next) {
      if (glm::dot(clusters_[c].shading, shading) > kSmoothNormal && glm::dot(clusters_[c].geometric, geometric) > kSmoothFold &&
          !clusters_[c].facet->endsAt(facet))
        return c;
    }
    clusters_.push_back({&facet, shading, geometric, {}, {}, firstCluster_[point]});
    firstCluster_[point] = static_cast<uint32_t>(clusters_.size() - 1);
    return firstCluster_[point];
  }

  // Adds the cells of a facet that touch (u,v), those a hair away, each by the angle at which it touches: a cell with
  // its corner there counts less than one with the middle of an edge.
  void addCells(uint32_t facet, bool back, double u, double v, Sum& sum, uint32_t cluster = kNone) {
    const Facet& f = facets_.facets[facet];
    const CellGrid& g = patches_.grids[facet];
    const double du = 0.01 / g.nu, dv = 0.01 / g.nv;
    // One direction into each of the four parallelograms or six triangles around a node.
    static const std::vector<Vec2> kFour = {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}};
    static const std::vector<Vec2> kSix = {{1, 1}, {-0.5, 1}, {-1, 0.5}, {-1, -1}, {0.5, -1}, {1, -0.5}};
    const std::vector<Vec2>& directions = f.parallelogram ? kFour : kSix;
    for (const Vec2& direction : directions) {
      const Vec2 step = direction * Vec2(du, dv);
      const double su = u + step.x, sv = v + step.y;
      if (su < 0 || sv < 0 || (f.parallelogram ? su > 1 || sv > 1 : su + sv > 1)) continue;
      const uint32_t cell = (back ? g.backCell : g.frontCell) + cellAt(g, f.parallelogram, su, sv), patch = patches_.cellMap[cell];
      // Patches that lie inside a solid have no irradiance to show.
      const double weight = (f_ != nullptr ? f_->shares(patch).exposed : 1) / static_cast<double>(directions.size());
      sum.value += weight * cellValues_[cell];
      sum.weight += weight;
      if (cluster != kNone && mostCells_ > 1) touching_.push_back({cluster, cell, weight});
    }
  }

  // What the cells of each patch may show: from the least to the most irradiance of the patches that touch it, and a little
  // more.
  std::vector<std::pair<Rgb, Rgb>> rangesAround() const {
    const std::pair<Rgb, Rgb> none(Rgb(1e300), Rgb(-1e300));
    std::vector<std::pair<Rgb, Rgb>> ofCluster(clusters_.size(), none), ofPatch(patches_.size(), none);
    const auto widen = [](std::pair<Rgb, Rgb>& range, const Rgb& low, const Rgb& high) {
      range.first = glm::min(range.first, low);
      range.second = glm::max(range.second, high);
    };
    for (const Touch& t : touching_) {
      if (t.weight > 0) widen(ofCluster[t.cluster], cellValues_[t.cell], cellValues_[t.cell]);
    }
    for (const Touch& t : touching_)
      widen(ofPatch[patches_.cellMap[t.cell]], ofCluster[t.cluster].first, ofCluster[t.cluster].second);
    constexpr double kSlope = 1.5;  // that the darkest and the brightest of all neighbours may have
    for (size_t p = 0; p < ofPatch.size(); ++p) widen(ofPatch[p], irradiance_[p] / kSlope, irradiance_[p] * kSlope);
    return ofPatch;
  }

  // Patches of many cells: their cells take what the nodes around them have, shifted so that the patch keeps its mean, and
  // the nodes theirs again, until a slope has gone all the way across the largest patch. What is far outside of all that the
  // patch and its neighbours have would be an overshoot: such patches stay flatter.
  void smooth(const std::vector<uint32_t>& firstNode) {
    const std::vector<std::pair<Rgb, Rgb>> ranges = rangesAround();
    constexpr size_t kMostRounds = 64;
    const size_t rounds = std::min(kMostRounds, 4 * mostCells_);
    for (size_t round = 0; round < rounds; ++round) {
      const std::vector<Rgb> nodes = valuesOfNodes();
      tbb::parallel_for(uint32_t{0}, static_cast<uint32_t>(patches_.size()), [&](uint32_t p) {
        const auto cells = patches_.cellsOf(p);
        Rgb mean(0);
        double area = 0;
        for (const uint32_t c : cells) {
          const Cell& cell = patches_.cells[c];
          const bool parallelogram = facets_.facets[cell.facet].parallelogram;
          const uint32_t first = firstNode[2 * cell.facet + (cell.back ? 1 : 0)];
          Rgb around(0);
          double known = 0;  // nodes inside a solid show nothing
          forNodesOf(patches_.grids[cell.facet], parallelogram, cell, [&](uint32_t node) {
            if (clusters_[nodes_[first + node].cluster].sum.weight <= 0) return;
            around += nodes[first + node];
            known += 1;
          });
          if (known > 0) cellValues_[c] = around / known;
          const double own = cellArea(facets_, patches_.grids[cell.facet], cell.facet);
          mean += own * cellValues_[c];
          area += own;
        }
        const Rgb shift = irradiance_[p] - mean / area;
        for (const uint32_t c : cells) cellValues_[c] = glm::clamp(cellValues_[c] + shift, ranges[p].first, ranges[p].second);
      });
      for (Cluster& cluster : clusters_) cluster.sum = {};
      for (const Touch& t : touching_) {
        clusters_[t.cluster].sum.value += t.weight * cellValues_[t.cell];
        clusters_[t.cluster].sum.weight += t.weight;
      }
    }
  }

  void groupByPlane() {
    // normal * (offset + 2) tells planes apart: its direction is the normal, its length the offset, which is
    // within 1 of 0 for a scene of unit size.
    PointWelder planes(1e-4);
    planeOf_.resize(facets_.facets.size());
    for (uint32_t i = 0; i < facets_.facets.size(); ++i) {
      const Facet& f = facets_.facets[i];
      const double offset = glm::dot(f.normal, facets_.points[f.corners[0]]);
      planeOf_[i] = planes.add(f.normal * (offset + 2));
      if (planeOf_[i] == inPlane_.size()) inPlane_.emplace_back();
      Box box{i, Vec3(1e300), Vec3(-1e300)};
      for (size_t k = 0; k < f.cornerCount(); ++k) {
        box.low = glm::min(box.low, facets_.points[f.corners[k]] - Vec3(kWeldTolerance));
        box.high = glm::max(box.high, facets_.points[f.corners[k]] + Vec3(kWeldTolerance));
      }
      inPlane_[planeOf_[i]].boxes.push_back(box);
    }
    for (Plane& plane : inPlane_) {
      std::sort(plane.boxes.begin(), plane.boxes.end(),
                [](const Box& a, const Box& b) { return a.low.x + a.low.y + a.low.z < b.low.x + b.low.y + b.low.z; });
      for (const Box& b : plane.boxes)
        plane.longest = std::max(plane.longest, b.high.x + b.high.y + b.high.z - b.low.x - b.low.y - b.low.z);
    }
  }

  // Where a neighbour in the same plane has no node of its own (its grid is coarser, or its edge longer), what it shows
  // there by its own nodes joins the mean, so that the two sides agree along the border to second order.
  void addAcrossBorder(const Node& node, const std::vector<uint32_t>& firstNode, const std::vector<Rgb>& values) {
    const Vec3& p = node.point;
    const Plane& plane = inPlane_[planeOf_[node.facet]];
    if (plane.boxes.size() < 2) return;
    const double at = p.x + p.y + p.z;
    auto box = std::lower_bound(plane.boxes.begin(), plane.boxes.end(), at - plane.longest,
                                [](const Box& b, double value) { return b.low.x + b.low.y + b.low.z < value; });
    for (; box != plane.boxes.end() && box->low.x + box->low.y + box->low.z <= at; ++box) {
      if (box->facet == node.facet || !hasPatches(box->facet, node.back)) continue;
      if (glm::any(glm::lessThan(p, box->low)) || glm::any(glm::greaterThan(p, box->high))) continue;
      const Facet& neighbour = facets_.facets[box->facet];
      const CellGrid& g = patches_.grids[box->facet];
      const Vec2 uv = coordinatesOf(neighbour, p);
      const Vec3 nearest = facets_.point(neighbour, std::round(uv.x * g.nu) / g.nu, std::round(uv.y * g.nv) / g.nv);
      if (glm::distance(nearest, p) <= kWeldTolerance) continue;  // it has a node here: one cluster already
      if (!seenAcross_.insert(uint64_t{node.cluster} << 32 | box->facet).second) continue;
      Sum cells;  // of the neighbour at p: their angle is its weight
      addCells(box->facet, node.back, uv.x, uv.y, cells);
      const uint32_t first = firstNode[2 * box->facet + (node.back ? 1 : 0)];
      Sum& across = clusters_[node.cluster].across;
      across.value += cells.weight * interpolate(g, neighbour.parallelogram, values.data() + first, uv.x, uv.y);
      across.weight += cells.weight;
    }
  }

  // (u,v) of a point in the facet's plane.
  Vec2 coordinatesOf(const Facet& f, const Vec3& p) const {
    const Vec3& o = facets_.points[f.corners[0]];
    const Vec3 a = facets_.points[f.corners[1]] - o, b = facets_.points[f.vCorner()] - o, d = p - o;
    const double aa = glm::dot(a, a), ab = glm::dot(a, b), bb = glm::dot(b, b), da = glm::dot(d, a), db = glm::dot(d, b);
    const double det = aa * bb - ab * ab;
    return {(da * bb - db * ab) / det, (db * aa - da * ab) / det};
  }

  struct Box {
    uint32_t facet;
    Vec3 low, high;
  };
  struct Plane {
    std::vector<Box> boxes;
    double longest = 0;
  };

  const Scene& scene_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  const FormFactorMatrix* f_;
  const std::vector<Rgb>& irradiance_;
  PointWelder welder_;
  std::vector<uint32_t> firstCluster_;  // per welded point
  std::vector<Cluster> clusters_;
  std::vector<Node> nodes_;
  struct Touch {
    uint32_t cluster, cell;
    double weight;
  };
  std::vector<Rgb> cellValues_;
  size_t mostCells_ = 1;  // of a patch
  std::vector<Touch> touching_;
  std::unordered_set<uint64_t> seenAcross_;  // (cluster, facet) pairs that have been added
  std::vector<uint32_t> planeOf_;            // per facet
  std::vector<Plane> inPlane_;
};

}  // namespace

NodeIrradiance::NodeIrradiance(const Scene& scene, const FacetSet& facets, const PatchSet& patches, const FormFactorMatrix* f,
                               const std::vector<Rgb>& irradiance)
    : facets_(facets), patches_(patches) {
  Builder(scene, facets, patches, f, irradiance).run(firstNode_, values_);
}

Rgb NodeIrradiance::at(uint32_t facet, bool back, double u, double v) const {
  const uint32_t first = firstNode_[2 * facet + (back ? 1 : 0)];
  return interpolate(patches_.grids[facet], facets_.facets[facet].parallelogram, values_.data() + first, u, v);
}

}  // namespace farol
