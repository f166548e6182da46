// A room with a lamp of 0.5 % of its ceiling, whole processes: error of H by emitters apart and by F alone (matrix), by
// rays and by raster. Nothing blocks anything, so that closed forms give the reference on the same patches.
// Works in a folder of its own.
#include "test_scene.h"
#include "whole_process.h"

#include <cmath>

using namespace farol;
using namespace farol::benchmark;
using test::TemporaryFolder;

namespace {

// 4 m x 4 m x 2.7 m, the lamp flush with the ceiling.
std::vector<test::TestSurface> lampRoom() {
  auto surfaces = test::closedBox({4, 4, 2.7}, Rgb(0.7, 0.6, 0.5));
  const double h = 0.5 * std::sqrt(0.005 * 16), a = 2 - h, b = 2 + h;
  const auto ceiling = [](double x0, double y0, double x1, double y1) -> std::vector<Vec3> {
    return {{x0, y0, 2.7}, {x0, y1, 2.7}, {x1, y1, 2.7}, {x1, y0, 2.7}};
  };
  surfaces[5].polygons = {ceiling(0, 0, 4, a), ceiling(0, b, 4, 4), ceiling(0, a, a, b), ceiling(b, a, 4, b)};
  surfaces.push_back({"lamp", {ceiling(a, a, b, b)}, Rgb(0), Rgb(1000)});
  return surfaces;
}

struct Irradiance {
  std::vector<double> h, area;
};

Irradiance read(const std::string& path) {
  Irradiance result;
  const auto lines = test::readCsv(path);
  for (size_t k = 1; k < lines.size(); ++k) {
    result.area.push_back(std::stod(lines[k].at(8)));
    result.h.push_back(std::stod(lines[k].at(18)));
  }
  return result;
}

// Area-weighted rms difference over the area-weighted mean.
double error(const Irradiance& a, const Irradiance& exact) {
  double squares = 0, sum = 0, area = 0;
  for (size_t i = 0; i < exact.h.size(); ++i) {
    squares += exact.area[i] * (a.h.at(i) - exact.h[i]) * (a.h[i] - exact.h[i]);
    sum += exact.area[i] * exact.h[i];
    area += exact.area[i];
  }
  return std::sqrt(squares * area) / sum;
}

}  // namespace

int main() {
  const TemporaryFolder folder;
  const std::string scene = folder.path("lamp_room.gltf"), csv = folder.path("p.csv");
  test::writeText(scene, test::gltfOf(lampRoom()).dump());
  const std::string command =
      fmt::format("{} solve {} --patches 1500 --residual 1e-6 --threads 2 --quiet --patches-csv {} ", FAROL_PROGRAM, scene, csv);
  medianSeconds(command + "--method exact --emitters matrix", 1);
  const Irradiance exact = read(csv);
  fmt::print("{} patches; whole processes, medians of 5, 2 threads; rms error of H, mean of 4 seeds\n\n", exact.h.size());
  fmt::print("| farol solve | error of H | seconds |\n|---|---|---|\n");
  for (const auto& [apart, matrix] : {std::pair<std::string, std::vector<std::string>>{
                                          "--method rays", {"--rays 256", "--rays 1024", "--rays 4096", "--rays 16384"}},
                                      {"--method raster", {"--resolution 64", "--resolution 128", "--resolution 256"}}}) {
    double apartError = 0, apartSeconds = 0, atEqualTime = 0, before[2] = {0, 0};
    const auto measure = [&](const std::string& options) {
      double mean = 0;
      for (int seed = 1; seed <= 4; ++seed) {
        medianSeconds(command + options + fmt::format(" --seed {}", seed), 1);
        mean += error(read(csv), exact) / 4;
      }
      const double seconds = medianSeconds(command + options, 5);
      fmt::print("| {} | {:.3f} % | {:.3f} |\n", options, 100 * mean, seconds);
      return std::pair(mean, seconds);
    };
    std::tie(apartError, apartSeconds) = measure(apart);
    for (const std::string& setting : matrix) {
      const auto [mean, seconds] = measure(apart + " --emitters matrix " + setting);
      // Between the two settings around apart's time the error is taken to be a power of time.
      if (seconds >= apartSeconds && atEqualTime == 0) {
        atEqualTime = before[1] == 0
                          ? mean
                          : mean * std::pow(before[0] / mean, std::log(seconds / apartSeconds) / std::log(seconds / before[1]));
      }
      before[0] = mean;
      before[1] = seconds;
    }
    fmt::print("| at equal time matrix has {:.1f} times the error | | |\n", atEqualTime / apartError);
  }
}
