#include "cli/variants.h"

#include "base/error.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

namespace farol {
namespace {

using nlohmann::json;

std::optional<Rgb> colorOf(const json& change, const char* key, const std::string& where) {
  if (!change.contains(key)) return std::nullopt;
  const json& value = change.at(key);
  Rgb color(-1);
  if (value.is_array() && value.size() == 3) {
    for (size_t c = 0; c < 3; ++c) color[static_cast<int>(c)] = value[c].is_number() ? value[c].get<double>() : -1;
  }
  if (!(minChannel(color) >= 0) || !std::isfinite(maxChannel(color)))
    throw Error("{}: {} is {}, not three numbers of 0 or more", where, key, value.dump());
  return color;
}

uint32_t materialNamed(const Scene& scene, const std::string& name, const std::string& where) {
  std::string known;
  for (uint32_t m = 0; m < scene.materials.size(); ++m) {
    if (scene.materials[m].name == name) return m;
    known += fmt::format("{}'{}'", known.empty() ? "" : ", ", scene.materials[m].name);
  }
  throw Error("{}: the scene has no material '{}'; it has {}", where, name, known);
}

Optics plainOptics(const Material& material, const Scene& scene) { return material.evaluate(scene.textures, {}); }

Variant variantOf(const json& entry, size_t place, const std::string& path, const Scene& scene) {
  Variant variant;
  variant.name = std::to_string(place + 1);
  std::string where = fmt::format("{}: variant {}", path, variant.name);
  if (!entry.is_object()) throw Error("{} is {}, not an object", where, entry.type_name());
  for (const auto& [key, value] : entry.items()) {
    if (key != "name" && key != "materials") throw Error("{}: '{}' is not known; name and materials are", where, key);
  }
  if (entry.contains("name")) {
    if (!entry["name"].is_string()) throw Error("{}: the name is {}, not a text", where, entry["name"].dump());
    variant.name = entry["name"].get<std::string>();
    where = fmt::format("{}: variant '{}'", path, variant.name);
  }
  if (variant.name.empty() || variant.name.find('/') != std::string::npos || variant.name.starts_with('.'))
    throw Error("{}: the name cannot be part of a file's name", where);
  const json none = json::object(), &materials = entry.contains("materials") ? entry["materials"] : none;
  if (!materials.is_object()) throw Error("{}: materials is {}, not an object", where, materials.type_name());
  for (const auto& [name, change] : materials.items()) {
    const std::string object = fmt::format("{}: material '{}'", where, name);
    const uint32_t m = materialNamed(scene, name, where);
    if (!change.is_object()) throw Error("{} is {}, not an object", object, change.type_name());
    for (const auto& [key, value] : change.items()) {
      if (key != "emission" && key != "diffuse") throw Error("{}: '{}' is not known; emission and diffuse are", object, key);
    }
    const MaterialChange wanted{colorOf(change, "emission", object), colorOf(change, "diffuse", object)};
    if (wanted.diffuse) {
      const Optics o = plainOptics(scene.materials[m], scene);
      const double most = maxChannel(*wanted.diffuse + o.specular + o.transmission);
      if (most > 1 + 1e-9)
        throw Error("{}: diffuse, specular and transmission add up to {:.4g}; at most 1 is possible", object, most);
    }
    variant.changes[m] = wanted;
  }
  return variant;
}

}  // namespace

bool Variant::emissionOnly() const {
  return std::none_of(changes.begin(), changes.end(), [](const auto& c) { return c.second.diffuse.has_value(); });
}

std::vector<Variant> loadVariants(const std::string& path, const Scene& scene) {
  std::ifstream file(path);
  if (!file) throw Error("cannot open {}", path);
  const json entries = json::parse(file, nullptr, false);
  if (entries.is_discarded()) throw Error("{}: this is not JSON", path);
  if (!entries.is_array() || entries.empty()) throw Error("{}: variants are a list of at least one object", path);
  std::vector<Variant> variants;
  std::set<std::string> names;
  for (size_t k = 0; k < entries.size(); ++k) {
    variants.push_back(variantOf(entries[k], k, path, scene));
    if (!names.insert(variants.back().name).second) throw Error("{}: two variants are called '{}'", path, variants.back().name);
  }
  return variants;
}

Scene changed(const Scene& scene, const Variant& variant) {
  Scene result = scene;
  for (const auto& [m, change] : variant.changes) {
    if (change.emission) result.materials[m].exactEmission = change.emission;
    if (change.diffuse) result.materials[m].exactDiffuse = change.diffuse;
  }
  return result;
}

std::vector<UnitLighting> unitLightings(const Scene& scene, const std::vector<Variant>& variants) {
  std::set<uint32_t> alone, keeping;  // materials that change in some variant; of these, those that do not in another
  for (const Variant& v : variants) {
    for (const auto& [m, change] : v.changes) {
      if (v.emissionOnly() && change.emission) alone.insert(m);
    }
  }
  for (const Variant& v : variants) {
    for (const uint32_t m : alone) {
      const auto own = v.changes.find(m);
      if (v.emissionOnly() && (own == v.changes.end() || !own->second.emission)) keeping.insert(m);
    }
  }
  UnitLighting rest{std::nullopt, true, scene};
  for (const uint32_t m : alone) rest.scene.materials[m].exactEmission = Rgb(0);
  std::vector<UnitLighting> units;
  const auto unit = [&](uint32_t m, bool asItIs) {
    UnitLighting u{m, asItIs, scene};
    u.scene.lights.clear();
    for (uint32_t other = 0; other < scene.materials.size(); ++other) {
      if (other != m) u.scene.materials[other].exactEmission = Rgb(0);
    }
    if (!asItIs) u.scene.materials[m].exactEmission = Rgb(1);
    units.push_back(std::move(u));
  };
  for (const uint32_t m : alone) {
    unit(m, false);
    if (keeping.contains(m) && scene.materials[m].emissionTexture.used() && !scene.materials[m].exactEmission) unit(m, true);
  }
  units.push_back(std::move(rest));
  return units;
}

Rgb factorOf(const UnitLighting& unit, const Variant& variant, const Scene& scene) {
  if (!unit.material) return Rgb(1);
  const auto own = variant.changes.find(*unit.material);
  const bool changes = own != variant.changes.end() && own->second.emission;
  if (unit.asItIs) return Rgb(changes ? 0 : 1);
  if (changes) return *own->second.emission;
  const Material& material = scene.materials[*unit.material];
  const bool varies = material.emissionTexture.used() && !material.exactEmission;
  return varies ? Rgb(0) : plainOptics(material, scene).emission;
}

void add(Lighting& sum, const Lighting& unit, const Rgb& factor) {
  const auto addScaled = [&factor](std::vector<Rgb>& to, const std::vector<Rgb>& from) {
    if (to.empty()) to.assign(from.size(), Rgb(0));
    for (size_t i = 0; i < from.size(); ++i) to[i] += factor * from[i];
  };
  for (Lamp lamp : unit.plan.lamps) {
    lamp.emission = lamp.emission * factor;
    sum.plan.lamps.push_back(std::move(lamp));
  }
  sum.plan.emitters += unit.plan.emitters;
  if (sum.plan.apart.empty()) sum.plan.apart.assign(unit.plan.apart.size(), 0);
  for (size_t i = 0; i < unit.plan.apart.size(); ++i) sum.plan.apart[i] |= unit.plan.apart[i];
  addScaled(sum.direct.irradiance, unit.direct.irradiance);
  sum.direct.apart = sum.plan.apart;
  sum.direct.rays += unit.direct.rays;
  addScaled(sum.fromPunctual, unit.fromPunctual);
  Solution& to = sum.solution;
  const Solution& from = unit.solution;
  addScaled(to.radiosity, from.radiosity);
  addScaled(to.irradiance, from.irradiance);
  const double most = maxChannel(factor);
  if (sum.error.empty()) sum.error.assign(unit.error.size(), Rgb(0));
  for (size_t i = 0; i < unit.error.size(); ++i) sum.error[i] += most * unit.error[i];
  to.converged = to.converged && from.converged;
  to.sweeps += from.sweeps;
  to.residual += most * from.residual;
  to.contraction = std::max(to.contraction, from.contraction);
  to.bound = std::max(to.bound, from.bound);
  to.error = std::max(to.error, from.error);  // each relative to its own mean: the sum's is not above the largest
}

std::string variantPath(const std::string& path, const Variant& variant) {
  if (path.empty()) return path;
  const size_t dot = path.rfind('.');
  const bool ending = dot != std::string::npos && path.find('/', dot) == std::string::npos;
  return ending ? fmt::format("{}.{}{}", path.substr(0, dot), variant.name, path.substr(dot))
                : fmt::format("{}.{}", path, variant.name);
}

}  // namespace farol
