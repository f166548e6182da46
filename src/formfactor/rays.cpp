#include "formfactor/rays.h"

#include "base/clones.h"
#include "base/sobol.h"
#include "trace/cover.h"

#include <algorithm>
#include <optional>
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

// Rays per patch up to which the patches of a tile are traced together.
constexpr uint32_t kMixedSamples = 1024;

float unitFloat(uint32_t fixed) {
  return static_cast<float>(fixed >> 8) * 0x1p-24f;
}

void resize(SampleTable::Columns& c, size_t size) {
  for (auto* column : {&c.dx, &c.dy, &c.dz, &c.s, &c.t}) column->resize(size);
}

float wrap(float x) {
  return x >= 1 ? x - 1 : x;
}

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
    std::sort(points.begin(), points.end(), [](const Point& a, const Point& b) {
      return a.code != b.code ? a.code < b.code : a.number < b.number;
    });
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
  if (samples > kMixedSamples) return;
  std::vector<uint32_t> order(total);
  for (uint32_t i = 0; i < total; ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](uint32_t a, uint32_t b) { return codes[a] != codes[b] ? codes[a] < codes[b] : a < b; });
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
void turnDirections(const std::array<glm::vec3, 3>& frame, const float* x, const float* y, const float* z,
                    RayPacket& rays) {
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

TileRays::TileRays(const FacetSet& facets, const PatchSet& patches, const SampleTable& table,
                   const RayOptions& options, std::span<const uint32_t> patchIds)
    : table_(table), together_(patchIds.size() > 1), spread_(options.spread), alike_(true) {
  const TileSeat seat = seatOf(facets, patches, patchIds[0], options.seed);
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
    memberOf_[seatOf(facets, patches, patch, options.seed).block] = m;
    Member& member = members_[m];
    double total = 0, shortest = 1;
    for (const Piece& piece : piecesOf(facets, patches, patch)) {
      total += piece.area;
      shortest = std::min({shortest, glm::length(piece.u), glm::length(piece.v)});
      // The patch's frame, turned to the piece.
      const Vec3 across = glm::normalize(tangent - glm::dot(tangent, piece.normal) * piece.normal);
      member.bent |= piece.normal != n;
      member.pieces.push_back({piece.origin + facets.facets[piece.facet].rayOffset * piece.normal, piece.u, piece.v, static_cast<float>(total),
                               piece.triangle, {across, glm::cross(piece.normal, across), piece.normal}});
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

struct RayRowMaker::Impl {
  Impl(const Tracer& t, const FacetSet& f, const PatchSet& p, const RayOptions& o)
      : tracer(t), facets(f), patches(p), options(o), table(o.rays, o.seed, o.kind), hitPatches(f, p) {
    if (p.anySpecular()) tree.emplace(t, f, p, o.limits);
  }

  // A back that proves, or may prove, that the ray's origin lies inside something standing on the patch.
  struct BackHit {
    uint32_t ray;
    Vec3 origin;
    bool black;
  };

  // A row under way.
  struct Row {
    std::vector<uint32_t> ids;  // what each ray met
    uint32_t traced = 0;
    std::vector<BackHit> backHits;
    uint32_t missed = 0, backs = 0;
    std::vector<SpecularHit> specularHits;
    std::vector<uint32_t> specularRays;  // the ray of each
    std::vector<Rgb> weights;            // of each ray where it arrived; empty: 1
  };

  // Adds what paths meet to the entries of up to three channels.
  class Entries : public PathSink {
   public:
    Entries(size_t patches, int channels) : channels_(channels) {
      for (int c = 0; c < channels; ++c) sums_[static_cast<size_t>(c)].assign(patches, 0.0);
    }
    void met(const PathHit& hit) override { add(hit.patch, hit.weight); }
    void add(uint32_t patch, const Rgb& weight) {
      for (int c = 0; c < channels_; ++c) sums_[static_cast<size_t>(c)][patch] += weight[c];
    }
    const std::vector<double>& of(int c) const { return sums_[static_cast<size_t>(c)]; }

   private:
    int channels_;
    std::array<std::vector<double>, 3> sums_;
  };

  // The rows of one patch, or of several patches of one flat tile.
  void makeRows(std::span<const uint32_t> members, RowStore& store) const {
    const auto nothing = static_cast<uint32_t>(patches.size());
    const uint32_t count = options.rays;
    static thread_local std::array<Row, SampleTable::kBlocks> ownRows;
    auto& rows = ownRows;
    for (size_t m = 0; m < members.size(); ++m) {
      rows[m].ids.assign(count, nothing);
      rows[m].backHits.clear();
      rows[m].specularHits.clear();
      rows[m].specularRays.clear();
      rows[m].weights.clear();
      rows[m].traced = rows[m].missed = rows[m].backs = 0;
    }
    TileRays rays(facets, patches, table, options, members);
    RayPacket packet;
    HitPacket hits;
    std::array<uint32_t, kPacketSize> member{};
    while (const uint32_t lanes = rays.next(packet, member)) {
      tracer.intersect(packet, lanes, hits);
      for (uint32_t k = 0; k < lanes; ++k) {
        const uint32_t facet = hits.facet[k];
        Row& row = rows[member[k]];
        uint32_t& id = row.ids[row.traced++];
        if (facet == kNone) {
          ++row.missed;
          continue;
        }
        const bool back = hitPatches.seenFromBehind(facet, packet, k);
        const uint32_t met = hitPatches.at(facet, back, hits.u[k], hits.v[k]);
        if (met == kNone)
          ++row.backs;
        else
          id = met;
        if (tree) meetSpecular(members[member[k]], packet, hits, k, back, met, row);
        if (back && !facets.facets[facet].transmits) {
          row.backHits.push_back(
              {row.traced - 1, {packet.ox[k], packet.oy[k], packet.oz[k]}, !facets.facets[facet].doubleSided});
        }
      }
    }
    for (size_t m = 0; m < members.size(); ++m) storeRow(members[m], rows[m], store);
  }

  void storeRow(uint32_t patch, Row& row, RowStore& store) const {
    const auto nothing = static_cast<uint32_t>(patches.size());
    const uint32_t count = options.rays;
    const uint32_t kept =
        row.backHits.empty() ? count : count - dropCovered(patch, count, row.backHits, row.ids, row.backs);
    const auto storeHits = [&](float weight, const RowShares& shares) {
      for (int c = 0; c < 3; ++c) {
        RowStore* to = c == 0 ? &store : store.channel(c);
        if (to == nullptr) break;
        to->hits(patch, row.ids, weight);
        to->finish(patch, shares);
      }
    };
    if (kept == 0) {
      row.ids.assign(1, nothing);
      return storeHits(0, {0, 0, 0});
    }
    const RowShares shares{static_cast<double>(row.missed) / kept, static_cast<double>(row.backs) / kept,
                           static_cast<double>(kept) / count};
    if (row.specularHits.empty() && row.weights.empty())
      storeHits(1.0f / static_cast<float>(kept), shares);
    else
      storeTree(patch, row, kept, shares, store);
  }

  // Notes a hit that paths go on from, and what a solid took of a ray that started inside it.
  void meetSpecular(uint32_t patch, const RayPacket& packet, const HitPacket& hits, uint32_t k, bool back, uint32_t met,
                    Row& row) const {
    const uint32_t medium = tree->mediumBehind(patch);
    const bool attenuated = medium != kNone && maxChannel(patches.media[medium].attenuation) > 0;
    const bool specular = met != kNone && tree->specular(met);
    if (!attenuated && !specular) return;
    const uint32_t facet = hits.facet[k], ray = row.traced - 1;
    const Vec3 point = tree->pointOn(facet, static_cast<double>(hits.u[k]), static_cast<double>(hits.v[k]));
    Rgb weight(1);
    if (attenuated) {
      weight = tree->passed(medium, glm::distance(point, Vec3(packet.ox[k], packet.oy[k], packet.oz[k])));
      row.weights.resize(options.rays, Rgb(1));
      row.weights[ray] = weight;
    }
    if (!specular) return;
    row.specularRays.push_back(ray);
    row.specularHits.push_back({point, glm::normalize(Vec3(packet.dx[k], packet.dy[k], packet.dz[k])), weight, facet, met,
                                back, medium, 0});
  }

  // A row with paths over mirrors and glass: what rays met first, and what their continuations met.
  void storeTree(uint32_t patch, Row& row, uint32_t kept, RowShares shares, RowStore& store) const {
    const auto nothing = static_cast<uint32_t>(patches.size());
    const int channels = store.channel(1) != nullptr ? 3 : 1;
    Entries entries(patches.size(), channels);
    PathEnds ends;
    size_t followed = 0;
    for (size_t k = 0; k < row.specularHits.size(); ++k) {  // those of rays that were dropped are no hits
      if (row.ids[row.specularRays[k]] != nothing) row.specularHits[followed++] = row.specularHits[k];
    }
    shares.specular = static_cast<double>(followed) / kept;
    tree->follow(std::span(row.specularHits).first(followed), entries, ends);
    for (uint32_t ray = 0; ray < row.traced; ++ray) {
      const Rgb weight = row.weights.empty() ? Rgb(1) : row.weights[ray];
      if (row.ids[ray] != nothing) entries.add(row.ids[ray], weight);
      ends.absorbed += Rgb(1) - weight;
    }
    for (int c = 0; c < channels; ++c) {
      RowStore& to = c == 0 ? store : *store.channel(c);
      const std::span<float> values = to.row(patch);
      for (size_t j = 0; j < values.size(); ++j) values[j] = static_cast<float>(entries.of(c)[j] / kept);
      RowShares own = shares;
      own.missed += ends.missed[c] / kept;
      own.backs += ends.backs[c] / kept;
      own.cut = ends.cut[c] / kept;
      own.absorbed = ends.absorbed[c] / kept;
      to.finish(patch, own);
    }
  }

  // Drops the rays whose origins lie inside something; returns their number.
  uint32_t dropCovered(uint32_t patch, uint32_t count, const std::vector<BackHit>& backHits,
                       std::vector<uint32_t>& ids, uint32_t& backs) const {
    const auto nothing = static_cast<uint32_t>(patches.size());
    const Vec3& normal = patches.patches[patch].normal;
    // Bits of those of hits [first, first + count) whose origins lie inside.
    const auto inside = [&](size_t first, size_t lanes, size_t step) {
      std::array<Vec3, kPacketSize> points;
      uint32_t black = 0;
      for (size_t k = 0; k < lanes; ++k) {
        const BackHit& hit = backHits[first + k * step];
        points[k] = hit.origin - kRayOffset * normal;
        black |= (hit.black ? 1u : 0u) << k;
      }
      return insideObject(tracer, facets, std::span(points).first(lanes), normal, black);
    };
    // A patch all of whose rays meet black backs is settled by some of them.
    if (backs == count && backHits.size() == count) {
      constexpr size_t kEnough = 64;
      const size_t step = std::max<size_t>(1, count / kEnough);
      bool allInside = true;
      for (size_t k = 0; k < count && allInside; k += kPacketSize * step) {
        const size_t lanes = std::min<size_t>(kPacketSize, (count - k + step - 1) / step);
        for (size_t l = 0; l < lanes; ++l) allInside &= backHits[k + l * step].black;
        allInside = allInside && inside(k, lanes, step) == (1u << lanes) - 1;
      }
      if (allInside) return count;
    }
    uint32_t dropped = 0;
    std::vector<const BackHit*> twoSided;
    for (size_t first = 0; first < backHits.size(); first += kPacketSize) {
      const size_t lanes = std::min<size_t>(kPacketSize, backHits.size() - first);
      const uint32_t bits = inside(first, lanes, 1);
      for (size_t k = 0; k < lanes; ++k) {
        const BackHit& hit = backHits[first + k];
        if ((bits >> k & 1) == 0) continue;
        if (!hit.black) {
          twoSided.push_back(&hit);
          continue;
        }
        ++dropped;
        if (ids[hit.ray] == nothing) --backs;
        ids[hit.ray] = nothing;
      }
    }
    // All of a patch behind double-sided walls may be a room whose walls face outwards: nothing stands on it.
    if (dropped + twoSided.size() >= count && dropped == 0) return 0;
    for (const BackHit* hit : twoSided) {
      ++dropped;
      if (ids[hit->ray] == nothing) --backs;
      ids[hit->ray] = nothing;
    }
    return dropped;
  }

  const Tracer& tracer;
  const FacetSet& facets;
  const PatchSet& patches;
  RayOptions options;
  SampleTable table;
  HitPatches hitPatches;
  std::optional<RayTree> tree;  // where something is specular
};

RayRowMaker::RayRowMaker(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches,
                         const RayOptions& options)
    : impl_(std::make_unique<Impl>(tracer, facets, patches, options)) {}
RayRowMaker::~RayRowMaker() = default;

void RayRowMaker::makeRows(std::span<const uint32_t> wanted, RowStore& store, const std::function<void(size_t)>& done) {
  const Impl& impl = *impl_;
  // Patches that are traced together: those of a flat tile, when they have few rays each.
  struct Seated {
    uint64_t tile;
    uint32_t patch;
    bool flat;
    bool operator<(const Seated& o) const { return tile != o.tile ? tile < o.tile : patch < o.patch; }
  };
  std::vector<Seated> seated(wanted.size());
  tbb::parallel_for(size_t{0}, wanted.size(), [&](size_t k) {
    const TileSeat seat = seatOf(impl.facets, impl.patches, wanted[k], impl.options.seed);
    seated[k] = {seat.tile, wanted[k], seat.flat && impl.options.rays <= kMixedSamples};
  });
  std::sort(seated.begin(), seated.end());
  std::vector<uint32_t> order;
  std::vector<size_t> first;  // of each group in `order`
  for (size_t k = 0; k < seated.size(); ++k) {
    if (k == 0 || !seated[k].flat || seated[k].tile != seated[k - 1].tile) first.push_back(k);
    order.push_back(seated[k].patch);
  }
  first.push_back(order.size());
  // Rounds of some tenths of a second, so that progress and interruption stay on the calling thread.
  constexpr size_t kRaysPerRound = size_t{1} << 22;
  for (size_t group = 0; group + 1 < first.size();) {
    size_t next = group;
    while (next + 1 < first.size() && (first[next + 1] - first[group]) * impl.options.rays <= kRaysPerRound) ++next;
    next = std::max(next, group + 1);
    tbb::parallel_for(group, next, [&](size_t g) {
      impl.makeRows(std::span(order).subspan(first[g], first[g + 1] - first[g]), store);
    });
    group = next;
    done(first[group]);
  }
}

}  // namespace farol
