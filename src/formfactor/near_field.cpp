#include "formfactor/near_field.h"

#include "formfactor/analytic.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace farol {

UnoccludedFactor::UnoccludedFactor(const FacetSet& facets, const PatchSet& patches)
    : facets_(facets), patches_(patches), radii_(patches.size(), 0.0), polygons_(patches.size()) {
  for (uint32_t i = 0; i < patches.size(); ++i) {
    centres_.push_back(facets.frame.toUnit(patches.patches[i].centre));
    sizes_.push_back(std::sqrt(patches.patches[i].area) / facets.frame.size);
    for (const Piece& piece : piecesOf(facets, patches, i)) {
      std::vector<Vec3> polygon = {piece.origin, piece.at(1, 0)};
      if (!piece.triangle) polygon.push_back(piece.at(1, 1));
      polygon.push_back(piece.at(0, 1));
      if (patches.patches[i].back) std::reverse(polygon.begin(), polygon.end());
      for (const Vec3& v : polygon) radii_[i] = std::max(radii_[i], glm::distance(v, centres_[i]));
      polygons_[i].push_back(std::move(polygon));
    }
  }
}

double UnoccludedFactor::operator()(uint32_t i, uint32_t j, int n) const {
  if (i == j || !faceEachOther(i, j)) return 0;
  if (n == 0) {
    const double gap = glm::distance(centres_[i], centres_[j]) - radii_[i] - radii_[j], r = radii_[i];
    n = gap < 0.5 * r ? 16 : gap < 2 * r ? 8 : gap < 5 * r ? 5 : gap < 20 * r ? 3 : 2;
  }
  // Each of several pieces gets four times as many.
  const size_t pieces = polygons_[i].size();
  const auto points =
      positionsOn(facets_, patches_, i, static_cast<int>(static_cast<size_t>(n * n) * (pieces == 1 ? 1 : 4 * pieces)), i);
  return from(points, i, j);
}

bool UnoccludedFactor::faceEachOther(uint32_t i, uint32_t j) const {
  const auto above = [&](uint32_t a, uint32_t b) {  // some of b is above a's plane
    for (const auto& polygon : polygons_[b]) {
      for (const Vec3& v : polygon) {
        if (glm::dot(patches_.patches[a].normal, v - centres_[a]) > kRayOffset) return true;
      }
    }
    return false;
  };
  return above(i, j) && above(j, i);
}

double UnoccludedFactor::from(std::span<const Position> points, uint32_t i, uint32_t j) const {
  double sum = 0;
  for (const Position& p : points) {
    for (const auto& polygon : polygons_[j]) sum += p.weight * pointToPolygon(p.point, patches_.patches[i].normal, polygon);
  }
  return sum;
}

double UnoccludedFactor::fromCentre(uint32_t i, uint32_t j) const {
  const Vec3& n = patches_.patches[i].normal;
  const Vec3 d = centres_[j] - centres_[i];
  const double squared = glm::dot(d, d), area = sizes_[j] * sizes_[j];
  constexpr double kFar = 9;
  if (squared > kFar * std::max(area, radii_[j] * radii_[j])) {
    const double ci = glm::dot(n, d), cj = -glm::dot(patches_.patches[j].normal, d);
    return ci <= 0 || cj <= 0 ? 0 : area * ci * cj / (kPi * squared * squared);
  }
  if (!faceEachOther(i, j)) return 0;
  double sum = 0;
  for (const auto& polygon : polygons_[j]) sum += pointToPolygon(centres_[i], n, polygon);
  return sum;
}

NearField::NearField(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const ExposedArea& exposed,
                     uint64_t seed, double worthIt)
    : tracer_(tracer),
      facets_(facets),
      patches_(patches),
      exposed_(exposed),
      seed_(seed),
      worthIt_(worthIt),
      factor_(facets, patches),
      nearest_(factor_.centres(), factor_.sizes()) {}

std::vector<Position> NearField::exposedPoints(uint32_t i) const {
  return exposedPositions(tracer_, facets_, positionsOn(facets_, patches_, i, 64, seed_ + i), patches_.patches[i].normal);
}

double NearField::visibleShare(std::span<const Position> from, uint32_t i, uint32_t j) const {
  const auto to = positionsOn(facets_, patches_, j, 16, seed_ + j);
  const Vec3 &ni = patches_.patches[i].normal, &nj = patches_.patches[j].normal;
  RayPacket packet;
  double kernel[kPacketSize];
  uint32_t lanes = 0;
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    // A Latin pairing: every point of one patch meets one of the other, near and far ones in turn.
    const Vec3 p = from[k * from.size() / kPacketSize].point + kRayOffset * ni,
               q = to[(k * 7 + 3) % to.size()].point + kRayOffset * nj, d = q - p;
    const double squared = glm::dot(d, d), ci = glm::dot(ni, d), cj = -glm::dot(nj, d);
    if (ci <= 0 || cj <= 0) continue;
    kernel[lanes] = ci * cj / (squared * squared);
    packet.set(lanes++, p, d);
  }
  if (lanes == 0) return 1;
  const uint32_t hidden = tracer_.occluded(packet, firstRays(lanes));
  double all = 0, visible = 0;
  for (uint32_t k = 0; k < lanes; ++k) {
    all += kernel[k];
    if ((hidden >> k & 1) == 0) visible += kernel[k];
  }
  return visible / all;
}

std::vector<NearField::Entry> NearField::nearEntries(uint32_t patch) const {
  constexpr size_t kMost = 16;
  constexpr double kSmallest = 1e-5, kLarge = 0.05;  // factors; a row has few large ones, which need more points
  static thread_local std::vector<NearPatches::Near> near;
  near.clear();
  nearest_.find(
      patch, kMost, worthIt_,
      [&](uint32_t j) {
        const double f = factor_.fromCentre(patch, j);
        return f < kSmallest ? 0 : f;
      },
      near);
  if (near.empty()) return {};
  const bool partly = exposed_.share[patch] < 1;
  const std::vector<Position> points =
      partly ? exposedPoints(patch) : positionsOn(facets_, patches_, patch, kPacketSize, seed_ + patch);
  if (points.empty()) return {};
  const double h = factor_.sizes()[patch];
  std::vector<Entry> entries;
  for (const NearPatches::Near& n : near) {
    const double d = glm::distance(factor_.centres()[n.patch], factor_.centres()[patch]);
    const double unoccluded = partly ? factor_.from(points, patch, n.patch)
                                     : factor_(patch, n.patch,
                                               n.factor > kLarge ? 8
                                               : d > 3 * h       ? 2
                                               : d > 1.5 * h     ? 3
                                                                 : 4);
    entries.push_back({n.patch, unoccluded * visibleShare(points, patch, n.patch), n.patch});
  }
  return entries;
}

void NearField::put(std::span<const Entry> near, std::span<float> row, RowShares& shares) const {
  double whole = shares.missed + shares.backs, sampled = 0, exact = 0;
  for (const float f : row) whole += static_cast<double>(f);
  for (const Entry& e : near) {
    sampled += static_cast<double>(row[e.place]);
    exact += e.value;
  }
  if (exact <= 0) return;
  const double rest = whole - sampled, scale = (whole - exact) / rest;
  const bool enough = rest > 0 && scale > 0.5 && scale < 2;
  const double far = enough ? scale : 1, close = enough ? 1 : sampled / exact;
  for (float& f : row) f = static_cast<float>(static_cast<double>(f) * far);
  for (const Entry& e : near) row[e.place] = static_cast<float>(e.value * close);
  shares.missed *= far;
  shares.backs *= far;
  shares.correction = enough ? far : close;
}

void NearField::correct(uint32_t patch, std::span<float> row, RowShares& shares) const {
  std::vector<Entry> near = nearEntries(patch);
  // From a mirror or glass that no pixel shows no path goes on.
  std::erase_if(near, [&](const Entry& e) { return row[e.place] <= 0 && patches_.patches[e.patch].isSpecular(); });
  put(near, row, shares);
}

void NearField::correct(uint32_t patch, std::vector<uint32_t>& ids, std::vector<float>& values, RowShares& shares) const {
  std::vector<Entry> near = nearEntries(patch);
  const auto placeOf = [&](uint32_t j) { return std::lower_bound(ids.begin(), ids.end(), j) - ids.begin(); };
  for (const Entry& e : near) {
    const auto at = placeOf(e.patch);
    if (at < std::ssize(ids) && ids[static_cast<size_t>(at)] == e.patch) continue;
    ids.insert(ids.begin() + at, e.patch);
    values.insert(values.begin() + at, 0.0f);
  }
  for (Entry& e : near) e.place = static_cast<size_t>(placeOf(e.patch));
  put(near, values, shares);
}

namespace {

// True when a plane with one of a few normals has all of `a` on one side and all of `b` on the other.
bool separated(std::span<const Vec3> a, std::span<const Vec3> b, std::span<const Vec3> axes) {
  constexpr double kTouch = kRayOffset;
  for (const Vec3& axis : axes) {
    double aLow = 1e300, aHigh = -1e300, bLow = 1e300, bHigh = -1e300;
    for (const Vec3& p : a) {
      aLow = std::min(aLow, glm::dot(axis, p));
      aHigh = std::max(aHigh, glm::dot(axis, p));
    }
    for (const Vec3& p : b) {
      bLow = std::min(bLow, glm::dot(axis, p));
      bHigh = std::max(bHigh, glm::dot(axis, p));
    }
    if (aHigh <= bLow + kTouch || bHigh <= aLow + kTouch) return true;
  }
  return false;
}

std::vector<Vec3> cornersOf(const FacetSet& set, const Facet& f) {
  std::vector<Vec3> corners;
  for (size_t k = 0; k < f.cornerCount(); ++k) corners.push_back(set.points[f.corners[k]]);
  return corners;
}

// The part of a polygon in front of a plane.
std::vector<Vec3> inFront(std::span<const Vec3> polygon, const Vec3& normal, const Vec3& point) {
  std::vector<Vec3> kept;
  for (size_t k = 0; k < polygon.size(); ++k) {
    const Vec3 &a = polygon[k], &b = polygon[(k + 1) % polygon.size()];
    const double ha = glm::dot(normal, a - point) - kRayOffset, hb = glm::dot(normal, b - point) - kRayOffset;
    if (ha >= 0) kept.push_back(a);
    if ((ha > 0 && hb < 0) || (ha < 0 && hb > 0)) kept.push_back(a + ha / (ha - hb) * (b - a));
  }
  return kept;
}

}  // namespace

std::string whatMayBlock(const Scene& scene, const FacetSet& set) {
  constexpr size_t kMost = 64;
  const size_t n = set.facets.size();
  if (n > kMost) return fmt::format("{} facets are too many to look for what stands between them", n);
  std::vector<std::vector<Vec3>> corners;
  for (const Facet& f : set.facets) corners.push_back(cornersOf(set, f));
  const auto nameOf = [&](size_t f) { return scene.surfaces[set.facets[f].surface].name; };
  for (size_t a = 0; a < n; ++a) {
    for (size_t b = a + 1; b < n; ++b) {
      const Facet &fa = set.facets[a], &fb = set.facets[b];
      // Sides that see each other: all four for double-sided facets.
      for (const double sa : {1.0, -1.0}) {
        for (const double sb : {1.0, -1.0}) {
          if ((sa < 0 && !fa.doubleSided) || (sb < 0 && !fb.doubleSided)) continue;
          const auto partA = inFront(corners[a], sb * fb.normal, corners[b][0]);
          const auto partB = inFront(corners[b], sa * fa.normal, corners[a][0]);
          if (partA.empty() || partB.empty()) continue;
          std::vector<Vec3> both = partA;
          both.insert(both.end(), partB.begin(), partB.end());
          for (size_t c = 0; c < n; ++c) {
            if (c == a || c == b) continue;
            const auto blocker = inFront(inFront(corners[c], sa * fa.normal, corners[a][0]), sb * fb.normal, corners[b][0]);
            if (blocker.empty()) continue;
            std::vector<Vec3> axes = {fa.normal, fb.normal, set.facets[c].normal, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
            for (size_t k = 0; k < both.size(); ++k) {
              for (size_t l = 0; l < blocker.size(); ++l) {
                const Vec3 axis = glm::cross(both[(k + 1) % both.size()] - both[k], blocker[(l + 1) % blocker.size()] - blocker[l]);
                if (glm::length(axis) > 1e-9) axes.push_back(glm::normalize(axis));
              }
            }
            if (!separated(both, blocker, axes))
              return fmt::format("surface '{}' may stand between '{}' and '{}'", nameOf(c), nameOf(a), nameOf(b));
          }
        }
      }
    }
  }
  return "";
}

void ExactRowMaker::makeRows(std::span<const uint32_t> wanted, RowStore& store, const std::function<void(size_t)>& done) {
  constexpr size_t kRound = 64;
  for (size_t first = 0; first < wanted.size(); first += kRound) {
    const size_t last = std::min(first + kRound, wanted.size());
    tbb::parallel_for(first, last, [&](size_t k) {
      const uint32_t i = wanted[k];
      const std::span<float> row = store.row(i);
      double sum = 0;
      for (uint32_t j = 0; j < row.size(); ++j) {
        const double f = factor_(i, j);
        row[j] = static_cast<float>(f);
        sum += f;
      }
      store.finish(i, {std::max(0.0, 1 - sum), 0, 1});
    });
    done(last);
  }
}

}  // namespace farol
