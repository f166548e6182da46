// The Cornell box, whole processes side by side: farol and a bare Embree particle loop, error of B against time. The
// reference is a gathering path tracer on the same facets: no mesh error; it is kept beside the program.
// farol_cornell [paths per cell [patch size or 0, options of farol solve]...]
#include "base/sobol.h"
#include "cornell_cells.h"
#include "test_scene.h"
#include "whole_process.h"

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <fstream>
#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

using namespace farol;
using namespace farol::benchmark;

namespace {

using Cells = std::vector<Rgb>;  // [kCellCount] mean radiosity

const std::string kScene = FAROL_SCENES "/cornell_box/cornell_box.gltf";

// Points spread evenly over the walls: where each lies, its cell, and whether something stands on it.
struct WallPoint {
  uint32_t facet;
  Vec2 uv;
  Vec3 point;
  size_t cell;
};

std::vector<WallPoint> wallPoints(const CornellBox& box, uint32_t perUnitArea) {
  std::vector<WallPoint> points;
  for (uint32_t f = 0; f < box.facets.facets.size(); ++f) {
    const Facet& facet = box.facets.facets[f];
    if (box.cellOf(f, box.facets.point(facet, 0.5, 0.5)) == kCellCount) continue;
    const auto count = static_cast<uint32_t>(facet.area * perUnitArea);
    for (uint32_t k = 0; k < count; ++k) {
      const auto x = sobolPoint(k);
      const Vec2 uv((x[0] + 0.5) * 0x1p-32, (x[1] + 0.5) * 0x1p-32);
      const Vec3 p = box.facets.point(facet, uv.x, uv.y);
      if (insideObject(box.tracer, box.facets, std::span(&p, 1), facet.normal, 1) == 0)
        points.push_back({f, uv, p, box.cellOf(f, p)});
    }
  }
  return points;
}

class Gatherer {
 public:
  explicit Gatherer(const CornellBox& box) : box_(box) {
    for (uint32_t f = 0; f < box.facets.facets.size(); ++f) {
      reflectance_.push_back(box.reflectanceOf(f));
      if (maxChannel(box.emissionOf(f)) > 0) lamp_ = f;
    }
  }

  // One sample of the irradiance at a point of a facet; the first two numbers choose the lamp's point.
  Rgb sample(uint32_t facet, Vec3 p, double a, double b, uint64_t& random) const {
    Rgb sum(0), weight(1);
    for (int depth = 0;; ++depth) {
      const Facet& here = box_.facets.facets[facet];
      sum += weight * direct(here, p, a, b);
      const double r2 = next(random), angle = 2 * kPi * next(random), r = std::sqrt(r2);
      const Vec3 t = anyPerpendicular(here.normal), u = glm::cross(here.normal, t);
      const Vec3 d = r * std::cos(angle) * t + r * std::sin(angle) * u + std::sqrt(1 - r2) * here.normal;
      const Vec3 from = p + kRayOffset * here.normal;
      RayPacket ray;
      HitPacket hits;
      ray.set(0, from, d);
      box_.tracer.intersect(ray, 1, hits);
      const uint32_t hit = hits.facet[0];
      if (hit == kNone) return sum;
      const Facet& there = box_.facets.facets[hit];
      if (glm::dot(d, there.normal) > 0) return sum;
      p = from + glm::dot(there.normal, box_.facets.points[there.corners[0]] - from) / glm::dot(there.normal, d) * d;
      facet = hit;
      weight *= reflectance_[hit];
      if (depth >= 2) {
        const double survival = maxChannel(weight) > 0 ? std::min(0.9, maxChannel(weight) * 2) : 0;
        if (next(random) >= survival) return sum;
        weight /= survival;
      }
      a = next(random);
      b = next(random);
    }
  }

 private:
  static double next(uint64_t& state) { return unitFromBits(mixBits(state++)); }

  Rgb direct(const Facet& here, const Vec3& p, double a, double b) const {
    const Facet& lamp = box_.facets.facets[lamp_];
    const Vec3 q = box_.facets.point(lamp, a, b), d = q - p;
    const double squared = glm::dot(d, d), ci = glm::dot(here.normal, d), cj = -glm::dot(lamp.normal, d);
    if (ci <= 0 || cj <= 0) return Rgb(0);
    RayPacket ray;
    const Vec3 from = p + kRayOffset * here.normal, to = q + kRayOffset * lamp.normal;
    ray.set(0, from, to - from);
    if (box_.tracer.occluded(ray, 1) != 0) return Rgb(0);
    return box_.emissionOf(lamp_) * (lamp.area * ci * cj / (kPi * squared * squared));
  }

  const CornellBox& box_;
  std::vector<Rgb> reflectance_;
  uint32_t lamp_ = 0;
};

// Mean over the cells of sum |a - b| relative to b, channels added.
double l1(const Cells& a, const Cells& b) {
  double difference = 0, total = 0;
  for (size_t c = 0; c < kCellCount; ++c) {
    for (int k = 0; k < 3; ++k) {
      difference += std::abs(a[c][k] - b[c][k]);
      total += b[c][k];
    }
  }
  return difference / total;
}

Cells reference(const CornellBox& box, size_t samplesPerCell) {
  const std::string path = fmt::format("cornell_reference_{}.txt", samplesPerCell);
  Cells b(kCellCount, Rgb(0));
  if (std::ifstream file(path); file) {
    for (Rgb& v : b) file >> v.r >> v.g >> v.b;
    if (file) return b;
  }
  fmt::print(stderr, "making the reference: {} paths per cell\n", samplesPerCell);
  const double wallArea = (box.high.x - box.low.x) * (box.high.y - box.low.y);
  const auto points = wallPoints(box, static_cast<uint32_t>(static_cast<double>(samplesPerCell) * kCells * kCells / wallArea));
  const Gatherer gatherer(box);
  constexpr size_t kParts = 256;  // runs of Sobol's sequence, each spread over all cells
  std::vector<Cells> sums(kParts, Cells(kCellCount, Rgb(0)));
  std::vector<std::vector<size_t>> counts(kParts, std::vector<size_t>(kCellCount, 0));
  tbb::parallel_for(size_t{0}, kParts, [&](size_t part) {
    for (size_t k = part * points.size() / kParts; k < (part + 1) * points.size() / kParts; ++k) {
      uint64_t random = mixBits(k) << 8;
      const auto x = sobolPoint(static_cast<uint32_t>(k));
      sums[part][points[k].cell] +=
          gatherer.sample(points[k].facet, points[k].point, (x[2] + 0.5) * 0x1p-32, (x[3] + 0.5) * 0x1p-32, random);
      ++counts[part][points[k].cell];
    }
  });
  // The two halves of the parts tell the noise of the whole.
  Cells halves[2] = {Cells(kCellCount, Rgb(0)), Cells(kCellCount, Rgb(0))};
  const auto rho = [&] {
    Cells r(kCellCount, Rgb(0));
    for (const WallPoint& p : points) r[p.cell] = box.reflectanceOf(p.facet);
    return r;
  }();
  for (size_t c = 0; c < kCellCount; ++c) {
    for (size_t h = 0; h < 2; ++h) {
      size_t count = 0;
      for (size_t part = h; part < kParts; part += 2) {
        halves[h][c] += sums[part][c];
        count += counts[part][c];
      }
      halves[h][c] *= rho[c] / static_cast<double>(std::max<size_t>(1, count));
    }
    b[c] = 0.5 * (halves[0][c] + halves[1][c]);
  }
  fmt::print(stderr, "its own L1 noise: {:.3f} %\n", 100 * l1(halves[0], halves[1]) / 2);
  std::ofstream file(path);
  for (const Rgb& v : b) fmt::print(file, "{} {} {}\n", v.r, v.g, v.b);
  return b;
}

// Cell means of a --patches-csv file: B of the patches under the walls' points.
Cells cellsOfCsv(const CornellBox& box, const PatchOptions& options, const std::vector<WallPoint>& points) {
  const PatchSet patches = buildPatches(box.scene, box.facets, options);
  const HitPatches hit(box.facets, patches);
  std::vector<Rgb> b;
  const auto lines = test::readCsv("cornell_patches.csv");
  for (size_t k = 1; k < lines.size(); ++k)
    b.emplace_back(std::stod(lines[k].at(15)), std::stod(lines[k].at(16)), std::stod(lines[k].at(17)));
  Cells sums(kCellCount, Rgb(0));
  std::vector<size_t> counts(kCellCount, 0);
  for (const WallPoint& p : points) {
    sums[p.cell] += b[hit.at(p.facet, false, static_cast<float>(p.uv.x), static_cast<float>(p.uv.y))];
    ++counts[p.cell];
  }
  for (size_t c = 0; c < kCellCount; ++c) sums[c] /= static_cast<double>(std::max<size_t>(1, counts[c]));
  return sums;
}

// The error e as --tolerance measures it (worst channel, rms over cells relative to the mean) that a million particles leave on so
// many cells, from the differences between seeds: the loop has no other error there.
double loopError(size_t side) {
  constexpr int kSeeds = 4;
  const size_t count = 5 * side * side;
  Cells sum(count, Rgb(0)), squares(count, Rgb(0));
  for (int seed = 1; seed <= kSeeds; ++seed) {
    std::system(fmt::format("{} {} 1000000 {} {} > cornell_cells.txt", FAROL_PARTICLES, kScene, seed, side).c_str());
    std::ifstream file("cornell_cells.txt");
    for (size_t c = 0; c < count; ++c) {
      Rgb power;
      file >> power.r >> power.g >> power.b;
      sum[c] += power;
      squares[c] += power * power;
    }
  }
  Rgb variance(0), mean(0);
  for (size_t c = 0; c < count; ++c) {
    mean += sum[c] / (1.0 * kSeeds * static_cast<double>(count));
    variance += (squares[c] - sum[c] * sum[c] / (1.0 * kSeeds)) / ((kSeeds - 1.0) * static_cast<double>(count));
  }
  return maxChannel(glm::sqrt(variance) / mean);
}

struct Setting {
  double size;  // patch size [scene units]; 0: chosen by the tolerance
  std::string options;
};

// The patches that a run chose.
PatchOptions chosenPatches() {
  const auto report = nlohmann::json::parse(test::readText("cornell_report.json"));
  const std::string command = report.at("equivalent_command"), option = "--patch-size ";
  return {0, std::stod(command.substr(command.find(option) + option.size()))};
}

}  // namespace

int main(int argc, char** argv) {
  const size_t samples = argc > 1 ? std::stoull(argv[1]) : 200000;
  const CornellBox box(kScene);
  const Cells truth = reference(box, samples);
  const double wallArea = (box.high.x - box.low.x) * (box.high.y - box.low.y);
  const auto points = wallPoints(box, static_cast<uint32_t>(65536 / wallArea));

  // The bare loop: incident power per cell; area from the same points.
  std::vector<double> exposedArea(kCellCount, 0.0);
  Cells scale(kCellCount, Rgb(0));
  Rgb emission(0);
  for (uint32_t f = 0; f < box.facets.facets.size(); ++f) emission = glm::max(emission, box.emissionOf(f));
  for (const WallPoint& p : points) {
    exposedArea[p.cell] += wallArea / 65536;
    scale[p.cell] = box.reflectanceOf(p.facet) * emission;
  }
  fmt::print("whole processes, medians of 5, 2 threads; L1 error of B on 8 x 8 cells per wall\n\n");
  fmt::print("| bare Embree particle loop | L1 | seconds |\n|---|---|---|\n");
  double constant = 0, perParticle = 0, start = 0;  // L1 = constant / sqrt(particles); seconds = start + n perParticle
  for (const size_t particles : {size_t{100000}, size_t{1000000}, size_t{4000000}}) {
    double error = 0;
    constexpr int kSeeds = 4;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      std::system(fmt::format("{} {} {} {} > cornell_cells.txt", FAROL_PARTICLES, kScene, particles, seed).c_str());
      Cells b(kCellCount);
      std::ifstream file("cornell_cells.txt");
      for (size_t c = 0; c < kCellCount; ++c) {
        file >> b[c].r >> b[c].g >> b[c].b;
        b[c] *= exposedArea[c] > 0 ? scale[c] / exposedArea[c] : Rgb(0);
      }
      error += l1(b, truth) / kSeeds;
    }
    const double seconds = medianSeconds(fmt::format("{} {} {} > cornell_cells.txt", FAROL_PARTICLES, kScene, particles), 5);
    fmt::print("| {} particles | {:.3f} % | {:.3f} |\n", particles, 100 * error, seconds);
    if (particles == 100000) start = seconds;
    if (particles == 1000000) constant = error * std::sqrt(1e6);
    perParticle = (seconds - start) / static_cast<double>(particles - 100000);
  }
  start -= 1e5 * perParticle;
  const auto loopSeconds = [&](double error) { return start + std::pow(constant / error, 2) * perParticle; };

  fmt::print("\n| farol solve | patches | L1 | seconds | loop at that L1 | ratio |\n|---|---|---|---|---|---|\n");
  std::vector<Setting> settings = {
      {555.0 / 16, "--method rays --rays 128 --shadow-rays 16 --residual 3e-4"},
      {555.0 / 24, "--method rays --rays 128 --shadow-rays 32 --residual 3e-4"},
      {555.0 / 24, "--method rays --rays 192 --shadow-rays 32 --residual 3e-4"},
      {555.0 / 24, "--method rays --rays 256 --shadow-rays 32 --residual 3e-4"},
      {555.0 / 32, "--method rays --rays 256 --shadow-rays 32 --residual 3e-4"},
      {555.0 / 32, "--method rays --rays 512 --shadow-rays 64 --residual 3e-4"},
      {0, "--tolerance 0.01"},
      {0, "--tolerance 0.005"},
      {0, "--tolerance 0.0025"},
      {555.0 / 24, "--method rays --rays 128 --emitters matrix --residual 3e-4"},
      {555.0 / 24, "--method rays --rays 1024 --emitters matrix --residual 3e-4"},
      {555.0 / 24, "--method rays --rays 4096 --emitters matrix --residual 3e-4"},
      {555.0 / 24, "--method raster --resolution 16 --shadow-rays 32 --residual 3e-4"},
      {555.0 / 24, "--method raster --resolution 32 --shadow-rays 32 --residual 3e-4"},
      {555.0 / 32, "--method raster --resolution 32 --shadow-rays 64 --residual 3e-4"},
      {555.0 / 24, "--method raster --resolution 64 --emitters matrix --residual 3e-4"},
      {555.0 / 24, "--method raster --resolution 128 --emitters matrix --residual 3e-4"},
      {555.0 / 24, "--method raster --resolution 256 --emitters matrix --residual 3e-4"},
  };
  if (argc > 2) settings.clear();
  for (int k = 2; k + 1 < argc; k += 2) settings.push_back({std::stod(argv[k]), argv[k + 1]});
  for (const Setting& s : settings) {
    const std::string command = fmt::format(
        "{} solve {}{} {} --threads 2 --patches-csv cornell_patches.csv --report cornell_report.json --quiet 2> /dev/null",
        FAROL_PROGRAM, kScene, s.size > 0 ? fmt::format(" --patch-size {}", s.size) : "", s.options);
    double error = 0;
    constexpr int kSeeds = 4;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      std::system((command + fmt::format(" --seed {}", seed)).c_str());
      error += l1(cellsOfCsv(box, chosenPatches(), points), truth) / kSeeds;
    }
    const double seconds = medianSeconds(command, 5);
    const size_t count = buildPatches(box.scene, box.facets, chosenPatches()).size();
    fmt::print("| {} | {} | {:.3f} % | {:.3f} | {:.2f} | 1/{:.1f} |\n", s.options, count, 100 * error, seconds, loopSeconds(error),
               loopSeconds(error) / seconds);
  }

  if (argc > 2) return 0;
  fmt::print("\nthe error e of H as --tolerance measures it, on as many cells as the patches of a wall\n\n");
  fmt::print(
      "| farol solve | patches | cells of a wall | seconds | e of a million particles there | loop at the tolerance | ratio "
      "|\n|---|---|---|---|---|---|---|\n");
  for (const double tolerance : {0.01, 0.005, 0.0025}) {
    const std::string command =
        fmt::format("{} solve {} --tolerance {} --threads 2 --report cornell_report.json --quiet 2> /dev/null", FAROL_PROGRAM,
                    kScene, tolerance);
    const double seconds = medianSeconds(command, 5);
    const PatchOptions chosen = chosenPatches();
    const auto side = static_cast<size_t>(std::ceil((box.high.x - box.low.x) * box.facets.frame.size / chosen.size));
    const double error = loopError(side), needed = start + std::pow(error / tolerance, 2) * 1e6 * perParticle;
    fmt::print("| --tolerance {} | {} | {} x {} | {:.3f} | {:.2f} % | {:.2f} | 1/{:.1f} |\n", tolerance,
               buildPatches(box.scene, box.facets, chosen).size(), side, side, seconds, 100 * error, needed, needed / seconds);
  }
}
