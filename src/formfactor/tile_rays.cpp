#include "formfactor/tile_rays.h"

#include "base/clones.h"
#include "base/sobol.h"

#include <algorithm>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

// Bits of x spread to the even places.
uint32_t spreadBits(uint32_t x) {
  x = (x | x << 8) & 0x00FF00FFu;
  x = (x | x << 4) & 0x0F0F0F0Fu;
  x = (x | x << 2) & 0x33333333u;
  return (x | x << 1) & 0x55555555u;
}

// Square to disc with little distortion, area preserving (Shirley and Chiu 1997).
Vec2 toDisc(double u, double v) {
  const double a = 2 * u - 1, b = 2 * v - 1;
  if (a == 0 && b == 0) return Vec2(0);
  if (std::abs(a) > std::abs(b)) return a * Vec2(std::cos(kPi / 4 * b / a), std::sin(kPi / 4 * b / a));
  return b * Vec2(std::cos(kPi / 2 - kPi / 4 * a / b), std::sin(kPi / 2 - kPi / 4 * a / b));
}

float unitFloat(uint32_t fixed) { return static_cast<float>(fixed >> 8) * 0x1p-24f; }

void resize(SampleTable::Columns& c, size_t size) {
  for (auto* column : {&c.dx, &c.dy, &c.dz, &c.s, &c.t}) column->resize(size);
}

float wrap(float x) { return x >= 1 ? x - 1 : x; }

}  // namespace

SampleTable::SampleTable(uint32_t k, uint64_t seed, Kind kind) : samples(k) {
  const size_t total = size_t{kBlocks} * samples;
  resize(apart, total + kPacketSize);
  std::vector<uint32_t> codes(total);
  std::array<uint32_t, 4> scramble{};
  for (uint32_t c = 0; c < 4; ++c) scramble[c] = static_cast<uint32_t>(mixBits(mixBits(seed) + c));
  tbb::parallel_for(0u, kBlocks, [&](uint32_t block) {
    struct Point {
      uint32_t code, number;
      float x, y, z, s, t;
    };
    std::vector<Point> points(samples);
    for (uint32_t i = 0; i < samples; ++i) {
      const uint32_t number = block * samples + i;
      std::array<uint32_t, 4> fixed = sobolPoint(number);
      for (uint32_t c = 0; c < 4; ++c) fixed[c] ^= scramble[c];
      if (kind == Kind::random) {
        for (uint32_t c = 0; c < 4; ++c) fixed[c] = static_cast<uint32_t>(mixBits(mixBits(seed) + uint64_t{number} * 4 + c));
      }
      const Vec2 p = toDisc((fixed[0] + 0.5) * 0x1p-32, (fixed[1] + 0.5) * 0x1p-32);
      const double z = std::sqrt(std::max(0.0, 1 - p.x * p.x - p.y * p.y));
      const auto place = [](double x) { return static_cast<uint32_t>((0.5 * x + 0.5) * 65535); };
      points[i] = {spreadBits(place(p.x)) | spreadBits(place(p.y)) << 1,
                   i,
                   static_cast<float>(p.x),
                   static_cast<float>(p.y),
                   static_cast<float>(z),
                   unitFloat(fixed[2]),
                   unitFloat(fixed[3])};
    }
    std::sort(points.begin(), points.end(),
              [](const Point& a, const Point& b) { return a.code != b.code ? a.code < b.code : a.number < b.number; });
    for (uint32_t i = 0; i < samples; ++i) {
      const size_t at = size_t{block} * samples + i;
      const Point& p = points[i];
      apart.dx[at] = p.x;
      apart.dy[at] = p.y;
      apart.dz[at] = p.z;
      apart.s[at] = p.s;
      apart.t[at] = p.t;
      codes[at] = p.code;
    }
  });
  if (samples > kMostTogether) return;
  std::vector<uint32_t> order(total);
  for (uint32_t i = 0; i < total; ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return codes[a] != codes[b] ? codes[a] < codes[b] : a < b; });
  resize(together, total + kPacketSize);
  togetherFrom.resize(total + kPacketSize);
  for (uint32_t i = 0; i < total; ++i) {
    const uint32_t e = order[i];
    for (const auto column : {&Columns::dx, &Columns::dy, &Columns::dz, &Columns::s, &Columns::t})
      (together.*column)[i] = (apart.*column)[e];
    togetherFrom[i] = e / samples;
  }
}

TileSeat seatOf(const FacetSet& facets, const PatchSet& patches, uint32_t patch, uint64_t seed) {
  const auto cells = patches.cellsOf(patch);
  const Cell& cell = patches.cells[cells[0]];
  const CellGrid& grid = patches.grids[cell.facet];
  TileSeat seat;
  if (cells.size() > 1 || grid.nu * grid.nv < 4) {
    // Patches of several cells and undivided facets: neighbours in number.
    seat.block = patch % SampleTable::kBlocks;
    seat.tile = uint64_t{1} << 63 | patch / SampleTable::kBlocks;
  } else {
    uint32_t number = 0;
    if (facets.facets[cell.facet].parallelogram) {
      seat.block = cell.v % 4 * 4 + cell.u % 4;
      number = cell.v / 4 * ((grid.nu + 3) / 4) + cell.u / 4;
    } else {
      const uint32_t place = cells[0] - (cell.back ? grid.backCell : grid.frontCell);
      seat.block = place % SampleTable::kBlocks;
      number = place / SampleTable::kBlocks;
    }
    seat.tile = uint64_t{cell.facet} << 32 | uint64_t{cell.back} << 31 | number;
    seat.flat = true;
  }
  const uint64_t bits = mixBits(seed * 0x100000001B3ull + mixBits(seat.tile));
  seat.block ^= static_cast<uint32_t>(mixBits(bits + 3)) % SampleTable::kBlocks;
  seat.turn = 2 * kPi * unitFromBits(bits);
  seat.s = static_cast<float>(unitFromBits(mixBits(bits + 1)));
  seat.t = static_cast<float>(unitFromBits(mixBits(bits + 2)));
  return seat;
}

namespace {

// Sixteen directions from the local frame.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
FAROL_CLONES
#endif
void turnDirections(const std::array<glm::vec3, 3>& frame, const float* x, const float* y, const float* z, RayPacket& rays) {
  const glm::vec3 &a = frame[0], &b = frame[1], &c = frame[2];
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    rays.dx[k] = x[k] * a.x + y[k] * b.x + z[k] * c.x;
    rays.dy[k] = x[k] * a.y + y[k] * b.y + z[k] * c.y;
    rays.dz[k] = x[k] * a.z + y[k] * b.z + z[k] * c.z;
  }
}

// Sixteen origins spread over parallelograms with sides u and v, from their corners.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
FAROL_CLONES
#endif
void spreadOrigins(const glm::vec3& u, const glm::vec3& v, float margin, glm::vec2 shift, const float* s, const float* t,
                   RayPacket& rays) {
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    float a = s[k] + shift.x, b = t[k] + shift.y;
    a = a >= 1 ? a - 1 : a;
    b = b >= 1 ? b - 1 : b;
    a = std::min(std::max(a, margin), 1 - margin);
    b = std::min(std::max(b, margin), 1 - margin);
    rays.ox[k] += a * u.x + b * v.x;
    rays.oy[k] += a * u.y + b * v.y;
    rays.oz[k] += a * u.z + b * v.z;
  }
}

}  // namespace

TileRays::TileRays(const FacetSet& facets, const PatchSet& patches, const SampleTable& table, bool spread, uint64_t seed,
                   std::span<const uint32_t> patchIds)
    : table_(table), together_(patchIds.size() > 1), spread_(spread), alike_(true) {
  const TileSeat seat = seatOf(facets, patches, patchIds[0], seed);
  shiftS_ = seat.s;
  shiftT_ = seat.t;
  at_ = together_ ? 0 : seat.block * table.samples;
  end_ = together_ ? SampleTable::kBlocks * table.samples : at_ + table.samples;
  const Vec3 n = patches.patches[patchIds[0]].normal, a = anyPerpendicular(n), b = glm::cross(n, a);
  const Vec3 tangent = std::cos(seat.turn) * a + std::sin(seat.turn) * b;
  tangent_ = tangent;
  bitangent_ = std::cos(seat.turn) * b - std::sin(seat.turn) * a;
  normal_ = n;
  memberOf_.fill(kNone);
  full_ = patchIds.size() == SampleTable::kBlocks;
  members_.resize(patchIds.size());
  for (uint32_t m = 0; m < patchIds.size(); ++m) {
    const uint32_t patch = patchIds[m];
    memberOf_[seatOf(facets, patches, patch, seed).block] = m;
    Member& member = members_[m];
    double total = 0, shortest = 1;
    for (const Piece& piece : piecesOf(facets, patches, patch)) {
      total += piece.area;
      shortest = std::min({shortest, glm::length(piece.u), glm::length(piece.v)});
      // The patch's frame, turned to the piece.
      const Vec3 across = glm::normalize(tangent - glm::dot(tangent, piece.normal) * piece.normal);
      member.bent |= piece.normal != n;
      member.pieces.push_back({piece.origin + facets.facets[piece.facet].rayOffset * piece.normal,
                               piece.u,
                               piece.v,
                               static_cast<float>(total),
                               piece.triangle,
                               {across, glm::cross(piece.normal, across), piece.normal}});
    }
    for (Span& c : member.pieces) c.end /= static_cast<float>(total);
    // Origins keep clear of the edges, beyond which rounding could put them.
    member.margin = static_cast<float>(std::min(0.01, 2 * kRayOffset / shortest));
    alike_ &= member.pieces.size() == 1 && !member.pieces[0].triangle && spread_;
  }
}

const TileRays::Span& TileRays::place(const Member& member, float s, float t, uint32_t lane, RayPacket& rays) const {
  const Span* c = member.pieces.data();
  if (member.pieces.size() > 1) {  // t also chooses the cell, by area
    const Span* last = c + member.pieces.size() - 1;
    float start = 0;
    for (; c < last && t >= c->end; ++c) start = c->end;
    t = std::clamp((t - start) / (c->end - start), 0.0f, 1.0f);
  }
  if (!spread_) s = t = c->triangle ? 1.0f / 3 : 0.5f;
  const float low = member.margin, high = 1 - member.margin;
  if (c->triangle && s + t > 1) {
    s = 1 - s;
    t = 1 - t;
  }
  s = std::min(std::max(s, low), high);
  t = std::min(std::max(t, low), high);
  if (c->triangle && s + t > high) {
    const float scale = high / (s + t);
    s *= scale;
    t *= scale;
  }
  rays.ox[lane] = c->origin.x + s * c->u.x + t * c->v.x;
  rays.oy[lane] = c->origin.y + s * c->u.y + t * c->v.y;
  rays.oz[lane] = c->origin.z + s * c->u.z + t * c->v.z;
  return *c;
}

uint32_t TileRays::next(RayPacket& rays, std::array<uint32_t, kPacketSize>& member) {
  // The tables are padded: a whole packet can be read at their ends.
  const SampleTable::Columns& table = together_ ? table_.together : table_.apart;
  const float *x = &table.dx[at_], *y = &table.dy[at_], *z = &table.dz[at_], *s = &table.s[at_], *t = &table.t[at_];
  uint32_t lanes = std::min(kPacketSize, end_ - at_);
  float own[5][kPacketSize];
  if (!together_ || full_) {
    for (uint32_t k = 0; k < kPacketSize; ++k) member[k] = together_ ? memberOf_[table_.togetherFrom[at_ + k]] : 0;
    at_ += lanes;
  } else {  // leaves out what belongs to nobody
    std::fill_n(&own[0][0], 5 * kPacketSize, 0.0f);
    member.fill(0);
    lanes = 0;
    for (; at_ < end_ && lanes < kPacketSize; ++at_) {
      const uint32_t m = memberOf_[table_.togetherFrom[at_]];
      if (m == kNone) continue;
      member[lanes] = m;
      own[0][lanes] = table.dx[at_];
      own[1][lanes] = table.dy[at_];
      own[2][lanes] = table.dz[at_];
      own[3][lanes] = table.s[at_];
      own[4][lanes] = table.t[at_];
      ++lanes;
    }
    x = own[0];
    y = own[1];
    z = own[2];
    s = own[3];
    t = own[4];
  }
  if (lanes == 0) return 0;
  turnDirections({tangent_, bitangent_, normal_}, x, y, z, rays);
  if (alike_) {
    for (uint32_t k = 0; k < kPacketSize; ++k) {
      const glm::vec3& corner = members_[member[k]].pieces[0].origin;
      rays.ox[k] = corner.x;
      rays.oy[k] = corner.y;
      rays.oz[k] = corner.z;
    }
    const Span& c = members_[0].pieces[0];
    spreadOrigins(c.u, c.v, members_[0].margin, {shiftS_, shiftT_}, s, t, rays);
  } else {
    for (uint32_t k = 0; k < lanes; ++k) {
      const Member& from = members_[member[k]];
      const Span& piece = this->place(from, wrap(s[k] + shiftS_), wrap(t[k] + shiftT_), k, rays);
      if (!from.bent) continue;
      const glm::vec3 d = x[k] * piece.frame[0] + y[k] * piece.frame[1] + z[k] * piece.frame[2];
      rays.dx[k] = d.x;
      rays.dy[k] = d.y;
      rays.dz[k] = d.z;
    }
  }
  return lanes;
}

}  // namespace farol
