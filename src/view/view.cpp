#include "view/view.h"

#include "formfactor/facet_mesh.h"
#include "shaders/view.frag.h"
#include "shaders/view.vert.h"
#include "shared/interface.h"

#include <array>
#include <glm/vec4.hpp>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr uint32_t kTile = 256;             // pixels along the edge of a tile: bounds the memory for samples
constexpr uint32_t kNothing = 0x7FFFFFFFu;  // clear value: no facet has this number
constexpr double kNear = 1e-6;              // [unit coordinates]

using Row = glm::dvec4;

// Rows that map a point relative to the camera to clip coordinates of the whole picture.
struct Projection4 {
  Row x{0}, y{0}, z{0}, w{0};
};

Projection4 projectionOf(const Camera& camera, double aspect, double sceneSize, double distance) {
  const Vec3 right = glm::normalize(glm::cross(camera.forward, camera.up));
  Projection4 p;
  if (camera.orthographic) {
    const double far = distance + 2;  // the scene's diagonal is 1
    const double halfHeight = std::max(camera.halfHeight, camera.halfWidth / aspect) / sceneSize;
    p.x = Row(right / (halfHeight * aspect), 0);
    p.y = Row(-camera.up / halfHeight, 0);
    p.z = Row(-camera.forward / far, 1);
    p.w = Row(0, 0, 0, 1);
  } else {
    const double tangent = std::tan(0.5 * camera.verticalFov);
    p.x = Row(right / (tangent * aspect), 0);
    p.y = Row(-camera.up / tangent, 0);  // picture rows run downwards
    p.z = Row(0, 0, 0, kNear);           // reversed z: near / depth
    p.w = Row(camera.forward, 0);
  }
  return p;
}

shader::vec4 rowOf(const Row& r) { return shader::toVec4(r, r.w); }

class Shader {
 public:
  Shader(const Scene& scene, const FacetSet& facets, const NodeIrradiance& irradiance, const Camera& camera,
         const ViewOptions& options)
      : scene_(scene),
        facets_(facets),
        irradiance_(irradiance),
        camera_(camera),
        eye_(facets.frame.toUnit(camera.position)),
        options_(options),
        sky_(options.sky / kPi) {}

  Rgb radiance(uint32_t seen, Vec2 uv) const {
    if (seen == kNothing) return sky_;
    const uint32_t facet = seen & ~shader::kBackBit;
    const bool back = (seen & shader::kBackBit) != 0;
    if (!irradiance_.has(facet, back)) return Rgb(0);
    const Facet& f = facets_.facets[facet];
    if (options_.colors != nullptr) {
      const CellGrid& grid = options_.patches->grids[facet];
      const uint32_t cell = (back ? grid.backCell : grid.frontCell) + cellAt(grid, f.parallelogram, uv.x, uv.y);
      return (*options_.colors)[options_.patches->cellMap[cell]];
    }
    const Rgb own = scattered(facet, back, uv.x, uv.y);
    const uint32_t patch = specularPatch(facet, back, uv);
    return patch == kNone ? own : own + passedOn(facet, back, patch, uv);
  }

  // One evaluation per facet and pixel is enough unless a texture, or what a mirror shows, varies within the pixel.
  bool varies(uint32_t seen) const {
    if (seen == kNothing || options_.colors != nullptr) return false;
    const uint32_t facet = seen & ~shader::kBackBit;
    const bool back = (seen & shader::kBackBit) != 0;
    return scene_.materials[scene_.surfaces[facets_.facets[facet].surface].material].textured() ||
           specularPatch(facet, back, Vec2(0.5, 0.25)) != kNone;
  }

 private:
  // Radiance that a surface emits and scatters.
  Rgb scattered(uint32_t facet, bool back, double u, double v) const {
    const Facet& f = facets_.facets[facet];
    const Surface& surface = scene_.surfaces[f.surface];
    const Optics o = scene_.materials[surface.material].evaluate(scene_.textures, attributesAt(surface, f, u, v));
    return (o.emission + o.diffuse * irradiance_.at(facet, back, u, v)) / kPi;
  }

  // The patch there, where it is a mirror or glass that is traced; otherwise kNone.
  uint32_t specularPatch(uint32_t facet, bool back, Vec2 uv) const {
    if (options_.tree == nullptr || !irradiance_.has(facet, back)) return kNone;
    const CellGrid& grid = options_.patches->grids[facet];
    const uint32_t patch =
        options_.patches
            ->cellMap[(back ? grid.backCell : grid.frontCell) + cellAt(grid, facets_.facets[facet].parallelogram, uv.x, uv.y)];
    return patch != kNone && options_.tree->specular(patch) ? patch : kNone;
  }

  // Radiance that paths from the eye over this mirror or glass find.
  Rgb passedOn(uint32_t facet, bool back, uint32_t patch, Vec2 uv) const {
    struct Light : PathSink {
      explicit Light(const Shader& s) : shade(s) {}
      void met(const PathHit& hit) override {
        if (shade.irradiance_.has(hit.facet, hit.back))
          sum += hit.weight * shade.scattered(hit.facet, hit.back, static_cast<double>(hit.u), static_cast<double>(hit.v));
      }
      const Shader& shade;
      Rgb sum{0};
    } light(*this);
    const Vec3 point = options_.tree->pointOn(facet, uv.x, uv.y);
    const Vec3 direction = camera_.orthographic ? camera_.forward : glm::normalize(point - eye_);
    const SpecularHit hit{point, direction, Rgb(1), facet, patch, back, options_.tree->mediumBehind(patch), 0};
    PathEnds ends;
    options_.tree->follow(std::span(&hit, 1), light, ends);
    return light.sum + ends.missed * sky_;
  }

  const Scene& scene_;
  const FacetSet& facets_;
  const NodeIrradiance& irradiance_;
  const Camera& camera_;
  Vec3 eye_;  // [unit coordinates]
  const ViewOptions& options_;
  Rgb sky_;
};

// Mean radiance of a pixel's samples: samples of one facet are shaded together at their mean (u,v).
Rgb shadePixel(const Shader& shade, const uint32_t* seen, const float* uv, uint32_t stride, uint32_t n) {
  struct Group {
    uint32_t seen = 0, count = 0;
    Vec2 uv{0};
  };
  std::array<Group, 64> groups;
  size_t groupCount = 0;
  Rgb sum(0);
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const size_t at = static_cast<size_t>(j) * stride + i;
      const Vec2 here(uv[2 * at], uv[2 * at + 1]);
      if (shade.varies(seen[at])) {
        sum += shade.radiance(seen[at], here);
        continue;
      }
      size_t g = 0;
      while (g < groupCount && groups[g].seen != seen[at]) ++g;
      if (g == groupCount) groups[groupCount++] = {seen[at], 0, Vec2(0)};
      ++groups[g].count;
      groups[g].uv += here;
    }
  }
  for (size_t g = 0; g < groupCount; ++g) {
    const double count = groups[g].count;
    sum += count * shade.radiance(groups[g].seen, groups[g].uv / count);
  }
  return sum / static_cast<double>(n * n);
}

}  // namespace

Image renderView(const gpu::Device& device, const Scene& scene, const FacetSet& facets, const NodeIrradiance& irradiance,
                 const Camera& camera, const ViewOptions& options, const Log& log) {
  const uint32_t n = std::min(options.samples, 8u);
  const uint32_t tile = std::min(kTile, device.limits().maxImageSize / n);
  const uint32_t tileWidth = std::min(tile, options.width), tileHeight = std::min(tile, options.height);
  const std::vector<gpu::Format> formats = {gpu::Format::uint32, gpu::Format::float32x2};
  const uint32_t sampleWidth = tileWidth * n, sampleHeight = tileHeight * n;
  const uint64_t samples = uint64_t{sampleWidth} * sampleHeight;

  const FacetMesh mesh = buildFacetMesh(facets);
  const gpu::Buffer vertices = gpu::upload(device, "view vertices", mesh.vertices);
  const gpu::Buffer indices = gpu::upload(device, "view indices", mesh.indices);
  const gpu::RasterTarget target(device, "view", sampleWidth, sampleHeight, 1, formats);
  const gpu::Buffer seen(device, "view facets", 4 * samples, gpu::Memory::download);
  const gpu::Buffer uv(device, "view coordinates", 8 * samples, gpu::Memory::download);
  const gpu::RasterPipeline pipeline(device, "view", view_vert, view_frag, formats, 1, sizeof(shader::ViewPush));
  const gpu::Bindings bindings(device, "view", {&vertices});
  gpu::Commands commands(device, "view");

  const Vec3 origin = facets.frame.toUnit(camera.position);
  const double aspect = static_cast<double>(options.width) / options.height;
  const Projection4 whole = projectionOf(camera, aspect, facets.frame.size, glm::length(origin));
  const Shader shade(scene, facets, irradiance, camera, options);
  Image image{options.width, options.height, {}};
  image.rgb.resize(size_t{3} * options.width * options.height);

  Progress progress(log, "view", "pixel rows", options.height);
  for (uint32_t y0 = 0; y0 < options.height; y0 += tileHeight) {
    for (uint32_t x0 = 0; x0 < options.width; x0 += tileWidth) {
      // The tile's part of the picture becomes the whole of the clip space.
      const double scaleX = static_cast<double>(options.width) / tileWidth,
                   scaleY = static_cast<double>(options.height) / tileHeight;
      const double shiftX = scaleX - 1 - 2.0 * x0 / tileWidth, shiftY = scaleY - 1 - 2.0 * y0 / tileHeight;
      const shader::ViewPush push{shader::toVec4(origin), rowOf(scaleX * whole.x + shiftX * whole.w),
                                  rowOf(scaleY * whole.y + shiftY * whole.w), rowOf(whole.z), rowOf(whole.w)};
      commands.begin();
      commands.bind(pipeline, bindings);
      commands.bindMesh(vertices, indices);
      commands.beginRaster(target, 0, 1, kNothing);
      commands.viewport(0, 0, sampleWidth, sampleHeight);
      commands.faces(camera.frontFacesOnly ? gpu::Faces::front : gpu::Faces::all);
      commands.push(push);
      commands.drawIndexed(static_cast<uint32_t>(mesh.indices.size()));
      commands.endRaster();
      commands.copyColor(target, 0, 1, seen);
      commands.copyColor(target, 1, 1, uv);
      commands.submit();
      commands.wait();
      const uint32_t width = std::min(tileWidth, options.width - x0), height = std::min(tileHeight, options.height - y0);
      tbb::parallel_for(uint32_t{0}, height, [&](uint32_t y) {
        for (uint32_t x = 0; x < width; ++x) {
          const size_t first = static_cast<size_t>(y) * n * sampleWidth + size_t{x} * n;
          const Rgb value =
              shadePixel(shade, seen.as<const uint32_t>().data() + first, uv.as<const float>().data() + 2 * first, sampleWidth, n);
          for (int c = 0; c < 3; ++c) image.pixel(x0 + x, y0 + y)[c] = static_cast<float>(value[c]);
        }
      });
    }
    progress.update(std::min(y0 + tileHeight, options.height));
  }
  return image;
}

}  // namespace farol
