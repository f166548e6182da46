#include "base/sobol.h"

#include <bit>

namespace farol {
namespace {

using Directions = std::array<std::array<uint32_t, 32>, kSobolDimensions>;

Directions makeDirections() {
  struct Primitive {  // polynomial and first direction numbers of a dimension
    uint32_t degree, inner;
    std::array<uint32_t, 5> first;
  };
  constexpr Primitive kPrimitives[kSobolDimensions - 1] = {
      {1, 0, {1}},           {2, 1, {1, 3}},           {3, 1, {1, 3, 1}},       {3, 2, {1, 1, 1}},        {4, 1, {1, 1, 3, 3}},
      {4, 4, {1, 3, 5, 13}}, {5, 2, {1, 1, 5, 5, 17}}, {5, 4, {1, 1, 5, 5, 5}}, {5, 7, {1, 1, 7, 11, 19}}};
  Directions v{};
  for (uint32_t k = 0; k < 32; ++k) v[0][k] = 1u << (31 - k);
  for (size_t d = 1; d < kSobolDimensions; ++d) {
    const Primitive& p = kPrimitives[d - 1];
    for (uint32_t k = 0; k < 32; ++k) {
      if (k < p.degree) {
        v[d][k] = p.first[k] << (31 - k);
        continue;
      }
      v[d][k] = v[d][k - p.degree] ^ (v[d][k - p.degree] >> p.degree);
      for (uint32_t l = 1; l < p.degree; ++l) {
        if ((p.inner >> (p.degree - 1 - l) & 1) != 0) v[d][k] ^= v[d][k - l];
      }
    }
  }
  return v;
}

// What each value of each byte of a number brings.
using Bytes = std::array<std::array<std::array<uint32_t, kSobolDimensions>, 256>, 4>;

Bytes makeBytes() {
  const Directions directions = makeDirections();
  Bytes bytes{};
  for (uint32_t b = 0; b < 4; ++b) {
    for (uint32_t value = 1; value < 256; ++value) {
      const auto last = static_cast<uint32_t>(std::countr_zero(value));
      for (size_t d = 0; d < kSobolDimensions; ++d)
        bytes[b][value][d] = bytes[b][value & (value - 1)][d] ^ directions[d][8 * b + last];
    }
  }
  return bytes;
}

}  // namespace

template <size_t Dimensions>
std::array<uint32_t, Dimensions> sobolPoint(uint32_t number) {
  static const Bytes bytes = makeBytes();
  std::array<uint32_t, Dimensions> x{};
  for (uint32_t b = 0; b < 4 && number >> 8 * b != 0; ++b) {
    for (size_t d = 0; d < Dimensions; ++d) x[d] ^= bytes[b][number >> 8 * b & 255][d];
  }
  return x;
}
template std::array<uint32_t, 4> sobolPoint<4>(uint32_t);
template std::array<uint32_t, kSobolDimensions> sobolPoint<kSobolDimensions>(uint32_t);

}  // namespace farol
