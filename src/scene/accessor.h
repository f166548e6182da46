// Typed, bounds-checked reading of glTF accessors.
#pragma once

#include "base/math.h"

#include <string>
#include <tiny_gltf.h>
#include <vector>

namespace farol {

// All values as doubles, `components` per element, normalised integers mapped to [0,1] or [-1,1],
// sparse entries applied. Throws Error beginning with `who` when the accessor does not have that many
// components, its data is missing, or a value is not finite.
std::vector<double> readAccessor(const tinygltf::Model& model, int accessor, int components, const std::string& who);

// Number of components per element of an accessor.
int accessorComponents(const tinygltf::Model& model, int accessor);

}  // namespace farol
