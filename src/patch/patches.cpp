#include "patch/patches.h"

#include "base/error.h"

#include <algorithm>
#include <utility>

namespace farol {
namespace {

struct EdgeLengths {
  double u, v;  // of a parallelogram's sides; both the longest edge of a triangle [unit coordinates]
};

EdgeLengths edgeLengths(const FacetSet& set, const Facet& f) {
  const Vec3 &a = set.points[f.corners[0]], &b = set.points[f.corners[1]], &c = set.points[f.vCorner()];
  const double u = glm::distance(a, b), v = glm::distance(a, c);
  if (f.parallelogram) return {u, v};
  const double longest = std::max({u, v, glm::distance(b, c)});
  return {longest, longest};
}

// Cells along an edge: ceil(l / S); a length that is a whole multiple up to rounding stays exact.
double cellsAlong(double length, double size) { return std::max(1.0, std::ceil(length / size * (1 - 1e-9))); }

double countCells(const FacetSet& set, const std::vector<EdgeLengths>& edges, double size) {
  double sum = 0;
  for (size_t i = 0; i < edges.size(); ++i) {
    const double nu = cellsAlong(edges[i].u, size);
    sum += set.facets[i].parallelogram ? nu * cellsAlong(edges[i].v, size) : nu * nu;
  }
  return sum;
}

// The cell size that gives the number of cells nearest to `target`; the count falls as the size grows.
double sizeForCount(const FacetSet& set, const std::vector<EdgeLengths>& edges, double target) {
  double low = 1e-7, high = 2.0;  // the scene's diagonal is 1
  for (int i = 0; i < 80; ++i) {
    const double middle = std::sqrt(low * high);
    (countCells(set, edges, middle) > target ? low : high) = middle;
  }
  const double above = countCells(set, edges, low), below = countCells(set, edges, high);
  return above - target < target - below ? low : high;
}

// Every facet has a patch at least. A detailed model may have more facets than patches are asked for; its walls and
// floors still need dividing, so half of the number asked for is always left for that.
double targetCells(const FacetSet& set, size_t asked) {
  const auto facets = static_cast<double>(set.facets.size()), count = static_cast<double>(asked);
  return std::max(count, facets > 1 && facets > 0.5 * count ? facets + 0.5 * count : count);
}

// Index of the first cell of row v in a triangle's grid of n rows.
uint32_t triangleRow(uint32_t n, uint32_t v) { return v * (2 * n - v); }

void addCells(PatchSet& set, const FacetSet& facets, bool back) {
  for (uint32_t f = 0; f < facets.facets.size(); ++f) {
    const Facet& facet = facets.facets[f];
    if (back && !facet.doubleSided) continue;
    CellGrid& grid = set.grids[f];
    (back ? grid.backCell : grid.frontCell) = static_cast<uint32_t>(set.cells.size());
    for (uint32_t v = 0; v < grid.nv; ++v) {
      const uint32_t width = facet.parallelogram ? grid.nu : 2 * (grid.nu - v) - 1;
      for (uint32_t k = 0; k < width; ++k) {
        const bool inverted = !facet.parallelogram && k % 2 == 1;
        set.cells.push_back({f, back, facet.parallelogram ? k : k / 2, v, inverted});
      }
    }
  }
}

// Mean optics over a cell. Constant materials are evaluated once; textured ones on a grid of about one
// sample per texel, at most 32 x 32.
Optics cellOptics(const Scene& scene, const Facet& facet, const CellGrid& grid, const Cell& cell) {
  const Surface& surface = scene.surfaces[facet.surface];
  const Material& material = scene.materials[surface.material];
  const bool varies = material.textured() || !surface.colors.empty();
  int samples = 1;
  if (material.textured()) {
    double texels = 1;
    for (const TextureUse* use : {&material.baseTexture, &material.emissionTexture, &material.metallicRoughnessTexture}) {
      if (!use->used()) continue;
      const Texture& texture = scene.textures[static_cast<size_t>(use->texture)];
      const auto uvAt = [&](double s, double t) {
        const Vec2 q = cellPoint(grid, facet.parallelogram, cell, s, t);
        return use->transform(attributesAt(surface, facet, q.x, q.y).uv[static_cast<size_t>(use->set)]) *
               Vec2(texture.width, texture.height);
      };
      const Vec2 origin = uvAt(0, 0);
      texels = std::max({texels, glm::distance(origin, uvAt(1, 0)), glm::distance(origin, uvAt(0, 1))});
    }
    samples = static_cast<int>(std::clamp(std::ceil(texels), 2.0, 32.0));
  } else if (varies) {
    samples = facet.parallelogram ? 1 : 3;  // vertex colours are linear: the mean is the value at the centroid
  }
  Optics mean;
  double weight = 0;
  for (int j = 0; j < samples; ++j) {
    for (int i = 0; i < samples; ++i) {
      double s = (i + 0.5) / samples, t = (j + 0.5) / samples;
      if (!facet.parallelogram && s + t > 1) {  // fold the square onto the triangle
        s = 1 - s;
        t = 1 - t;
      }
      const Vec2 uv = facet.parallelogram || samples > 1 ? cellPoint(grid, facet.parallelogram, cell, s, t)
                                                         : cellPoint(grid, false, cell, 1.0 / 3, 1.0 / 3);
      const Optics o = material.evaluate(scene.textures, attributesAt(surface, facet, uv.x, uv.y));
      mean.diffuse += o.diffuse;
      mean.specular += o.specular;
      mean.transmission += o.transmission;
      mean.emission += o.emission;
      weight += 1;
    }
  }
  mean.diffuse /= weight;
  mean.specular /= weight;
  mean.transmission /= weight;
  mean.emission /= weight;
  return mean;
}

Medium mediumOf(const Material& material) {
  Medium medium{material.ior, material.solid(), Rgb(0)};
  if (material.attenuationDistance > 0) {  // black would absorb within no distance at all
    constexpr double kDarkest = 1e-6;
    medium.attenuation = -glm::log(glm::max(material.attenuationColor, Rgb(kDarkest))) / material.attenuationDistance;
  }
  return medium;
}

}  // namespace

bool PatchSet::anySpecular() const {
  return std::any_of(patches.begin(), patches.end(), [](const Patch& p) { return p.isSpecular(); });
}

bool PatchSet::colouredSpecular() const {
  const auto coloured = [](const Rgb& c) { return maxChannel(c) > minChannel(c); };
  return std::any_of(patches.begin(), patches.end(), [&](const Patch& p) {
    return coloured(p.mirror) || coloured(p.transmission) ||
           (maxChannel(p.transmission) > 0 && coloured(media[p.surface].attenuation));
  });
}

uint32_t cellAt(const CellGrid& grid, bool parallelogram, double u, double v) {
  const auto place = [](double x, uint32_t n) {
    return static_cast<uint32_t>(std::clamp(std::floor(x * n), 0.0, static_cast<double>(n - 1)));
  };
  if (parallelogram) return place(v, grid.nv) * grid.nu + place(u, grid.nu);
  const uint32_t n = grid.nu, row = place(v, n);
  const uint32_t column = std::min(place(u, n), n - 1 - row);
  const bool inverted = (u * n - column) + (v * n - row) > 1 && column + row + 1 < n;
  return triangleRow(n, row) + 2 * column + (inverted ? 1 : 0);
}

Vec2 cellPoint(const CellGrid& grid, bool parallelogram, const Cell& cell, double s, double t) {
  if (!parallelogram && cell.inverted) {  // the corner at (u+1, v+1), running back
    s = 1 - s;
    t = 1 - t;
  }
  return {(cell.u + s) / grid.nu, (cell.v + t) / grid.nv};
}

double cellArea(const FacetSet& facets, const CellGrid& grid, uint32_t facet) {
  const Facet& f = facets.facets[facet];
  return f.area * facets.frame.size * facets.frame.size / grid.count(f.parallelogram);
}

double sizeForPatches(const FacetSet& facets, size_t count) {
  std::vector<EdgeLengths> edges;
  for (const Facet& f : facets.facets) edges.push_back(edgeLengths(facets, f));
  return sizeForCount(facets, edges, targetCells(facets, count)) * facets.frame.size;
}

double sizeForClusters(const FacetSet& facets, size_t count) {
  double area = 0;
  for (const Facet& f : facets.facets) area += f.area;
  return std::sqrt(area / static_cast<double>(count)) * facets.frame.size;
}

std::vector<uint32_t> joinedTo(const PatchSet& wider, const PatchSet& patches, const FacetSet& facets) {
  std::vector<uint32_t> joined(patches.size());
  for (uint32_t p = 0; p < joined.size(); ++p) {
    const Cell& cell = patches.cells[patches.cellsOf(p)[0]];
    const bool parallelogram = facets.facets[cell.facet].parallelogram;
    const double middle = parallelogram ? 0.5 : 1.0 / 3;
    const Vec2 at = cellPoint(patches.grids[cell.facet], parallelogram, cell, middle, middle);
    const CellGrid& grid = wider.grids[cell.facet];
    joined[p] = wider.cellMap[(cell.back ? grid.backCell : grid.frontCell) + cellAt(grid, parallelogram, at.x, at.y)];
  }
  return joined;
}

std::vector<uint32_t> joinedCells(const PatchSet& patches, const FacetSet& facets, uint32_t along, uint32_t before) {
  std::vector<uint32_t> map(patches.cells.size());
  std::vector<uint32_t> numbers;  // of one facet's joined cells, on the side at hand
  uint32_t next = 0, facet = kNone;
  bool back = false;
  for (size_t c = 0; c < map.size(); ++c) {
    const Cell& cell = patches.cells[c];
    const bool parallelogram = facets.facets[cell.facet].parallelogram;
    const CellGrid& grid = patches.grids[cell.facet];
    const uint32_t shift = parallelogram ? before : 0;
    const CellGrid joined{(grid.nu + shift + along - 1) / along, (grid.nv + shift + along - 1) / along, 0, kNone};
    if (cell.facet != facet || cell.back != back) {
      facet = cell.facet;
      back = cell.back;
      numbers.assign(joined.count(parallelogram), kNone);
    }
    // A triangle's cells make no whole rows where their number is no multiple: each goes where its centre lies.
    const Vec2 centre = cellPoint(grid, false, cell, 1.0 / 3, 1.0 / 3);
    const uint32_t at =
        parallelogram ? (cell.v + shift) / along * joined.nu + (cell.u + shift) / along : cellAt(joined, false, centre.x, centre.y);
    if (numbers[at] == kNone) numbers[at] = next++;
    map[c] = numbers[at];
  }
  return map;
}

uint32_t coarserCell(const CellGrid& grid, bool parallelogram, const Cell& cell, uint32_t steps) {
  const CellGrid coarser{grid.nu >> steps, grid.nv >> steps, 0, kNone};
  const Vec2 centre = parallelogram ? cellPoint(grid, true, cell, 0.5, 0.5) : cellPoint(grid, false, cell, 1.0 / 3, 1.0 / 3);
  return cellAt(coarser, parallelogram, centre.x, centre.y);
}

std::array<uint32_t, 4> finerCells(const CellGrid& grid, bool parallelogram, uint32_t number) {
  if (parallelogram) {
    const uint32_t u = 2 * (number % grid.nu), v = 2 * (number / grid.nu), width = 2 * grid.nu;
    return {v * width + u, v * width + u + 1, (v + 1) * width + u, (v + 1) * width + u + 1};
  }
  uint32_t v = 0;
  while (triangleRow(grid.nu, v + 1) <= number) ++v;
  const uint32_t place = number - triangleRow(grid.nu, v), u = place / 2, n = 2 * grid.nu;
  const auto cell = [&](uint32_t i, uint32_t j, uint32_t inverted) { return triangleRow(n, j) + 2 * i + inverted; };
  if (place % 2 == 0) return {cell(2 * u, 2 * v, 0), cell(2 * u, 2 * v, 1), cell(2 * u + 1, 2 * v, 0), cell(2 * u, 2 * v + 1, 0)};
  return {cell(2 * u + 1, 2 * v, 1), cell(2 * u, 2 * v + 1, 1), cell(2 * u + 1, 2 * v + 1, 0), cell(2 * u + 1, 2 * v + 1, 1)};
}

std::vector<Piece> piecesOf(const FacetSet& facets, const PatchSet& patches, uint32_t patch) {
  const auto cells = patches.cellsOf(patch);
  const Cell& first = patches.cells[cells[0]];
  const CellGrid& grid = patches.grids[first.facet];
  const Facet& facet = facets.facets[first.facet];
  // From (u,v) as cells count, `du` and `dv` cells along; both below 0 for inverted triangles.
  const auto piece = [&](const Facet& f, uint32_t number, const CellGrid& g, double u, double v, double du, double dv,
                         size_t count) {
    const auto point = [&](double x, double y) { return facets.point(f, x / g.nu, y / g.nv); };
    const Vec3 origin = point(u, v);
    return Piece{origin,
                 point(u + du, v) - origin,
                 point(u, v + dv) - origin,
                 first.back ? -f.normal : f.normal,
                 !f.parallelogram,
                 number,
                 static_cast<double>(count) * cellArea(facets, g, number)};
  };
  const auto single = [&](const Cell& c) {
    const CellGrid& g = patches.grids[c.facet];
    const double step = c.inverted ? -1 : 1, shift = c.inverted ? 1 : 0;
    return piece(facets.facets[c.facet], c.facet, g, c.u + shift, c.v + shift, step, step, 1);
  };
  if (cells.size() == 1) return {single(first)};

  uint32_t lowU = first.u, lowV = first.v, highU = first.u, highV = first.v;
  bool oneFacet = true;
  for (const uint32_t c : cells) {
    const Cell& cell = patches.cells[c];
    oneFacet &= cell.facet == first.facet && cell.back == first.back;
    lowU = std::min(lowU, cell.u);
    lowV = std::min(lowV, cell.v);
    highU = std::max(highU, cell.u);
    highV = std::max(highV, cell.v);
  }
  const double along = highU + 1.0 - lowU, across = highV + 1.0 - lowV;
  const auto count = static_cast<double>(cells.size());
  if (oneFacet && facet.parallelogram && along * across == count)
    return {piece(facet, first.facet, grid, lowU, lowV, along, across, cells.size())};
  if (oneFacet && !facet.parallelogram && along == across && along * along == count) {
    bool upright = true, inverted = true;  // as many cells as a triangle of that side has, all of them in it
    for (const uint32_t c : cells) {
      const Cell& cell = patches.cells[c];
      const double beyond = (cell.u - lowU) + (cell.v - lowV) + (cell.inverted ? 4.0 : 2.0) / 3;  // of a cell's centre
      upright &= beyond < along;
      inverted &= 2 * along - beyond < along;
    }
    if (upright) return {piece(facet, first.facet, grid, lowU, lowV, along, along, cells.size())};
    if (inverted) return {piece(facet, first.facet, grid, highU + 1.0, highV + 1.0, -along, -along, cells.size())};
  }
  std::vector<Piece> pieces;
  for (const uint32_t c : cells) pieces.push_back(single(patches.cells[c]));
  return pieces;
}

PatchSet buildPatches(const Scene& scene, const FacetSet& facets, const PatchOptions& options) {
  std::vector<EdgeLengths> edges;
  for (const Facet& f : facets.facets) edges.push_back(edgeLengths(facets, f));
  const bool clustered = options.cluster > 0 && options.levels == 0;
  double size = options.size / facets.frame.size;
  if (size <= 0 && clustered) {
    size = sizeForClusters(facets, options.count) / facets.frame.size;
  } else if (size <= 0) {
    size = sizeForCount(facets, edges, targetCells(facets, options.count));
  }
  constexpr double kMaxCells = 1u << 30;
  if (const double count = std::ldexp(countCells(facets, edges, size), 2 * static_cast<int>(options.levels)); count > kMaxCells) {
    throw Error("{}: a patch size of {} would make {:.3g} patches; at most {:.3g} are possible", scene.path,
                size * facets.frame.size, count, kMaxCells);
  }
  PatchSet set;
  for (const Surface& s : scene.surfaces) set.media.push_back(mediumOf(scene.materials[s.material]));
  set.grids.resize(facets.facets.size());
  for (size_t i = 0; i < edges.size(); ++i) {
    set.grids[i].nu = static_cast<uint32_t>(cellsAlong(edges[i].u, size)) << options.levels;
    set.grids[i].nv = static_cast<uint32_t>(cellsAlong(edges[i].v, size)) << options.levels;
  }
  addCells(set, facets, false);
  set.frontPatchCount = set.cells.size();
  addCells(set, facets, true);
  std::vector<uint32_t> identity(set.cells.size());
  for (uint32_t i = 0; i < identity.size(); ++i) identity[i] = i;
  mapCells(set, scene, facets, std::move(identity));
  if (clustered) mapCells(set, scene, facets, clusteredCells(set, facets, size * facets.frame.size, options.cluster));
  return set;
}

void mapCells(PatchSet& set, const Scene& scene, const FacetSet& facets, std::vector<uint32_t> cellMap) {
  set.cellMap = std::move(cellMap);
  const uint32_t count = *std::max_element(set.cellMap.begin(), set.cellMap.end()) + 1;
  set.patches.assign(count, Patch{});
  set.firstCell.assign(count + 1, 0);
  for (const uint32_t patch : set.cellMap) ++set.firstCell[patch + 1];
  for (uint32_t p = 0; p < count; ++p) set.firstCell[p + 1] += set.firstCell[p];
  set.patchCells.resize(set.cells.size());
  std::vector<uint32_t> next(set.firstCell.begin(), set.firstCell.end() - 1);
  std::vector<Vec3> normals(count, Vec3(0));  // weighted by area
  std::vector<bool> bent(count, false);
  set.frontPatchCount = 0;
  for (uint32_t c = 0; c < set.cells.size(); ++c) {
    const uint32_t p = set.cellMap[c];
    set.patchCells[next[p]++] = c;
    const Cell& cell = set.cells[c];
    const Facet& facet = facets.facets[cell.facet];
    const CellGrid& grid = set.grids[cell.facet];
    Patch& patch = set.patches[p];
    patch.surface = facet.surface;
    patch.back = cell.back;
    const double area = cellArea(facets, grid, cell.facet);
    const Vec3 normal = cell.back ? -facet.normal : facet.normal;
    if (normals[p] == Vec3(0)) patch.normal = normal;
    bent[p] = bent[p] || normal != patch.normal;
    normals[p] += area * normal;
    const Vec2 uv = facet.parallelogram ? cellPoint(grid, true, cell, 0.5, 0.5) : cellPoint(grid, false, cell, 1.0 / 3, 1.0 / 3);
    const Optics optics = cellOptics(scene, facet, grid, cell);
    if (maxChannel(optics.diffuse + optics.specular + optics.transmission) > 1 + 1e-9) {
      throw Error("{}: surface '{}': reflectance {} is above 1", scene.path, scene.surfaces[facet.surface].name,
                  maxChannel(optics.diffuse + optics.specular + optics.transmission));
    }
    patch.area += area;
    patch.centre += area * facets.frame.toScene(facets.point(facet, uv.x, uv.y));
    patch.reflectance += area * optics.diffuse;
    patch.mirror += area * optics.specular;
    patch.transmission += area * optics.transmission;
    patch.emission += area * optics.emission;
  }
  for (Patch& patch : set.patches) {
    patch.centre /= patch.area;
    patch.reflectance /= patch.area;
    patch.mirror /= patch.area;
    patch.transmission /= patch.area;
    patch.emission /= patch.area;
    if (!patch.back) ++set.frontPatchCount;
  }
  for (uint32_t p = 0; p < count; ++p) {  // of flat patches exactly the facet's
    if (bent[p]) set.patches[p].normal = glm::normalize(normals[p]);
  }
}

void keepPatches(PatchSet& set, const std::vector<uint32_t>& kept) {
  std::vector<uint32_t> renumbered(set.size(), kNone), firstCell{0}, patchCells;
  std::vector<Patch> patches;
  set.frontPatchCount = 0;
  for (const uint32_t p : kept) {
    renumbered[p] = static_cast<uint32_t>(patches.size());
    patches.push_back(set.patches[p]);
    if (!set.patches[p].back) ++set.frontPatchCount;
    const auto cells = set.cellsOf(p);
    patchCells.insert(patchCells.end(), cells.begin(), cells.end());
    firstCell.push_back(static_cast<uint32_t>(patchCells.size()));
  }
  for (uint32_t& p : set.cellMap) p = p == kNone ? kNone : renumbered[p];
  set.patches = std::move(patches);
  set.firstCell = std::move(firstCell);
  set.patchCells = std::move(patchCells);
}

std::string surfaceNameOf(const Scene& scene, const Patch& patch) {
  const std::string& name = scene.surfaces[patch.surface].name;
  return patch.back ? name + "~back" : name;
}

}  // namespace farol
