// What happens to a ray at mirrors and clear glass: reflection, refraction, total reflection, attenuation in solids.
#pragma once

#include "trace/tracer.h"

namespace farol {

struct TreeLimits {
  uint32_t maxDepth = 512;  // specular surfaces met one after the other
  double minWeight = 1e-4;  // branches that carry less are cut, in shares of the first ray
};

// Unpolarised Fresnel reflectance for light that meets the boundary to a medium of `ratio` times the index where it
// comes from; cosines against the normal. Total reflection: 1, with cosineThrough 0.
double fresnel(double cosine, double ratio, double& cosineThrough);

// A ray that has met a specular surface.
struct SpecularHit {
  Vec3 point{0}, direction{0};  // [unit coordinates]; unit vector along which the ray came
  Rgb weight{1};                // that arrived
  uint32_t facet = 0, patch = 0;
  bool back = false;
  uint32_t medium = kNone;  // surface of the solid that the ray came through; kNone: air
  uint32_t depth = 0;       // specular surfaces met before
  double share = 1;         // weight at the start of the path, which branches are cut in shares of
};

// Something that a path met, specular or not.
struct PathHit {
  uint32_t facet, patch;
  bool back;
  float u, v;
  Rgb weight;  // that arrived
};

class PathSink {
 public:
  virtual ~PathSink() = default;
  virtual void met(const PathHit& hit) = 0;
};

// What became of the weights that met nothing more. Together with what surfaces did not pass on, they are all that was
// followed.
struct PathEnds {
  Rgb missed{0}, backs{0}, absorbed{0}, cut{0};  // absorbed: on the way through solids
};

// Patches and facets as paths need them. All calls may come from several threads at once.
class RayTree {
 public:
  // The references must outlive this.
  RayTree(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const TreeLimits& limits);

  bool specular(uint32_t patch) const { return optics_[patch].specular; }
  uint32_t mediumBehind(uint32_t patch) const;             // of rays that start on it: its solid for an inner side, or kNone
  Vec3 pointOn(uint32_t facet, double u, double v) const;  // a little inside its edges [unit coordinates]
  Rgb passed(uint32_t medium, double distance) const;      // share left after a distance [unit coordinates]

  // Reports every surface that the continuations of `hits` meet, the hits themselves not included. At most 1024 rays per
  // hit are traced; the rest counts as cut.
  void follow(std::span<const SpecularHit> hits, PathSink& sink, PathEnds& ends) const;

 private:
  struct Ray {
    Vec3 origin, direction;
    Rgb weight;
    uint32_t medium, depth;
    double share;
  };
  void spawn(const SpecularHit& hit, std::vector<Ray>& rays, PathEnds& ends) const;
  void spawnRay(const Vec3& origin, const Vec3& direction, const Rgb& weight, uint32_t medium, uint32_t depth, double share,
                std::vector<Ray>& rays, PathEnds& ends) const;

  struct PatchOptics {
    Rgb mirror, transmission;
    bool specular = false;
  };
  const Tracer& tracer_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  TreeLimits limits_;
  HitPatches hitPatches_;
  std::vector<PatchOptics> optics_;
  std::vector<double> margins_;  // [facets] in u and v
};

}  // namespace farol
