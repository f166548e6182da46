#include "patch/contacts.h"

#include <algorithm>
#include <numeric>
#include <optional>

namespace farol {
namespace {

// [unit coordinates], but the shares and the number.
constexpr double kNear = 0.005;       // that far in front of a facet counts as touching it: well below the size of a patch
constexpr double kLeastSide = 0.1;    // of a facet: smaller ones have few patches
constexpr double kLeastShare = 0.25;  // of the side, that a line must have
constexpr double kApart = 0.005;      // of lines, from each other and from the borders
constexpr double kStraight = 1e-5;    // by which a line may leave the side's direction
constexpr size_t kMost = 6;           // lines of one direction: of more none is taken

// A parallelogram in its own coordinates.
class Plane {
 public:
  Plane(const FacetSet& set, const Facet& f)
      : origin_(set.points[f.corners[0]]),
        u_(set.points[f.corners[1]] - origin_),
        v_(set.points[f.vCorner()] - origin_),
        normal_(f.normal) {}

  Vec2 sides() const { return {glm::length(u_), glm::length(v_)}; }
  double height(const Vec3& p) const { return glm::dot(normal_, p - origin_); }
  Vec2 place(const Vec3& p) const {  // (u,v) of the point below p
    const Vec3 d = p - origin_;
    const double uu = glm::dot(u_, u_), uv = glm::dot(u_, v_), vv = glm::dot(v_, v_), du = glm::dot(d, u_), dv = glm::dot(d, v_);
    return Vec2(du * vv - dv * uv, dv * uu - du * uv) / (uu * vv - uv * uv);
  }

 private:
  Vec3 origin_, u_, v_, normal_;
};

struct Found {
  double at, height, from, to;  // along it
};

class LinesOfFacet {
 public:
  LinesOfFacet(const FacetSet& set, const Facet& facet)
      : set_(set), plane_(set, facet), sides_(plane_.sides()), lowest_(facet.doubleSided ? -kNear : -kWeldTolerance) {}

  bool isLarge() const { return std::min(sides_.x, sides_.y) >= kLeastSide; }

  // Edges of `other` that are near, and where it passes through the plane.
  void add(const Facet& other) {
    const size_t n = other.cornerCount();
    std::array<double, 4> heights{};
    double low = 1e300, high = -1e300;
    for (size_t k = 0; k < n; ++k) {
      heights[k] = plane_.height(point(other, k));
      low = std::min(low, heights[k]);
      high = std::max(high, heights[k]);
    }
    if (low > kNear || high < lowest_) return;
    const auto near = [&](double height) { return height >= lowest_ && height <= kNear; };
    std::optional<Vec3> crossing;
    for (size_t k = 0; k < n; ++k) {
      const size_t next = (k + 1) % n;
      const Vec3 &a = point(other, k), &b = point(other, next);
      if (near(heights[k]) && near(heights[next])) addSegment(a, b, std::abs(heights[k]));
      if (low >= -kWeldTolerance || high <= kWeldTolerance || (heights[k] < 0) == (heights[next] < 0)) continue;
      const Vec3 p = a + heights[k] / (heights[k] - heights[next]) * (b - a);
      if (crossing) addSegment(*crossing, p, 0);
      crossing = p;
    }
  }

  ContactLines lines() { return {chosen(u_, sides_.x), chosen(v_, sides_.y)}; }

 private:
  const Vec3& point(const Facet& f, size_t k) const { return set_.points[f.corners[k]]; }

  void addSegment(const Vec3& from, const Vec3& to, double height) {
    const Vec2 a = plane_.place(from), b = plane_.place(to);
    for (const int across : {0, 1}) {  // the coordinate that stays the same
      const double low = std::clamp(std::min(a[1 - across], b[1 - across]), 0.0, 1.0);
      const double high = std::clamp(std::max(a[1 - across], b[1 - across]), 0.0, 1.0);
      if (std::abs(a[across] - b[across]) * sides_[across] <= kStraight && high - low >= kLeastShare)
        (across == 0 ? u_ : v_).push_back({0.5 * (a[across] + b[across]), height, low, high});
    }
  }

  // Of lines that lie too close together the nearest to the facet, and along it what is along any of them.
  static std::vector<ContactLine> chosen(std::vector<Found>& found, double side) {
    std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.height < b.height; });
    std::vector<ContactLine> lines;
    for (const Found& f : found) {
      const auto close = [&](double at) { return std::abs(f.at - at) * side < kApart; };
      if (f.at <= 0 || f.at >= 1 || close(0) || close(1)) continue;
      auto line = std::find_if(lines.begin(), lines.end(), [&](const ContactLine& l) { return close(l.at); });
      if (line == lines.end()) line = lines.insert(line, {f.at, {}});
      line->spans.emplace_back(f.from, f.to);
    }
    if (lines.size() > kMost) lines.clear();
    std::sort(lines.begin(), lines.end(), [](const ContactLine& a, const ContactLine& b) { return a.at < b.at; });
    return lines;
  }

  const FacetSet& set_;
  Plane plane_;
  Vec2 sides_;
  double lowest_;
  std::vector<Found> u_, v_;
};

// Whether something stands all along the line between two places on it, but for rounding and bevels.
bool isCovered(const ContactLine& line, double from, double to) {
  constexpr double kAlong = 0.95;
  return std::any_of(line.spans.begin(), line.spans.end(), [&](const auto& span) {
    return std::min(span.second, to) - std::max(span.first, from) >= kAlong * (to - from);
  });
}

}  // namespace

std::vector<ContactLines> contactLines(const FacetSet& set) {
  std::vector<ContactLines> result(set.facets.size());
  for (size_t f = 0; f < result.size(); ++f) {
    const Facet& facet = set.facets[f];
    if (!facet.parallelogram) continue;
    LinesOfFacet lines(set, facet);
    if (!lines.isLarge()) continue;
    for (size_t other = 0; other < result.size(); ++other) {
      if (other != f && !set.facets[other].transmits) lines.add(set.facets[other]);
    }
    result[f] = lines.lines();
  }
  return result;
}

std::vector<double> endsOf(const std::vector<ContactLine>& lines) {
  std::vector<double> ends = {0};
  for (const ContactLine& line : lines) ends.push_back(line.at);
  ends.push_back(1);
  return ends;
}

std::vector<uint32_t> regionsOf(const ContactLines& lines) {
  const std::vector<double> u = endsOf(lines.u), v = endsOf(lines.v);
  const size_t nu = u.size() - 1, nv = v.size() - 1;
  std::vector<uint32_t> region(nu * nv);
  std::iota(region.begin(), region.end(), 0);
  bool changed = true;
  const auto join = [&](uint32_t& a, uint32_t& b) {
    changed |= a != b;
    a = b = std::min(a, b);
  };
  while (changed) {
    changed = false;
    for (size_t j = 0; j < nv; ++j) {
      for (size_t i = 0; i < nu; ++i) {
        if (i + 1 < nu && !isCovered(lines.u[i], v[j], v[j + 1])) join(region[j * nu + i], region[j * nu + i + 1]);
        if (j + 1 < nv && !isCovered(lines.v[j], u[i], u[i + 1])) join(region[j * nu + i], region[(j + 1) * nu + i]);
      }
    }
  }
  return region;
}

}  // namespace farol
