#include "patch/positions.h"

namespace farol {
namespace {

// Point (s,t) of a piece. For triangles the square is folded onto s + t <= 1.
Vec3 pointOf(const Piece& piece, double s, double t) {
  return piece.triangle && s + t > 1 ? piece.at(1 - s, 1 - t) : piece.at(s, t);
}

std::vector<Position> gaussPositions(const Piece& piece, int n) {
  static thread_local std::vector<GaussRule> rules(65);  // made once per thread: they cost more than the points
  GaussRule& rule = rules[std::min<size_t>(static_cast<size_t>(n), 64)];
  if (rule.nodes.size() != static_cast<size_t>(n)) rule = gaussLegendre(n);
  std::vector<Position> result;
  for (size_t j = 0; j < rule.nodes.size(); ++j) {
    for (size_t i = 0; i < rule.nodes.size(); ++i) {
      double s = rule.nodes[i], weight = rule.weights[i] * rule.weights[j];
      const double t = rule.nodes[j];
      if (piece.triangle) {  // collapse the side t = 1 to a point; the Jacobian is 2 (1 - t) per unit of area
        s *= 1 - t;
        weight *= 2 * (1 - t);
      }
      result.push_back({pointOf(piece, s, t), weight, piece.normal});
    }
  }
  return result;
}

// Of the centres of a patch's pieces the one nearest to the patch's centroid, which may lie outside of the patch.
Vec3 centreNearest(const Vec3& centroid, std::span<const Piece> pieces) {
  Vec3 nearest(1e300);
  for (const Piece& piece : pieces) {
    const double middle = piece.triangle ? 1.0 / 3 : 0.5;
    const Vec3 centre = piece.at(middle, middle);
    if (glm::distance(centre, centroid) < glm::distance(nearest, centroid)) nearest = centre;
  }
  return nearest;
}

}  // namespace

GaussRule gaussLegendre(int n) {
  GaussRule rule;
  for (int i = 0; i < n; ++i) {
    // Newton's method on the Legendre polynomial from Tricomi's estimate of its i-th root.
    double x = std::cos(kPi * (i + 0.75) / (n + 0.5)), slope = 1;
    for (int step = 0; step < 20; ++step) {
      double p = 1, previous = 0;
      for (int k = 0; k < n; ++k) {
        const double next = ((2 * k + 1) * x * p - k * previous) / (k + 1);
        previous = p;
        p = next;
      }
      slope = n * (x * p - previous) / (x * x - 1);
      x -= p / slope;
    }
    rule.nodes.push_back(0.5 * (1 - x));
    rule.weights.push_back(1 / ((1 - x * x) * slope * slope));
  }
  return rule;
}

std::vector<Position> positionsOn(const FacetSet& facets, const PatchSet& patches, uint32_t patch, int count, uint64_t seed) {
  const std::vector<Piece> pieces = piecesOf(facets, patches, patch);
  if (count == 1)
    return {{centreNearest(facets.frame.toUnit(patches.patches[patch].centre), pieces), 1.0, patches.patches[patch].normal}};
  if (pieces.size() == 1) {
    const int root = static_cast<int>(std::lround(std::sqrt(count)));
    if (root * root == count) return gaussPositions(pieces[0], root);
  }
  double total = 0;
  for (const Piece& piece : pieces) total += piece.area;
  const int each = static_cast<int>(std::sqrt(static_cast<double>(count) / static_cast<double>(pieces.size())));
  if (pieces.size() > 1 && each > 1) {
    std::vector<Position> result;
    for (const Piece& piece : pieces) {
      for (Position p : gaussPositions(piece, each)) {
        p.weight *= piece.area / total;
        result.push_back(p);
      }
    }
    return result;
  }
  constexpr double kPlastic = 1.32471795724474602596;  // root of x^3 = x + 1
  const double shiftS = unitFromBits(mixBits(seed)), shiftT = unitFromBits(mixBits(seed + 1));
  std::vector<Position> result;
  size_t at = 0;
  double before = 0;  // area of the pieces before `at`
  for (int k = 0; k < count; ++k) {
    const double area = (k + 0.5) / count * total;
    while (at + 1 < pieces.size() && before + pieces[at].area < area) before += pieces[at++].area;
    const double s = std::fmod(shiftS + (k + 1) / kPlastic, 1.0);
    const double t = std::fmod(shiftT + (k + 1) / (kPlastic * kPlastic), 1.0);
    result.push_back({pointOf(pieces[at], s, t), 1.0 / count, pieces[at].normal});
  }
  return result;
}

}  // namespace farol
