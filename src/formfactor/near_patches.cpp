#include "formfactor/near_patches.h"

#include <algorithm>
#include <numeric>

namespace farol {
namespace {

// The factor to a small patch of an area that faces one straight.
double straight(double area, double squaredDistance) { return area < kPi * squaredDistance ? area / (kPi * squaredDistance) : 1; }

}  // namespace

NearPatches::NearPatches(std::span<const Vec3> centres, std::span<const double> sizes)
    : centres_(centres), sizes_(sizes), order_(centres.size()) {
  std::iota(order_.begin(), order_.end(), 0u);
  nodes_.push_back({});
  nodes_[0].last = static_cast<uint32_t>(order_.size());
  build(0);
}

void NearPatches::build(uint32_t number) {
  Node node = nodes_[number];
  for (uint32_t k = node.first; k < node.last; ++k) {
    const uint32_t j = order_[k];
    node.low = glm::min(node.low, centres_[j]);
    node.high = glm::max(node.high, centres_[j]);
    node.area = std::max(node.area, sizes_[j] * sizes_[j]);
  }
  constexpr uint32_t kLeaf = 8;
  const bool leaf = node.last - node.first <= kLeaf;
  if (!leaf) node.below = static_cast<uint32_t>(nodes_.size());
  nodes_[number] = node;
  if (leaf) return;
  const Vec3 extent = node.high - node.low;
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  const uint32_t middle = (node.first + node.last) / 2;
  std::nth_element(order_.begin() + node.first, order_.begin() + middle, order_.begin() + node.last, [&](uint32_t a, uint32_t b) {
    return centres_[a][axis] != centres_[b][axis] ? centres_[a][axis] < centres_[b][axis] : a < b;
  });
  nodes_.resize(nodes_.size() + 2);
  nodes_[node.below].first = node.first;
  nodes_[node.below].last = nodes_[node.below + 1].first = middle;
  nodes_[node.below + 1].last = node.last;
  build(node.below);
  build(node.below + 1);
}

double NearPatches::bound(const Node& node, uint32_t patch) const {
  const Vec3 d = glm::max(glm::max(node.low - centres_[patch], centres_[patch] - node.high), Vec3(0));
  const double squared = glm::dot(d, d);
  return errorOf(straight(node.area, squared), sizes_[patch], squared);
}

void NearPatches::find(uint32_t patch, size_t most, double least, const std::function<double(uint32_t)>& factorTo,
                       std::vector<Near>& found) const {
  struct Open {
    double bound;
    uint32_t node;
  };
  static thread_local std::vector<Open> open;
  open.assign(1, {bound(nodes_[0], patch), 0});
  const auto worst = [&] { return found.size() < most ? least : found.back().error; };
  while (!open.empty()) {
    const Open next = open.back();
    open.pop_back();
    if (next.bound < worst()) continue;
    const Node& node = nodes_[next.node];
    if (node.below != 0) {
      const Open a = {bound(nodes_[node.below], patch), node.below}, b = {bound(nodes_[node.below + 1], patch), node.below + 1};
      open.push_back(a.bound < b.bound ? a : b);  // the more promising one comes last, and is looked at first
      open.push_back(a.bound < b.bound ? b : a);
      continue;
    }
    for (uint32_t k = node.first; k < node.last; ++k) {
      const uint32_t j = order_[k];
      if (j == patch) continue;
      const Vec3 d = centres_[j] - centres_[patch];
      const double squared = glm::dot(d, d);
      if (errorOf(straight(sizes_[j] * sizes_[j], squared), sizes_[patch], squared) < worst()) continue;
      const double factor = factorTo(j);
      const Near near = {errorOf(factor, sizes_[patch], squared), factor, j};
      if (near.error <= least || (found.size() == most && !(near < found.back()))) continue;
      if (found.size() == most) found.pop_back();
      found.insert(std::upper_bound(found.begin(), found.end(), near), near);
    }
  }
}

}  // namespace farol
