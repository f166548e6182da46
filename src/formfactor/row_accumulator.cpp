#include "formfactor/row_accumulator.h"

namespace farol {

void RowAccumulator::clear(size_t bins) {
  sums.assign(bins, 0.0);
  exposed = 0;
}

void RowAccumulator::add(const uint32_t* counts, double weight) {
  const size_t bins = sums.size();  // without that of what images do not show
  if (counts[bins - 1] == kAllBacks) return;
  exposed += weight;
  for (size_t j = 0; j < bins; ++j) sums[j] += weight * counts[j];
}

void RowAccumulator::store(RowStore& store, uint32_t patch, double share) const {
  const size_t patches = sums.size() - 2;
  const double scale = exposed > 0 ? 1 / (kFullHemisphere * exposed) : 0;
  if (continued.specular > 0) {
    std::vector<double> first(sums.begin(), sums.begin() + static_cast<std::ptrdiff_t>(patches));
    for (double& value : first) value *= scale;
    return storeContinued(store, patch, first, continued, 1 / exposed, {scale * sums[patches], scale * sums[patches + 1], share});
  }
  for (int c = 0; c < 3; ++c) {
    RowStore* to = c == 0 ? &store : store.channel(c);
    if (to == nullptr) break;
    const std::span<float> row = to->row(patch);
    for (size_t j = 0; j < patches; ++j) row[j] = static_cast<float>(scale * sums[j]);
    to->finish(patch, {scale * sums[patches], scale * sums[patches + 1], share});
  }
}

void RowAccumulator::storeContinued(RowStore& store, uint32_t patch, std::span<const double> first,
                           const ContinuedEntries& more, double scale, const RowShares& shares) {
  for (int c = 0; c < more.channels(); ++c) {
    RowStore* to = c == 0 ? &store : store.channel(c);
    if (to == nullptr) break;
    const std::span<float> row = to->row(patch);
    for (size_t j = 0; j < row.size(); ++j) row[j] = static_cast<float>(first[j] + scale * more.of(c)[j]);
    RowShares own = shares;
    own.missed += scale * more.ends.missed[c];
    own.backs += scale * more.ends.backs[c];
    own.cut = scale * more.ends.cut[c];
    own.absorbed = scale * more.ends.absorbed[c];
    own.specular = scale * more.specular;
    to->finish(patch, own);
  }
}

}  // namespace farol
