// Radiosities known to many digits: one patch per face or segment with exact factors, dense solves at 30 digits (truth
// B4b and B7; sources in tests/analytic/radiosity_test.cpp).
#pragma once

#include "base/math.h"

#include <map>
#include <string>

namespace farol::test {

// B of colouredBox() (test_scene.h), one patch per face.
inline const std::map<std::string, Rgb> kColouredBoxRadiosity = {
    {"x0", {2.171163873184316, 0.1093678268880881, 0.02933129514035859}},
    {"x1", {0.3946529414360281, 0.8300728046835957, 0.0573309907}},
    {"y0", {2.547580745842231, 1.348377793982861, 0.3556600711}},
    {"y1", {2.547580745842231, 1.383228920469016, 0.3804752276}},
    {"z0", {1.112646793637008, 0.5968673270561775, 0.1775741596}},
    {"z1", {19.34529294619865, 12.61373903953106, 4.1251568870}}};

// B in a closed corridor 1 x 1 x 20 of one reflectance whose end z = 0 emits 1: walls in 20 segments, ends one patch each.
struct CorridorRadiosity {
  double rho, segment0, segment5, segment10, farEnd;
};
inline constexpr CorridorRadiosity kCorridors[] = {{0.5, 0.1581809669, 0.0014740207, 0.0001695788, 0.0004763778175},
                                                   {0.99, 3.4687662976, 1.5761557127, 0.7676046737, 0.3621195529}};

}  // namespace farol::test
