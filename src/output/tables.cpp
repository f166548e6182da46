#include "base/output_file.h"
#include "output/output.h"

#include <fmt/compile.h>
#include <fmt/ostream.h>
#include <map>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

// A field of RFC 4180: quoted where it holds a comma, a quote or a line break.
std::string csvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

// A number after a comma.
void append(std::string& line, double value) { fmt::format_to(std::back_inserter(line), FMT_COMPILE(",{}"), value); }
void append(std::string& line, const Vec3& v) {
  for (int c = 0; c < 3; ++c) append(line, v[c]);
}

}  // namespace

void writePatchesCsv(const std::string& path, const Scene& scene, const PatchSet& patches, const FormFactorMatrix* f,
                     const Solution& solution, const std::vector<Rgb>& error) {
  OutputFile file(path);
  file.stream() << "patch,surface,cx,cy,cz,nx,ny,nz,area,rho_r,rho_g,rho_b,E_r,E_g,E_b,B_r,B_g,B_b,H_r,H_g,H_b,exposed_"
                   "area,err\r\n";
  constexpr size_t kLinesPerPart = 256;
  std::vector<std::string> parts((patches.size() + kLinesPerPart - 1) / kLinesPerPart);
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t part) {
    std::string& lines = parts[part];
    for (size_t i = part * kLinesPerPart; i < std::min(patches.size(), (part + 1) * kLinesPerPart); ++i) {
      const Patch& p = patches.patches[i];
      lines += fmt::format_int(i).c_str();
      lines += ',' + csvField(surfaceNameOf(scene, p));
      for (const Vec3& v : {p.centre, p.normal}) append(lines, v);
      append(lines, p.area);
      for (const Rgb& c : {p.reflectance, p.emission, solution.radiosity[i], solution.irradiance[i]}) append(lines, c);
      append(lines, p.area * (f != nullptr ? f->shares(i).exposed : 1));
      append(lines, error.empty() ? std::nan("") : maxChannel(error[i]));
      lines += "\r\n";
    }
  });
  for (const std::string& lines : parts) file.stream() << lines;
  file.commit();
}

void writeFactorsBySurface(const std::string& path, const Scene& scene, const PatchSet& patches, const FormFactorMatrix& f) {
  std::vector<std::string> names;
  std::map<std::pair<uint32_t, bool>, size_t> index;
  std::vector<size_t> surfaceOf;
  for (const Patch& p : patches.patches) {
    const auto [it, isNew] = index.emplace(std::pair(p.surface, p.back), names.size());
    if (isNew) names.push_back(surfaceNameOf(scene, p));
    surfaceOf.push_back(it->second);
  }
  const size_t n = names.size();
  std::vector<std::vector<double>> sums(n, std::vector<double>(n, 0.0));
  std::vector<double> area(n, 0.0), open(n, 0.0), cut(n, 0.0);
  for (size_t i = 0; i < patches.size(); ++i) {
    const RowShares& shares = f.shares(i);
    const double weight = patches.patches[i].area * shares.exposed;
    const size_t s = surfaceOf[i];
    area[s] += weight;
    open[s] += weight * shares.missed;
    cut[s] += weight * shares.cut;
    f[i].forEach([&](size_t j, double value) { sums[s][surfaceOf[j]] += weight * value; });
  }
  OutputFile file(path);
  file.stream() << "surface,area";
  for (const std::string& name : names) file.stream() << ',' << csvField(name);
  file.stream() << ",(open),(cut)\r\n";
  for (size_t s = 0; s < n; ++s) {
    const double scale = area[s] > 0 ? 1 / area[s] : 0;
    fmt::print(file.stream(), "{},{}", csvField(names[s]), area[s]);
    for (size_t t = 0; t < n; ++t) fmt::print(file.stream(), ",{}", scale * sums[s][t]);
    fmt::print(file.stream(), ",{},{}\r\n", scale * open[s], scale * cut[s]);
  }
  file.commit();
}

}  // namespace farol
