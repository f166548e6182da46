// Many lightings on one F: emission and diffuse colour of materials replaced by name. A file of variants is a JSON list:
//   [{"name": "evening", "materials": {"lamp": {"emission": [r,g,b]}, "wall": {"diffuse": [r,g,b]}}}, ...]
// `name` may be left out (then 1, 2, ...); emission is exitance, as in extras.farol.
#pragma once

#include "cli/lighting.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace farol {

struct MaterialChange {
  std::optional<Rgb> emission, diffuse;
};

struct Variant {
  std::string name;
  std::map<uint32_t, MaterialChange> changes;  // by material

  bool emissionOnly() const;
};

// Throws Error naming the variant, what was found and what is allowed.
std::vector<Variant> loadVariants(const std::string& path, const Scene& scene);

Scene changed(const Scene& scene, const Variant& variant);

// A lighting is linear in emission: with diffuse colours as they are, a variant is the sum of unit lightings, one per
// material whose emission changes, each channel scaled by its emission, and one of everything else.
struct UnitLighting {
  std::optional<uint32_t> material;  // that alone emits; none: everything but the materials that change
  bool asItIs = false;               // with its own emission, not 1: for emission that varies over a surface
  Scene scene;
};
std::vector<UnitLighting> unitLightings(const Scene& scene, const std::vector<Variant>& variants);

// The factor of a unit in a variant, per channel.
Rgb factorOf(const UnitLighting& unit, const Variant& variant, const Scene& scene);

// Adds `factor` times a unit's lighting; errors add up to a bound.
void add(Lighting& sum, const Lighting& unit, const Rgb& factor);

// "out/lit.glb" for variant "evening": "out/lit.evening.glb".
std::string variantPath(const std::string& path, const Variant& variant);

}  // namespace farol
