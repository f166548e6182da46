#include "formfactor/projection.h"

#include "formfactor/analytic.h"

#include <algorithm>
#include <numeric>

namespace farol {
namespace {

// Form factor from a point to the rectangle [0,x] x [0,y] of a parallel plane at distance 1 (odd in x and y).
// The mixed derivative is the delta form factor 1 / (pi (x^2 + y^2 + 1)^2), Cohen and Greenberg 1985 with the
// square that printed versions of it sometimes lack.
double topCorner(double x, double y) {
  const double p = std::sqrt(1 + x * x), q = std::sqrt(1 + y * y);
  return (x / p * std::atan(y / p) + y / q * std::atan(x / q)) / (2 * kPi);
}

// Form factor from a point to the rectangle [0,y] x [0,z] of a perpendicular plane at distance 1 that stands on
// the point's horizon. Mixed derivative: z / (pi (y^2 + z^2 + 1)^2).
double sideCorner(double y, double z) {
  const double q = std::sqrt(1 + z * z);
  return (std::atan(y) - std::atan(y / q) / q) / (2 * kPi);
}

template <typename Corner>
void addFace(std::vector<double>& atlas, uint32_t atlasWidth, const ProjectionFace& face, Corner corner) {
  const auto at = [](double low, uint32_t i, uint32_t n) { return low + (1 - low) * i / n; };
  for (uint32_t j = 0; j < face.height; ++j) {
    const double y0 = at(face.bottom, j, face.height), y1 = at(face.bottom, j + 1, face.height);
    for (uint32_t i = 0; i < face.width; ++i) {
      const double x0 = at(face.low, i, face.width), x1 = at(face.low, i + 1, face.width);
      atlas[static_cast<size_t>(face.y + j) * atlasWidth + face.x + i] =
          corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0);
    }
  }
}

void addTetrahedronFace(std::vector<double>& atlas, uint32_t atlasWidth, const ProjectionFace& face) {
  const uint32_t n = face.width;
  const auto at = [n](uint32_t i) { return -2 + 3.0 * i / n; };
  // In the face's own axes (right, up, forward) the patch normal is (1,1,1)/sqrt 3, so the horizon x + y = -1
  // is the anti-diagonal i + j = n of the pixel corners.
  const Vec3 normal = glm::normalize(Vec3(1, 1, 1));
  const auto point = [&](uint32_t i, uint32_t j) { return Vec3(at(i), at(j), 1); };
  const auto cell = [&](uint32_t i, uint32_t j) -> double& {
    return atlas[static_cast<size_t>(face.y + j) * atlasWidth + face.x + i];
  };
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = n - 1 - j; i < n; ++i) {
      const Vec3 b = point(i + 1, j), c = point(i + 1, j + 1), d = point(i, j + 1);
      if (i + j + 1 == n) {  // cut by the horizon: the triangle b c d, given to the neighbours above
        const double half = lambertEdge(normal, b, c) + lambertEdge(normal, c, d) + lambertEdge(normal, d, b);
        const bool right = i + 1 < n, up = j + 1 < n;
        if (right) cell(i + 1, j) += up ? 0.5 * half : half;
        if (up) cell(i, j + 1) += right ? 0.5 * half : half;
      } else {
        const Vec3 a = point(i, j);
        cell(i, j) += lambertEdge(normal, a, b) + lambertEdge(normal, b, c) + lambertEdge(normal, c, d) + lambertEdge(normal, d, a);
      }
    }
  }
}

}  // namespace

ProjectionLayout layoutOf(Projection projection, uint32_t r) {
  const Vec3 x(1, 0, 0), y(0, 1, 0), n(0, 0, 1);
  ProjectionLayout layout{3 * r, r, {}};
  if (projection == Projection::hemicube) {
    const uint32_t h = r / 2;
    layout.faces = {{x, y, n, -1, -1, 0, 0, r, r},
                    {y, n, x, -1, 0, r, 0, r, h},
                    {-y, n, -x, -1, 0, r, h, r, h},
                    {-x, n, y, -1, 0, 2 * r, 0, r, h},
                    {x, n, -y, -1, 0, 2 * r, h, r, h}};
    return layout;
  }
  const double third = 1 / std::sqrt(3.0), sixth = 1 / std::sqrt(6.0), half = 1 / std::sqrt(2.0);
  const Vec3 a(2 * sixth, 0, third), b(-sixth, half, third), c(-sixth, -half, third);
  layout.faces = {{b, c, a, -2, -2, 0, 0, r, r}, {c, a, b, -2, -2, r, 0, r, r}, {a, b, c, -2, -2, 2 * r, 0, r, r}};
  return layout;
}

std::vector<double> deltaFormFactors(Projection projection, uint32_t resolution) {
  const ProjectionLayout layout = layoutOf(projection, resolution);
  std::vector<double> atlas(static_cast<size_t>(layout.width) * layout.height, 0.0);
  for (size_t i = 0; i < layout.faces.size(); ++i) {
    if (projection == Projection::tetrahedron)
      addTetrahedronFace(atlas, layout.width, layout.faces[i]);
    else if (i == 0)
      addFace(atlas, layout.width, layout.faces[i], topCorner);
    else
      addFace(atlas, layout.width, layout.faces[i], sideCorner);
  }
  return atlas;
}

std::vector<uint32_t> quantisedFormFactors(Projection projection, uint32_t resolution) {
  const std::vector<double> exact = deltaFormFactors(projection, resolution);
  constexpr uint64_t kTotal = 0xFFFFFFFFull;
  const double scale = static_cast<double>(kTotal) / std::accumulate(exact.begin(), exact.end(), 0.0);
  std::vector<uint32_t> result(exact.size());
  std::vector<std::pair<double, uint32_t>> remainders;  // (-remainder, pixel): largest first, then in order
  uint64_t sum = 0;
  for (uint32_t i = 0; i < exact.size(); ++i) {
    const double value = std::max(exact[i], 0.0) * scale, whole = std::floor(value);
    result[i] = static_cast<uint32_t>(whole);
    sum += result[i];
    remainders.emplace_back(whole - value, i);
  }
  const auto missing = static_cast<std::ptrdiff_t>(kTotal - std::min(sum, kTotal));
  std::nth_element(remainders.begin(), remainders.begin() + missing, remainders.end());
  for (std::ptrdiff_t k = 0; k < missing; ++k) ++result[remainders[static_cast<size_t>(k)].second];
  return result;
}

}  // namespace farol
