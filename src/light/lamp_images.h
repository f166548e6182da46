// Lamps and punctual lights as planar mirrors show them: light that reaches a patch over mirrors comes straight from an image,
// where shadow rays run over exactly these mirrors (trace/planar_mirrors.h).
#pragma once

#include "light/lamps.h"
#include "scene/scene.h"
#include "trace/planar_mirrors.h"
#include "trace/ray_tree.h"

#include <optional>

namespace farol {

inline constexpr size_t kMostLampImages = 256;

// An image for every sequence of mirrors in which some lamp may be seen, as far as the limits go. None where light passes a
// surface, which bends its way, or where there would be more than `most` images, as in mirrors that are curved or form a pipe.
std::optional<std::vector<Lamp>> lampImages(std::span<const Lamp> lamps, const PlanarMirrors& mirrors, const TreeLimits& limits,
                                            size_t most = kMostLampImages);

// The same of punctual lights; their positions stay in scene units.
std::optional<std::vector<PunctualLight>> lightImages(std::span<const PunctualLight> lights, const Frame& frame,
                                                      const PlanarMirrors& mirrors, const TreeLimits& limits,
                                                      size_t most = kMostLampImages);

}  // namespace farol
