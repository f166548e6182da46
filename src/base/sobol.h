// The low-discrepancy sequence behind rays and shadow rays.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace farol {

constexpr size_t kSobolDimensions = 10;

// Point `number` of the first dimensions of Sobol's sequence (1967; direction numbers of Joe and Kuo 2008), as
// fractions of 2^32. 2^m consecutive points from a multiple of 2^m on fill every elementary interval evenly.
template <size_t Dimensions = 4>
std::array<uint32_t, Dimensions> sobolPoint(uint32_t number);

}  // namespace farol
