// Patches: the elements of constant radiosity. A facet is divided into a grid of cells in (u,v); a cell
// map sends each cell to its patch. Raster, rays and display all find the patch through cellAt and the map.
#pragma once

#include "patch/facets.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace farol {

inline constexpr uint32_t kNone = 0xFFFFFFFFu;

// The grid of one facet. Parallelogram: nu x nv cells, number v * nu + u. Triangle: n * n cells with
// n = nu = nv; row v holds 2 (n - v) - 1 of them, upright and inverted in turn.
struct CellGrid {
  uint32_t nu = 1, nv = 1;
  uint32_t frontCell = 0;     // first cell of the front side
  uint32_t backCell = kNone;  // first cell of the back side; kNone when the back is black

  uint32_t count(bool parallelogram) const { return parallelogram ? nu * nv : nu * nu; }
};

// Where a cell lies: its facet, side, and place in the grid.
struct Cell {
  uint32_t facet = 0;
  bool back = false;
  uint32_t u = 0, v = 0;
  bool inverted = false;  // triangles only
};

struct Patch {
  uint32_t surface = 0;
  bool back = false;               // the far side of a double-sided surface
  Vec3 centre{0};                  // area centroid [scene units]
  Vec3 normal{0};                  // unit vector on the side that emits
  double area = 0;                 // [scene units squared]
  Rgb reflectance{0};              // rho, diffuse
  Rgb mirror{0}, transmission{0};  // shares of light that do not scatter
  Rgb emission{0};                 // exitance E [flux per area]

  bool emits() const { return maxChannel(emission) > 0; }
  Rgb specular() const { return mirror + transmission; }
  // The inner side of perfectly clear glass: all that arrives is passed on, and nobody gathers there.
  bool passesAll() const { return back && minChannel(specular()) > 1 - 1e-9; }
  bool isSpecular() const { return maxChannel(mirror) > 0 || maxChannel(transmission) > 0; }
};

// What lies behind a surface that light passes.
struct Medium {
  double ior = 1.5;
  bool solid = false;  // the surface bounds a solid; otherwise it is a thin sheet
  Rgb attenuation{0};  // in a solid [per scene unit]
};

struct PatchSet {
  std::vector<Medium> media;      // one per surface
  std::vector<CellGrid> grids;    // one per facet
  std::vector<Cell> cells;        // all front cells, then all back cells
  std::vector<uint32_t> cellMap;  // cell -> patch
  std::vector<Patch> patches;
  std::vector<uint32_t> firstCell;  // [patches + 1] start of each patch's cells in patchCells
  std::vector<uint32_t> patchCells;
  size_t frontPatchCount = 0;  // the front patches come first

  size_t size() const { return patches.size(); }
  bool anySpecular() const;
  bool colouredSpecular() const;  // mirrors or glass treat channels differently: F depends on the channel
  std::span<const uint32_t> cellsOf(uint32_t patch) const {
    return {patchCells.data() + firstCell[patch], firstCell[patch + 1] - firstCell[patch]};
  }
};

struct PatchOptions {
  size_t count = 4000;  // about so many patches over the front sides, when size is 0
  double size = 0;      // longest cell edge [scene units]
  uint32_t levels = 0;  // both are then those of a grid whose cells are halved so many times along every edge
  // Facets smaller than a patch are gathered into patches where they hang together, are of one surface, and turn by no more
  // than this [degrees]; 0: every facet has patches of its own.
  double cluster = 0;
};

// Throws Error when a reflectance exceeds 1 or the number of cells exceeds 2^31.
PatchSet buildPatches(const Scene& scene, const FacetSet& facets, const PatchOptions& options);

// Replaces the cell map: patch numbers must be 0..max without gaps, and the cells of a patch must lie on
// one surface and side, in nearly one plane: the patch's normal is their mean.
void mapCells(PatchSet& patches, const Scene& scene, const FacetSet& facets, std::vector<uint32_t> cellMap);

// The cell map that joins `along` by `along` cells of every facet's side to one patch: patches of about so many times the size.
// Those of a parallelogram begin `before` cells before its corner, fewer than `along`.
std::vector<uint32_t> joinedCells(const PatchSet& patches, const FacetSet& facets, uint32_t along, uint32_t before = 0);

// The cell map that gathers facets of a single cell, `size` wide at most [scene units], as PatchOptions::cluster says: of
// mirrors, clear glass and emitters none.
std::vector<uint32_t> clusteredCells(const PatchSet& patches, const FacetSet& facets, double size, double degrees);

// The number of the cell of a grid with `steps` halvings fewer in which a cell lies.
uint32_t coarserCell(const CellGrid& grid, bool parallelogram, const Cell& cell, uint32_t steps);
// The four cells of the grid halved once more that lie in cell `number`.
std::array<uint32_t, 4> finerCells(const CellGrid& grid, bool parallelogram, uint32_t number);

// The cell size at which buildPatches makes about `count` patches [scene units].
double sizeForPatches(const FacetSet& facets, size_t count);
// The same where facets are gathered: squares of this size have the area of all. Facets that stand apart come on top.
double sizeForClusters(const FacetSet& facets, size_t count);

// For every patch the one of `wider`, larger patches of the same facets, in which its first cell lies.
std::vector<uint32_t> joinedTo(const PatchSet& wider, const PatchSet& patches, const FacetSet& facets);

// Removes all patches but these (ascending): the cells of the others map to kNone, as black backs do.
void keepPatches(PatchSet& patches, const std::vector<uint32_t>& kept);

// Number of the grid's cell at (u,v), clamped to the facet.
uint32_t cellAt(const CellGrid& grid, bool parallelogram, double u, double v);

// The (u,v) of the point (s,t) of a cell: s,t in [0,1]^2 for a parallelogram's cell; for a triangle's cell
// s,t >= 0, s + t <= 1.
Vec2 cellPoint(const CellGrid& grid, bool parallelogram, const Cell& cell, double s, double t);

// A parallelogram or triangle: corner and sides.
struct Piece {
  Vec3 origin{0}, u{0}, v{0};  // [unit coordinates]
  Vec3 normal{0};              // unit vector on the patch's side
  bool triangle = false;
  uint32_t facet = 0;
  double area = 0;  // [scene units squared]

  Vec3 at(double s, double t) const { return origin + s * u + t * v; }  // triangles: s + t <= 1
};
// What a patch is made of: one piece where its cells make up one cell of a coarser grid, or else each of its cells.
std::vector<Piece> piecesOf(const FacetSet& facets, const PatchSet& patches, uint32_t patch);

// Area of one cell of a facet [scene units squared].
double cellArea(const FacetSet& facets, const CellGrid& grid, uint32_t facet);

// Name of a patch's surface, with "~back" for the far side.
std::string surfaceNameOf(const Scene& scene, const Patch& patch);

}  // namespace farol
