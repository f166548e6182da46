#include "cli/comparison_text.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace farol {

std::string comparisonText(const ComparisonReport& report, const Scene& scene, const PatchSet& patches) {
  const Comparison& c = report.comparison;
  std::string text;
  const auto line = [&](const char* what, const std::string& left, const std::string& right) {
    text += fmt::format("{:<28} {:>24} {:>24}\n", what, left, right);
  };
  const auto number = [](double x) { return fmt::format("{:.4g}", x); };
  const auto sums = [](const FormFactorChecks& k) { return fmt::format("{:.5f} to {:.5f}", k.rowSumMin, k.rowSumMax); };
  const FormFactorChecks &a = report.checksA, &b = report.checksB;
  line("", report.a, report.b);
  line("seconds", number(report.secondsA), number(report.secondsB));
  line("row sums", sums(a), sums(b));
  line("missed", number(a.missed), number(b.missed));
  line("reciprocity error (rms)", number(a.reciprocityRms), number(b.reciprocityRms));
  text += fmt::format("row L1 difference: mean {:.4g}, rms {:.4g}, largest {:.4g}; largest entry difference {:.4g}\n", c.l1Mean,
                      c.rms, c.l1Max, c.largest);
  if (report.estimated)
    text += fmt::format("within the estimated errors of both: {:.2f} % of {} rows\n", 100 * c.withinEstimate, c.rows.size());
  text += fmt::format("difference of H: {:.3g} of its mean (rms)\n", report.irradianceChange);
  const RowDifference& worst = c.rows[c.worst];
  const auto place = [&](uint32_t p) {
    const Vec3& at = patches.patches[p].centre;
    return fmt::format("patch {} on '{}' at ({:.4g}, {:.4g}, {:.4g})", p, surfaceNameOf(scene, patches.patches[p]), at.x, at.y,
                       at.z);
  };
  text += fmt::format("worst row: {}, L1 {:.4g} where {:.4g} was estimated", place(c.worst), worst.l1, worst.estimate);
  if (worst.more != kNone) text += fmt::format("\n  {} sees {:.4g} more of {}", report.a, worst.moreBy, place(worst.more));
  if (worst.less != kNone) text += fmt::format("\n  {} sees {:.4g} less of {}", report.a, -worst.lessBy, place(worst.less));
  return text;
}

std::vector<Rgb> differenceColors(const Comparison& comparison) {
  std::vector<Rgb> colors;
  const double scale = comparison.l1Max > 0 ? 1 / comparison.l1Max : 0;
  for (const RowDifference& d : comparison.rows) {
    const double x = std::sqrt(d.l1 * scale);
    colors.emplace_back(std::clamp(2 * x - 1, 0.02, 1.0), std::clamp(1.2 * x, 0.02, 1.0), std::clamp(0.5 - 0.5 * x, 0.02, 1.0));
  }
  return colors;
}

}  // namespace farol
