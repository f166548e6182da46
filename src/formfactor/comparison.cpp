#include "formfactor/comparison.h"

#include <algorithm>
#include <tbb/parallel_for.h>

namespace farol {

Comparison compareFactors(const FormFactorMatrix& a, const ErrorModel& errorA, const FormFactorMatrix& b, const ErrorModel& errorB,
                          const PatchSet& patches) {
  const size_t n = patches.size();
  Comparison c;
  c.rows.resize(n);
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    const std::vector<float> rowA = a[i].expanded(), rowB = b[i].expanded();
    RowDifference& d = c.rows[i];
    for (uint32_t j = 0; j < n; ++j) {
      const double by = static_cast<double>(rowA[j]) - static_cast<double>(rowB[j]);
      d.l1 += std::abs(by);
      if (by > d.moreBy) {
        d.moreBy = by;
        d.more = j;
      }
      if (by < d.lessBy) {
        d.lessBy = by;
        d.less = j;
      }
    }
    d.largest = std::max(d.moreBy, -d.lessBy);
    d.estimate = std::hypot(errorA.rowError(i), errorB.rowError(i));
  });
  double area = 0, within = 0, worst = -1e300;
  for (uint32_t i = 0; i < n; ++i) {
    const RowDifference& d = c.rows[i];
    const double weight = patches.patches[i].area * std::max(a.shares(i).exposed, b.shares(i).exposed);
    area += weight;
    c.l1Mean += weight * d.l1;
    c.rms += weight * d.l1 * d.l1;
    c.l1Max = std::max(c.l1Max, d.l1);
    c.largest = std::max(c.largest, d.largest);
    if (d.l1 <= d.estimate) within += 1;
    if (d.l1 - d.estimate > worst) {
      worst = d.l1 - d.estimate;
      c.worst = i;
    }
  }
  if (area > 0) {
    c.l1Mean /= area;
    c.rms = std::sqrt(c.rms / area);
  }
  c.withinEstimate = n > 0 ? within / static_cast<double>(n) : 0;
  return c;
}

}  // namespace farol
