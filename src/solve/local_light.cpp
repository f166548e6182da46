#include "solve/solver.h"

#include <tbb/parallel_for.h>

namespace farol {

Solution localIllumination(const PatchSet& patches, std::span<const PunctualLight> lights, const Rgb& sky) {
  std::vector<const Patch*> emitters;
  for (const Patch& p : patches.patches) {
    if (p.emits()) emitters.push_back(&p);
  }
  Solution result;
  result.radiosity.resize(patches.size());
  result.irradiance.assign(patches.size(), sky);
  tbb::parallel_for(size_t{0}, patches.size(), [&](size_t i) {
    const Patch& p = patches.patches[i];
    for (const PunctualLight& light : lights) result.irradiance[i] += unoccludedIrradiance(light, p.centre, p.normal);
    for (const Patch* e : emitters) {
      const Vec3 d = e->centre - p.centre;
      const double r2 = glm::dot(d, d);
      const double cosHere = glm::dot(p.normal, d), cosThere = -glm::dot(e->normal, d);  // both times r
      if (e == &p || cosHere <= 0 || cosThere <= 0) continue;
      // Lambert's law between two small surfaces: H = E A cos cos / (pi r^2).
      result.irradiance[i] += e->emission * (e->area * cosHere * cosThere / (kPi * r2 * r2));
    }
    result.radiosity[i] = p.emission + p.reflectance * result.irradiance[i];
  });
  return result;
}

}  // namespace farol
