#include "light/direct.h"

#include "formfactor/analytic.h"
#include "formfactor/error_model.h"
#include "formfactor/tile_rays.h"
#include "patch/positions.h"
#include "trace/cover.h"

#include <bit>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

// Where neighbours see a lamp partly there are four times the rays asked for, elsewhere a fourth of them, which is enough to be
// asked by neighbours.
constexpr uint32_t kPenumbraFactor = 4, kElsewhere = 4, kFewestToAsk = 16;
constexpr size_t kEnoughToAsk = 5;
constexpr double kFewestRays = 4;  // a source that deserves fewer shares them with the others of its kind

}  // namespace

// Where light is gathered: a patch or a point.
struct DirectIrradiance::Receiver {
  Vec3 normal{0}, centre{0};
  double radius = 0, offset = kRayOffset;
  std::vector<Position> points;  // for closed forms
  uint32_t patch = kNone;
  std::vector<Piece> pieces;  // of the patch: origins are spread over them by area; none: all at the centre
  bool bent = false;          // pieces have normals of their own
  bool partlyCovered = false;
  double tries = 1;  // points to draw for one on the exposed part, about
  uint32_t block = 0;
  uint64_t seed = 0;
};

Rgb unoccludedIrradiance(const PunctualLight& light, const Vec3& point, const Vec3& normal) {
  if (light.kind == PunctualLight::Kind::directional) return light.intensity * std::max(0.0, -glm::dot(normal, light.direction));
  const Vec3 to = light.position - point;
  const double squared = glm::dot(to, to), distance = std::sqrt(squared);
  const double cosine = distance > 0 ? glm::dot(normal, to) / distance : 0;
  if (cosine <= 0) return Rgb(0);
  return light.intensity *
         (cosine / squared * rangeShare(light, distance) * coneShare(light, -glm::dot(light.direction, to) / distance));
}

double rangeShare(const PunctualLight& light, double distance) {
  if (light.range <= 0 || light.kind == PunctualLight::Kind::directional) return 1;
  return std::clamp(1 - std::pow(distance / light.range, 4), 0.0, 1.0);
}

double coneShare(const PunctualLight& light, double cosine) {
  if (light.kind != PunctualLight::Kind::spot) return 1;
  const double outer = std::cos(light.outerCone), inner = std::cos(light.innerCone);
  const double t = std::clamp((cosine - outer) / std::max(inner - outer, 1e-4), 0.0, 1.0);
  return t * t;
}

Vec3 wayTo(const PunctualLight& light, const Vec3& point, const Frame& frame) {
  constexpr double kOutOfAnyScene = 3;  // whose diagonal is 1; another one for each mirror on the way
  if (light.kind == PunctualLight::Kind::directional)
    return -(kOutOfAnyScene + static_cast<double>(light.mirrors.size())) * light.direction;
  return frame.toUnit(light.position) - point;
}

DirectIrradiance::DirectIrradiance(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches,
                                   std::span<const Lamp> lamps, std::span<const PunctualLight> lights, const DirectOptions& options)
    : tracer_(tracer),
      facets_(facets),
      patches_(patches),
      lamps_(lamps),
      lights_(lights),
      options_(options),
      points_(SampleTable::kBlocks * kPenumbraFactor * options.shadowRays) {}

DirectIrradiance::Receiver DirectIrradiance::receiverOf(uint32_t patch, double exposed) const {
  const Patch& p = patches_.patches[patch];
  Receiver r;
  r.patch = patch;
  r.normal = p.normal;
  r.offset = facets_.facets[patches_.cells[patches_.cellsOf(patch)[0]].facet].rayOffset;
  r.centre = facets_.frame.toUnit(p.centre);
  r.radius = std::sqrt(p.area) / facets_.frame.size;
  const TileSeat seat = seatOf(facets_, patches_, patch, options_.seed);
  r.block = seat.block;
  r.seed = mixBits(static_cast<uint64_t>(seat.turn * 1e15));
  r.partlyCovered = exposed < 1;
  r.tries = std::min(1 / exposed, 1.0 * SampleTable::kBlocks);
  r.pieces = piecesOf(facets_, patches_, patch);
  r.bent = std::any_of(r.pieces.begin(), r.pieces.end(), [&](const Piece& piece) { return piece.normal != p.normal; });
  const int side = 8 * static_cast<int>(std::ceil(std::sqrt(r.tries)));
  r.points = positionsOn(facets_, patches_, patch, r.partlyCovered ? side * side : r.pieces.size() == 1 ? 4 : 16, r.seed);
  if (r.partlyCovered) {
    std::vector<Position> onExposed = exposedPositions(tracer_, facets_, r.points, r.normal);
    if (!onExposed.empty()) r.points = std::move(onExposed);
  }
  return r;
}

// A lamp or a punctual light as one receiver knows it.
struct DirectIrradiance::Source {
  const Lamp* lamp;
  const PunctualLight* light;
  Rgb irradiance;                 // unoccluded
  double weight;                  // its largest channel
  std::array<uint32_t, 4> shift;  // of the sequence

  const std::vector<uint32_t>& mirrors() const { return lamp != nullptr ? lamp->mirrors : light->mirrors; }
  bool isImage() const { return !mirrors().empty(); }
};

std::vector<DirectIrradiance::Source> DirectIrradiance::sourcesOf(const Receiver& r) const {
  std::vector<Source> sources;
  std::vector<Position> morePoints;  // made when a lamp is near, or when part of the patch is behind it
  const auto pointsFor = [&](const Lamp& lamp) -> const std::vector<Position>& {
    const bool isNear = glm::distance(lamp.centre, r.centre) < lamp.radius + 3 * r.radius;
    const bool cut = std::abs(glm::dot(lamp.normal, r.centre - lamp.centre)) < r.radius;  // by the lamp's plane
    if ((!isNear && !cut) || r.partlyCovered || r.patch == kNone) return r.points;
    if (morePoints.empty()) morePoints = positionsOn(facets_, patches_, r.patch, r.pieces.size() == 1 ? 36 : 64, r.seed);
    return morePoints;
  };
  const auto add = [&](const Lamp* lamp, const PunctualLight* light, const Rgb& irradiance) {
    const double weight = maxChannel(irradiance);
    const auto number = static_cast<uint32_t>(lamp != nullptr ? lamp - lamps_.data() : light - lights_.data() + (1 << 20));
    if (!(weight > 0)) return;
    Source source{lamp, light, irradiance, weight, {}};
    const uint64_t seed = r.seed ^ mixBits(number);
    for (size_t c = 0; c < 4; ++c) source.shift[c] = static_cast<uint32_t>(mixBits(seed + c));
    sources.push_back(source);
  };
  const auto behind = [&](const std::vector<uint32_t>& way) {  // the first mirror that an image is seen over
    return !way.empty() && options_.mirrors->all()[way[0]].height(r.centre) + r.radius <= 0;
  };
  for (const Lamp& lamp : lamps_) {
    bool above = r.bent;
    for (const Vec3& v : lamp.polygon) above |= glm::dot(r.normal, v - r.centre) > kRayOffset;
    if (!above || glm::dot(lamp.normal, r.centre - lamp.centre) + 2 * r.radius <= 0) continue;
    if (behind(lamp.mirrors)) continue;
    double f = 0;
    for (const Position& q : pointsFor(lamp)) f += q.weight * pointToPolygon(q.point, q.normal, lamp.polygon);
    add(&lamp, nullptr, f * lamp.emission);
  }
  for (const PunctualLight& light : lights_) {
    if (behind(light.mirrors)) continue;
    Rgb irradiance(0);
    for (const Position& q : r.points)
      irradiance += q.weight * unoccludedIrradiance(light, facets_.frame.toScene(q.point), q.normal);
    add(nullptr, &light, irradiance);
  }
  return sources;
}

// Shadow rays of one receiver, a packet at a time.
class DirectIrradiance::Visibility {
 public:
  Visibility(const DirectIrradiance& all, const Receiver& r)
      : all_(all), r_(r), margin_(static_cast<float>(std::min(0.01, 2 * kRayOffset / std::max(r.radius, 1e-9)))) {
    if (r.pieces.empty()) point_ = {.origin = r.centre, .normal = r.normal};
    for (const Piece& piece : r.pieces) area_ += piece.area;
    const Piece& first = r.pieces.empty() ? point_ : r.pieces[0];
    for (uint32_t k = 0; k < kPacketSize; ++k) packet_.startOn(k, first, r.offset);
  }

  void aim(uint32_t lane, const Source& source) {
    at_[lane] = &source;
    if (source.light != nullptr)
      packet_.endNowhere(lane, source.shift);
    else
      packet_.endOn(lane, *source.lamp, source.lamp->area * maxChannel(source.lamp->emission) / (kPi * source.weight),
                    source.shift);
  }

  // The first `count` lanes trace points `first` and following of the sequence; calls of(lane, kernel, visible) for those
  // whose ends see each other's front.
  template <typename Function>
  uint32_t trace(uint32_t first, uint32_t count, const Function& of) {
    packet_.draw(all_.points_, first % all_.points_.count);
    if (r_.pieces.size() > 1) choosePieces(count);
    packet_.place(margin_);
    for (uint32_t k = 0; k < count; ++k) {
      if (at_[k]->light != nullptr) aimAtLight(k);
    }
    uint32_t live = 0;
    for (uint32_t k = 0; k < count; ++k) live |= packet_.kernel[k] > 0 ? 1u << k : 0u;
    if (r_.partlyCovered) live &= ~coveredOf(count);
    const uint32_t hidden = hiddenOf(live);
    for (uint32_t k = 0; k < count; ++k) {
      if ((live >> k & 1) != 0) of(k, static_cast<double>(packet_.kernel[k]), (hidden >> k & 1) == 0);
    }
    return static_cast<uint32_t>(std::popcount(live));
  }

  const Source& sourceOf(uint32_t lane) const { return *at_[lane]; }

 private:
  void choosePieces(uint32_t count) {  // by area; t chooses
    for (uint32_t k = 0; k < count; ++k) {
      const double t = static_cast<double>(packet_.t[k]) * area_;
      size_t at = 0;
      double before = 0;
      while (at + 1 < r_.pieces.size() && before + r_.pieces[at].area < t) before += r_.pieces[at++].area;
      const Piece& piece = r_.pieces[at];
      packet_.t[k] = static_cast<float>((t - before) / piece.area);
      packet_.startOn(k, piece, r_.offset);
      aim(k, *at_[k]);
    }
  }

  uint32_t hiddenOf(uint32_t live) const {
    if (all_.options_.mirrors == nullptr) return all_.tracer_.occluded(packet_.rays, live);
    std::array<std::span<const uint32_t>, kPacketSize> ways;
    for (uint32_t k = 0; k < kPacketSize; ++k) {
      if ((live >> k & 1) != 0 && at_[k]->isImage()) ways[k] = at_[k]->mirrors();
    }
    return live & ~all_.options_.mirrors->connected(all_.tracer_, packet_.rays, live, ways);
  }

  Vec3 originOf(uint32_t k) const { return {packet_.rays.ox[k], packet_.rays.oy[k], packet_.rays.oz[k]}; }

  void aimAtLight(uint32_t k) {
    const PunctualLight& light = *at_[k]->light;
    const Vec3 p = originOf(k), normal = packet_.normalAt(k);
    packet_.kernel[k] =
        static_cast<float>(maxChannel(unoccludedIrradiance(light, all_.facets_.frame.toScene(p), normal)) / at_[k]->weight);
    const Vec3 to = wayTo(light, p, all_.facets_.frame);
    packet_.rays.set(k, p, to);
  }

  uint32_t coveredOf(uint32_t count) const {
    std::array<Vec3, kPacketSize> points;
    for (uint32_t k = 0; k < count; ++k) points[k] = originOf(k) - r_.offset * packet_.normalAt(k);
    return insideObject(all_.tracer_, all_.facets_, std::span(points).first(count), r_.normal, 0);
  }

  const DirectIrradiance& all_;
  const Receiver& r_;
  float margin_;
  double area_ = 0;
  Piece point_;
  std::array<const Source*, kPacketSize> at_{};
  ShadowPacket packet_;
};

namespace {

// Kernels of a source's rays in four rounds, each a stretch of the sequence: how much the rounds differ tells the error of all.
class Rounds {
 public:
  explicit Rounds(uint32_t rays) : rays_(rays) {}

  void add(uint32_t ray, double kernel, bool visible) {
    Sum& sum = sums_[ray * kRounds / rays_];
    sum.all += kernel;
    if (visible) sum.seen += kernel;
  }
  // Half of it where no ray could tell, give or take that much.
  double share() const {
    const Sum t = total();
    return t.all > 0 ? t.seen / t.all : 0.5;
  }
  // Of the share, of all rounds together.
  double variance() const {
    const double mean = share();
    if (total().all <= 0) return mean * mean;
    double squares = 0;
    for (const Sum& sum : sums_) squares += sum.all > 0 ? std::pow(sum.seen / sum.all - mean, 2) : 0;
    return squares / (kRounds - 1) * std::pow(kRounds, -2 * kSampleOrder);
  }

 private:
  static constexpr uint32_t kRounds = 4;
  struct Sum {
    double all = 0, seen = 0;
  };
  Sum total() const {
    Sum t;
    for (const Sum& sum : sums_) {
      t.all += sum.all;
      t.seen += sum.seen;
    }
    return t;
  }
  uint32_t rays_;
  std::array<Sum, kRounds> sums_{};
};

}  // namespace

DirectIrradiance::Estimate DirectIrradiance::gather(const Receiver& r, uint32_t rays) const {
  const std::vector<Source> sources = sourcesOf(r);
  double total = 0;
  for (const Source& source : sources) total += source.weight;
  Estimate e;
  if (sources.empty()) return e;
  Visibility visibility(*this, r);
  bool blocked = false, open = false, imagePartly = false;
  const auto isPooled = [&](const Source& s) { return sources.size() > 1 && rays * s.weight / total < kFewestRays; };
  std::vector<const Source*> pool;
  double pooledWeight = 0;
  Rgb pooled(0), variance(0);
  for (const Source& source : sources) {
    if (isPooled(source)) {
      pool.push_back(&source);
      pooledWeight += source.weight;
      pooled += source.irradiance;
      continue;
    }
    const auto count = static_cast<uint32_t>(std::lround(r.tries * rays * source.weight / total));
    for (uint32_t lane = 0; lane < kPacketSize; ++lane) visibility.aim(lane, source);
    Rounds sums(count);
    bool hidden = false, seen = false;
    for (uint32_t k = 0; k < count; k += kPacketSize) {
      e.rays += visibility.trace(r.block * count + k, std::min(kPacketSize, count - k), [&](uint32_t lane, double w, bool visible) {
        sums.add(k + lane, w, visible);
        (visible ? seen : hidden) = true;
      });
    }
    if (source.isImage()) {  // most patches see no image: that is no penumbra
      imagePartly |= hidden && seen;
    } else {
      blocked |= hidden;
      open |= seen;
    }
    e.irradiance += sums.share() * source.irradiance;
    variance += source.irradiance * source.irradiance * sums.variance();
  }
  if (!pool.empty()) {
    const auto count = static_cast<uint32_t>(std::ceil(r.tries * std::max(kFewestRays, rays * pooledWeight / total)));
    const double offset = unitFromBits(mixBits(r.seed + r.block));
    size_t at = 0;
    double before = 0;
    Rounds sums(count);
    Rgb all(0), seen(0);
    for (uint32_t k = 0; k < count; k += kPacketSize) {
      const uint32_t lanes = std::min(kPacketSize, count - k);
      for (uint32_t lane = 0; lane < lanes; ++lane) {
        const double place = (k + lane + offset) / count * pooledWeight;
        while (at + 1 < pool.size() && before + pool[at]->weight < place) before += pool[at++]->weight;
        visibility.aim(lane, *pool[at]);
      }
      e.rays += visibility.trace(r.block * count + k, lanes, [&](uint32_t lane, double w, bool visible) {
        const Rgb share = w * visibility.sourceOf(lane).irradiance / visibility.sourceOf(lane).weight;
        all += share;
        if (visible) seen += share;
        sums.add(k + lane, w, visible);
        if (!visibility.sourceOf(lane).isImage()) (visible ? open : blocked) = true;
      });
    }
    for (int c = 0; c < 3; ++c) e.irradiance[c] += pooled[c] * (all[c] > 0 ? seen[c] / all[c] : sums.share());
    variance += pooled * pooled * sums.variance();
  }
  e.partly = imagePartly || (blocked && open);
  e.deviation = glm::sqrt(variance);
  return e;
}

std::vector<uint32_t> DirectIrradiance::neighboursOf(uint32_t patch) const {
  std::vector<uint32_t> neighbours;
  const auto cells = patches_.cellsOf(patch);
  const Cell& cell = patches_.cells[cells[0]];
  const CellGrid& grid = patches_.grids[cell.facet];
  const bool parallelogram = facets_.facets[cell.facet].parallelogram;
  const uint32_t first = cell.back ? grid.backCell : grid.frontCell, count = grid.count(parallelogram);
  const int64_t own = cells[0] - first, width = parallelogram ? grid.nu : 2 * (grid.nu - cell.v) - 1;
  for (const int64_t step : {int64_t{1}, int64_t{2}, width - 1, width, width + 1, 2 * width}) {
    for (const int64_t place : {own - step, own + step}) {
      if (place < 0 || place >= count) continue;
      const uint32_t neighbour = patches_.cellMap[first + static_cast<uint32_t>(place)];
      if (neighbour != kNone && neighbour != patch) neighbours.push_back(neighbour);
    }
  }
  return neighbours;
}

DirectLight DirectIrradiance::compute(const std::vector<double>& exposed, const std::function<void(size_t)>& done) const {
  const auto n = static_cast<uint32_t>(patches_.size());
  DirectLight result;
  result.irradiance.assign(n, Rgb(0));
  result.deviation.assign(n, Rgb(0));
  std::vector<Estimate> estimates(n);
  const auto shoot = [&](uint32_t i, uint32_t rays) {
    if (exposed[i] <= 0) return;
    const uint32_t before = estimates[i].rays;
    estimates[i] = gather(receiverOf(i, exposed[i]), rays);
    estimates[i].rays += before;
  };
  // Rounds of some tenths of a second, so that progress and interruption stay on the calling thread.
  constexpr uint32_t kRaysPerRound = 1u << 22, kFewest = 64, kMost = 1u << 14;
  const uint32_t atOnce = std::clamp(kRaysPerRound / options_.shadowRays, kFewest, kMost);
  const auto forAll = [&](size_t before, const auto& use) {
    for (uint32_t first = 0; first < n; first += atOnce) {
      tbb::parallel_for(first, std::min(n, first + atOnce), use);
      done(before + std::min(n, first + atOnce));
    }
  };
  // A patch's own rays must not decide whether it gets more: patches whose first rays happen to agree would keep them, which
  // biases the mean. Patches with few neighbours on their facet have few to ask.
  forAll(0, [&](uint32_t i) {
    const bool asks = patches_.cellsOf(i).size() == 1 && neighboursOf(i).size() >= kEnoughToAsk;
    shoot(i, asks ? std::min(options_.shadowRays, std::max(kFewestToAsk, options_.shadowRays / kElsewhere)) : options_.shadowRays);
  });
  std::vector<uint8_t> penumbra(n);
  tbb::parallel_for(0u, n, [&](uint32_t i) {
    const std::vector<uint32_t> neighbours = neighboursOf(i);
    penumbra[i] = std::any_of(neighbours.begin(), neighbours.end(), [&](uint32_t k) { return estimates[k].partly; });
  });
  forAll(n, [&](uint32_t i) {
    if (penumbra[i] != 0) shoot(i, kPenumbraFactor * options_.shadowRays);
  });
  for (uint32_t i = 0; i < n; ++i) {
    result.irradiance[i] = estimates[i].irradiance;
    result.deviation[i] = estimates[i].deviation;
    result.rays += estimates[i].rays;
  }
  return result;
}

DirectIrradiance::Estimate DirectIrradiance::at(const Vec3& point, const Vec3& normal, uint32_t rays, uint64_t seed) const {
  Receiver r;
  r.normal = normal;
  r.centre = point;
  r.points = {{point, 1.0, normal}};
  r.block = static_cast<uint32_t>(seed % SampleTable::kBlocks);
  r.seed = mixBits(seed);
  return gather(r, rays);
}

}  // namespace farol
