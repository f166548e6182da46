// Any bytes as a scene: loaded, cut into facets and patches, or refused with a sentence.
#include "base/error.h"
#include "base/log.h"
#include "fuzz_file.h"
#include "patch/patches.h"

using namespace farol;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const fuzz::FileInMemory file("scene.gltf");
  file.write({data, size});
  try {
    Log log(true);
    const Scene scene = loadScene(file.path(), log);
    size_t triangles = 0;
    for (const Surface& s : scene.surfaces) triangles += s.triangles.size();
    constexpr size_t kMany = 2000;  // instances multiply: what is slow only because it is large finds nothing
    if (triangles > kMany) return 0;
    const FacetSet facets = buildFacets(scene, log);
    const PatchSet patches = buildPatches(scene, facets, {100, 0});
    for (const Patch& p : patches.patches) {
      const Rgb sum = p.reflectance + p.specular();
      if (!(p.area > 0) || !(maxChannel(sum) <= 1 + 1e-9) || !(minChannel(sum) >= 0) || !(minChannel(p.emission) >= 0) ||
          !std::isfinite(p.area) || !std::isfinite(maxChannel(p.emission)))
        __builtin_trap();
    }
  } catch (const Error&) {
  }
  return 0;
}
