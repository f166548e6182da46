// How many rays or pixels to take, and what they are worth.
#pragma once

#include "cli/methods.h"

namespace farol {

inline constexpr uint32_t kMostRays = 1u << 16;

// Sobol's points are spread evenly in powers of two of them (the test PowersOfTwoAreWorthMore prints by how much). Half as many
// again are worth a quarter more, and other numbers are not worth their time: the first such number that is worth so much.
uint32_t evenCount(double worth, uint32_t least, uint32_t most);
// The power of two that a number of rays errs like, on the straight line to the next.
double worthOf(double count);

// What errors of a setting's rows fall with, and to which power: in rays, or in the pixels of a hemicube.
double worthOf(const MethodSpec& spec);
double orderOf(const MethodSpec& spec);

// A setting's samples of rows, changed by a factor.
void scaleSamples(MethodSpec& spec, double factor);

}  // namespace farol
