#include "formfactor/rays.h"

#include "trace/cover.h"

#include <algorithm>
#include <optional>
#include <tbb/parallel_for.h>

namespace farol {

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
    TileRays rays(facets, patches, table, options.spread, options.seed, members);
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
          row.backHits.push_back({row.traced - 1, {packet.ox[k], packet.oy[k], packet.oz[k]}, !facets.facets[facet].doubleSided});
        }
      }
    }
    for (size_t m = 0; m < members.size(); ++m) storeRow(members[m], rows[m], store);
  }

  void storeRow(uint32_t patch, Row& row, RowStore& store) const {
    const auto nothing = static_cast<uint32_t>(patches.size());
    const uint32_t count = options.rays;
    const uint32_t kept = row.backHits.empty() ? count : count - dropCovered(patch, count, row.backHits, row.ids, row.backs);
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
    row.specularHits.push_back(
        {point, glm::normalize(Vec3(packet.dx[k], packet.dy[k], packet.dz[k])), weight, facet, met, back, medium, 0});
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
  uint32_t dropCovered(uint32_t patch, uint32_t count, const std::vector<BackHit>& backHits, std::vector<uint32_t>& ids,
                       uint32_t& backs) const {
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

RayRowMaker::RayRowMaker(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const RayOptions& options)
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
    seated[k] = {seat.tile, wanted[k], seat.flat && impl.options.rays <= SampleTable::kMostTogether};
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
    tbb::parallel_for(group, next,
                      [&](size_t g) { impl.makeRows(std::span(order).subspan(first[g], first[g + 1] - first[g]), store); });
    group = next;
    done(first[group]);
  }
}

}  // namespace farol
