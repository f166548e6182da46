#include "reference/reference_file.h"

#include "base/output_file.h"

#include <fmt/ostream.h>

namespace farol {

constexpr const char* kTitle = "farol-reference";

void writeReference(const std::string& path, uint64_t key, const std::vector<GatheredIrradiance>& sets) {
  OutputFile file(path);
  fmt::print(file.stream(), "{} {} {}\n", kTitle, key, sets.size());
  for (const GatheredIrradiance& g : sets) {
    fmt::print(file.stream(), "{} {}\n", g.exposed.size(), g.paths);
    for (size_t i = 0; i < g.exposed.size(); ++i) {
      const Rgb &a = g.half[0][i], &b = g.half[1][i];
      fmt::print(file.stream(), "{} {} {} {} {} {} {}\n", g.exposed[i], a.r, a.g, a.b, b.r, b.g, b.b);
    }
  }
  file.commit();
}

std::optional<std::vector<GatheredIrradiance>> readReference(const std::string& path, uint64_t key) {
  std::ifstream file(path);
  std::string title;
  uint64_t found = 0;
  size_t count = 0;
  constexpr size_t kMostSets = 64, kMostPatches = size_t{1} << 28;
  if (!(file >> title >> found >> count) || title != kTitle || found != key || count > kMostSets) return {};
  std::vector<GatheredIrradiance> sets(count);
  for (GatheredIrradiance& g : sets) {
    size_t n = 0;
    if (!(file >> n >> g.paths) || n > kMostPatches) return {};
    for (size_t i = 0; i < n; ++i) {
      double exposed = 0;
      Rgb a(0), b(0);
      if (!(file >> exposed >> a.r >> a.g >> a.b >> b.r >> b.g >> b.b)) return {};
      g.exposed.push_back(exposed);
      g.half[0].push_back(a);
      g.half[1].push_back(b);
    }
  }
  return sets;
}

}  // namespace farol
