// The low-discrepancy sequence behind rays and shadow rays.
#pragma once

#include <array>
#include <cstdint>

namespace farol {

// Point `number` of the first four dimensions of Sobol's sequence (1967; direction numbers of Joe and Kuo 2008), as
// fractions of 2^32. 2^m consecutive points from a multiple of 2^m on fill every elementary interval evenly.
std::array<uint32_t, 4> sobolPoint(uint32_t number);

}  // namespace farol
