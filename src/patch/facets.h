// Flat pieces of the scene with an affine (u,v): triangles, and parallelograms made of two triangles.
// Geometry is never subdivided further, but for large parallelograms along lines at which something opaque touches them
// (contacts.h); patches live in (u,v) (patches.h).
#pragma once

#include "base/log.h"
#include "scene/scene.h"

#include <array>
#include <vector>

namespace farol {

// Moves and scales the scene to unit size: unit = (p - centre) / size, in double precision.
// Everything after this works in unit coordinates; results go back to the input's units.
struct Frame {
  Vec3 centre{0};   // [scene units]
  double size = 1;  // diagonal of the bounding box [scene units]

  Vec3 toUnit(const Vec3& p) const { return (p - centre) / size; }
  Vec3 toScene(const Vec3& p) const { return centre + size * p; }
};

// A ray that starts on a facet starts this far in front of it [unit coordinates], so that it meets neither its own
// facet nor another one in the same plane: a few float32 roundings of points at most 0.5 from the centre. Rasterized
// rows leave out facets whose plane holds the eye within the same distance. Of long thin facets the plane itself is known
// less well in float32: see Facet::rayOffset.
inline constexpr double kRayOffset = 4e-7;

struct Facet {
  uint32_t surface = 0;
  bool parallelogram = false;
  bool doubleSided = false;  // the far side is no black back
  bool transmits = false;    // clear glass: nothing hides behind it
  // Counter-clockwise seen from the front. Corner (u,v): 0 (0,0), 1 (1,0), then for a triangle 2 (0,1),
  // for a parallelogram 2 (1,1) and 3 (0,1).
  std::array<uint32_t, 4> corners{};   // welded points, indices into FacetSet::points
  std::array<uint32_t, 4> vertices{};  // the surface's own vertices, for attributes
  // Of a divided parallelogram: its number from 1 on (0: not divided), what part of it the facet is in its (u,v), and the region:
  // between two of them something stands all along the border.
  uint32_t whole = 0, region = 0;
  Vec2 start{0}, extent{1};
  Vec3 normal{0};                 // unit vector on the front side
  double area = 0;                // [unit coordinates squared]
  double rayOffset = kRayOffset;  // rays that start on it start this far in front of it [unit coordinates]

  size_t cornerCount() const { return parallelogram ? 4 : 3; }
  uint32_t vCorner() const { return corners[parallelogram ? 3 : 2]; }  // the corner at (0,1)
  Vec2 inVertices(double u, double v) const { return start + Vec2(u, v) * extent; }
  bool endsAt(const Facet& f) const { return whole == f.whole && region != f.region; }  // light does not go on smoothly
};

struct FacetSet {
  Frame frame;
  std::vector<Vec3> points;  // welded [unit coordinates]
  std::vector<Facet> facets;
  bool hasTwins = false;  // some facets share all corners and face opposite ways

  // Triangles left out, and vertices moved to another within the welding tolerance.
  size_t degenerate = 0, duplicate = 0, welded = 0;

  Vec3 point(const Facet& f, double u, double v) const {
    const Vec3& o = points[f.corners[0]];
    return o + u * (points[f.corners[1]] - o) + v * (points[f.vCorner()] - o);
  }
};

// Vertices closer than this are one [unit coordinates]; a few float32 spacings of the largest coordinate.
inline constexpr double kWeldTolerance = 1e-6;

// Divides parallelograms along the contactLines. Throws Error when no triangle with an area is left.
FacetSet buildFacets(const Scene& scene, Log& log);

// Attributes of the surface at (u,v) of a facet, for Material::evaluate.
PointAttributes attributesAt(const Surface& surface, const Facet& facet, double u, double v);

}  // namespace farol
