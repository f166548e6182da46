// The bar for a single lighting: a bare particle tracer on Embree, no matrix, no engine. Particles leave the lamp with
// the cosine, bounce until they are absorbed (roulette by mean reflectance), and leave their power in cells, 8 x 8 per
// wall if nothing else is asked for. Prints a line of three channels per cell: radiosity.
#include "cornell_cells.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <thread>

using namespace farol;
using namespace farol::benchmark;

namespace {

struct Random {  // PCG32 (O'Neill 2014)
  uint64_t state;
  float next() {
    const uint64_t old = state;
    state = old * 6364136223846793005ull + 1442695040888963407ull;
    const auto x = static_cast<uint32_t>(((old >> 18) ^ old) >> 27);
    const auto turn = static_cast<uint32_t>(old >> 59);
    return static_cast<float>((x >> turn | x << (-turn & 31)) >> 8) * 0x1p-24f;
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    fmt::print(stderr, "usage: farol_particles SCENE PARTICLES [SEED [CELLS PER SIDE]]\n");
    return 2;
  }
  const CornellBox box(argv[1], argc > 4 ? std::stoull(argv[4]) : kCells);
  const size_t particles = std::stoull(argv[2]);
  const uint64_t seed = argc > 3 ? std::stoull(argv[3]) : 1;
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry quads = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_QUAD);
  auto* points = static_cast<float*>(
      rtcSetNewGeometryBuffer(quads, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, box.facets.points.size()));
  for (const Vec3& p : box.facets.points) {
    for (int c = 0; c < 3; ++c) *points++ = static_cast<float>(p[c]);
  }
  auto* indices = static_cast<uint32_t*>(
      rtcSetNewGeometryBuffer(quads, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4, 16, box.facets.facets.size()));
  struct Surface {
    glm::vec3 normal, tangent, bitangent, reflectance;
    float survival;
  };
  std::vector<Surface> surfaces;
  uint32_t lamp = 0;
  for (uint32_t f = 0; f < box.facets.facets.size(); ++f) {
    const Facet& facet = box.facets.facets[f];
    for (size_t k = 0; k < 4; ++k) *indices++ = facet.corners[facet.parallelogram ? k : std::min<size_t>(k, 2)];
    const Vec3 t = anyPerpendicular(facet.normal);
    const glm::vec3 rho(box.reflectanceOf(f));
    surfaces.push_back(
        {glm::vec3(facet.normal), glm::vec3(t), glm::vec3(glm::cross(facet.normal, t)), rho, (rho.x + rho.y + rho.z) / 3});
    if (maxChannel(box.emissionOf(f)) > 0) lamp = f;
  }
  rtcCommitGeometry(quads);
  rtcAttachGeometry(scene, quads);
  rtcCommitScene(scene);

  constexpr unsigned kThreads = 2;
  std::vector<std::vector<Rgb>> sums(kThreads, std::vector<Rgb>(box.cellCount() + 1, Rgb(0)));
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      Random random{mixBits(seed * 1000 + t)};
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      std::vector<Rgb>& sum = sums[t];
      const Facet& source = box.facets.facets[lamp];
      for (size_t k = 0; k < particles / kThreads; ++k) {
        const double u = static_cast<double>(random.next());
        glm::vec3 p(box.facets.point(source, u, static_cast<double>(random.next())));
        glm::vec3 power(1);
        uint32_t at = lamp;
        for (;;) {
          const Surface& s = surfaces[at];
          const float r2 = random.next(), r = std::sqrt(r2), angle = 6.2831853f * random.next();
          const glm::vec3 d = r * std::cos(angle) * s.tangent + r * std::sin(angle) * s.bitangent + std::sqrt(1 - r2) * s.normal;
          p += static_cast<float>(kRayOffset) * s.normal;
          RTCRayHit ray{};
          ray.ray = {p.x, p.y, p.z, 0, d.x, d.y, d.z, 0, std::numeric_limits<float>::infinity(), ~0u, 0, 0};
          ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
          rtcIntersect1(scene, &context, &ray);
          if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) break;
          at = ray.hit.primID;
          p += ray.ray.tfar * d;
          sum[box.cellOf(at, Vec3(p))] += Rgb(power);
          const Surface& hit = surfaces[at];
          if (glm::dot(d, hit.normal) > 0 || random.next() >= hit.survival) break;
          power *= hit.reflectance / hit.survival;
        }
      }
    });
  }
  for (std::thread& t : threads) t.join();
  // Power per particle, area per cell: the lamp's exitance is 1 per channel here; the reader scales.
  for (size_t c = 0; c < box.cellCount(); ++c) {
    Rgb total(0);
    for (const auto& sum : sums) total += sum[c];
    total *= box.facets.facets[lamp].area / static_cast<double>(particles);
    fmt::print("{} {} {}\n", total.r, total.g, total.b);
  }
}
