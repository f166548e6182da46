#include "output/sensor_files.h"

#include "base/error.h"
#include "base/output_file.h"

#include <charconv>
#include <fmt/ostream.h>
#include <fstream>

namespace farol {
namespace {

std::vector<std::string> fieldsOf(const std::string& line) {
  std::vector<std::string> fields;
  std::string field;
  for (const char c : line + ",") {
    if (c == ',') {
      fields.push_back(field);
      field.clear();
    } else if (c != ' ' && c != '\t' && c != '\r' && c != '"') {
      field += c;
    }
  }
  return fields;
}

// The fields from `first` on as finite numbers; empty when one is not.
std::vector<double> numbersOf(const std::vector<std::string>& fields, size_t first) {
  std::vector<double> numbers;
  for (size_t k = first; k < fields.size(); ++k) {
    double value = 0;
    const char *begin = fields[k].data(), *end = begin + fields[k].size();
    const auto [stop, problem] = std::from_chars(begin, end, value);
    if (problem != std::errc() || stop != end || !std::isfinite(value)) return {};
    numbers.push_back(value);
  }
  return numbers;
}

}  // namespace

std::vector<Sensor> loadSensors(const std::string& path) {
  constexpr size_t kMost = 10'000'000;
  std::ifstream file(path);
  if (!file) throw Error("{}: the file of sensors cannot be read", path);
  std::vector<Sensor> sensors;
  std::string line;
  size_t number = 0;
  bool first = true;
  while (std::getline(file, line)) {
    ++number;
    if (line.find_first_not_of(" \t\r") == std::string::npos || line[0] == '#') continue;
    const auto fields = fieldsOf(line);
    const bool grid = fields[0] == "grid";
    const auto v = numbersOf(fields, grid ? 1 : 0);
    const bool isHeader = first && v.empty() && !grid;
    first = false;
    if (isHeader) continue;
    if (v.size() != (grid ? 11 : 6)) {
      throw Error("{}: line {}: '{}' is neither x,y,z,nx,ny,nz nor grid,x,y,z,ux,uy,uz,vx,vy,vz,nu,nv", path, number,
                  line.substr(0, 80));
    }
    const Vec3 origin(v[0], v[1], v[2]), a(v[3], v[4], v[5]);
    if (!grid) {
      if (!(glm::length(a) > 0)) throw Error("{}: line {}: the normal has no length", path, number);
      sensors.push_back({origin, glm::normalize(a)});
    } else {
      const Vec3 b(v[6], v[7], v[8]), normal = glm::cross(a, b);
      const double nu = v[9], nv = v[10];
      if (!(glm::length(normal) > 1e-12 * glm::length(a) * glm::length(b)))
        throw Error("{}: line {}: the grid's sides do not span a plane", path, number);
      if (!(nu >= 1 && nv >= 1 && nu == std::floor(nu) && nv == std::floor(nv) && nu * nv <= double{kMost}))
        throw Error("{}: line {}: {} x {} is not a number of sensors from 1 to {}", path, number, nu, nv, kMost);
      for (int j = 0; j < static_cast<int>(nv); ++j) {
        for (int i = 0; i < static_cast<int>(nu); ++i)
          sensors.push_back({origin + (i + 0.5) / nu * a + (j + 0.5) / nv * b, glm::normalize(normal)});
      }
    }
    if (sensors.size() > kMost) throw Error("{}: more than {} sensors", path, kMost);
  }
  if (sensors.empty()) throw Error("{}: there is no sensor in the file", path);
  return sensors;
}

void writeSensorReadings(const std::string& path, std::span<const Sensor> sensors, std::span<const SensorReading> readings) {
  OutputFile file(path);
  file.stream() << "x,y,z,nx,ny,nz,H_r,H_g,H_b,err\r\n";
  for (size_t k = 0; k < sensors.size(); ++k) {
    const Vec3 &p = sensors[k].position, &n = sensors[k].normal;
    const Rgb& h = readings[k].irradiance;
    fmt::print(file.stream(), "{},{},{},{},{},{},{},{},{},{}\r\n", p.x, p.y, p.z, n.x, n.y, n.z, h.r, h.g, h.b, readings[k].error);
  }
  file.commit();
}

}  // namespace farol
