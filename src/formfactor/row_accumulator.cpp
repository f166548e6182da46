#include "formfactor/row_accumulator.h"

#include <algorithm>

namespace farol {

SeenCounts SeenCounts::all(std::span<const uint32_t> bins, size_t patches) {
  return {bins.first(patches), {}, false, bins[patches], bins[patches + 1]};
}

SeenCounts SeenCounts::listed(std::span<const uint32_t> pairs, size_t patches) {
  SeenCounts result;
  result.isList = true;
  size_t last = pairs[0];  // the bins that are no patches come last
  for (; last > 0 && pairs[2 * last] >= patches; --last) {
    if (pairs[2 * last] == patches) result.missed = pairs[2 * last + 1];
    if (pairs[2 * last] == patches + 1) result.backs = pairs[2 * last + 1];
  }
  result.pairs = pairs.subspan(2, 2 * last);
  return result;
}

void RowAccumulator::clear(size_t patches, bool fromLists) {
  if (fromLists && lists && sums.size() == patches) {
    for (const uint32_t j : seen) sums[j] = 0;
  } else {
    sums.assign(patches, 0.0);
  }
  seen.clear();
  lists = fromLists;
  missed = backs = exposed = 0;
}

void RowAccumulator::add(const SeenCounts& position, double weight) {
  if (position.insideSolid()) return;
  exposed += weight;
  missed += weight * position.missed;
  backs += weight * position.backs;
  if (lists) {
    position.forEach([&](size_t j, uint32_t count) {
      if (sums[j] == 0) seen.push_back(static_cast<uint32_t>(j));
      sums[j] += weight * count;
    });
  } else {
    for (size_t j = 0; j < sums.size(); ++j) sums[j] += weight * position.counts[j];
  }
}

void RowAccumulator::store(RowStore& store, uint32_t patch, double share) {
  const double scale = exposed > 0 ? 1 / (kFullHemisphere * exposed) : 0;
  const RowShares shares{scale * missed, scale * backs, share};
  if (continued.specular > 0) {
    std::vector<double> first = sums;
    for (double& value : first) value *= scale;
    return storeContinued(store, patch, first, continued, 1 / exposed, shares);
  }
  std::vector<float> values;
  if (lists) {
    std::sort(seen.begin(), seen.end());
    for (const uint32_t j : seen) values.push_back(static_cast<float>(scale * sums[j]));
  }
  for (int c = 0; c < 3; ++c) {
    RowStore* to = c == 0 ? &store : store.channel(c);
    if (to == nullptr) break;
    if (lists) {
      to->entries(patch, seen, values);
    } else {
      const std::span<float> row = to->row(patch);
      for (size_t j = 0; j < row.size(); ++j) row[j] = static_cast<float>(scale * sums[j]);
    }
    to->finish(patch, shares);
  }
}

void RowAccumulator::storeContinued(RowStore& store, uint32_t patch, std::span<const double> first, const ContinuedEntries& more,
                                    double scale, const RowShares& shares) {
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
