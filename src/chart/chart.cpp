#include "chart/chart.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace farol {

void markFront(std::vector<ChartPoint>& points) {
  for (ChartPoint& p : points) {
    // Two points below what the reference resolves are equally good.
    const auto worth = [](const ChartPoint& q) { return std::max(q.error, q.noise); };
    p.onFront = std::none_of(points.begin(), points.end(), [&](const ChartPoint& q) {
      return q.seconds <= p.seconds && worth(q) <= worth(p) && (q.seconds < p.seconds || worth(q) < worth(p));
    });
  }
}

std::vector<ErrorLaw> fitLaws(const std::vector<ChartPoint>& points) {
  std::map<std::string, std::vector<std::pair<double, double>>> bySeries;
  // Below one sample per patch a row misses most of what it sees: its error is near 2, whatever the method.
  for (const ChartPoint& p : points) {
    if (p.rowError > 0 && p.samplesPerPatch >= 1)
      bySeries[p.series].emplace_back(std::log(p.samplesPerPatch), std::log(p.rowError));
  }
  std::vector<ErrorLaw> laws;
  for (const auto& [series, logs] : bySeries) {
    constexpr size_t kFewest = 3;
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const auto& [s, e] : logs) {
      n += 1;
      x += s;
      y += e;
      xx += s * s;
      xy += s * e;
    }
    const double spread = n * xx - x * x;
    if (logs.size() < kFewest || !(spread > 1e-9 * n * xx)) continue;
    const double slope = (n * xy - x * y) / spread;
    laws.push_back({series, logs.size(), std::exp((y - slope * x) / n), -slope});
  }
  return laws;
}

std::string besideChart(const std::string& path, const std::string& ending) { return path.substr(0, path.rfind('.')) + ending; }

}  // namespace farol
