#include "trace/tracer.h"

#include "base/error.h"

#include <array>
#include <cstring>
#include <limits>
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace farol {
namespace {

// The calls in which Embree 3 and 4 differ. Neighbours in a packet run about the same way where hits are asked for; shadow rays
// begin and end anywhere on a patch and a lamp, and are traced a tenth faster one by one.
#if RTC_VERSION_MAJOR >= 4
struct Query {
  Query() {
    rtcInitIntersectArguments(&intersectArguments);
    rtcInitOccludedArguments(&occludedArguments);
    intersectArguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  }
  RTCIntersectArguments intersectArguments;
  RTCOccludedArguments occludedArguments;
  void intersect(const int* v, RTCScene s, RTCRayHit4& r) { rtcIntersect4(v, s, &r, &intersectArguments); }
  void intersect(const int* v, RTCScene s, RTCRayHit8& r) { rtcIntersect8(v, s, &r, &intersectArguments); }
  void intersect(const int* v, RTCScene s, RTCRayHit16& r) { rtcIntersect16(v, s, &r, &intersectArguments); }
  void occluded(const int* v, RTCScene s, RTCRay4& r) { rtcOccluded4(v, s, &r, &occludedArguments); }
  void occluded(const int* v, RTCScene s, RTCRay8& r) { rtcOccluded8(v, s, &r, &occludedArguments); }
  void occluded(const int* v, RTCScene s, RTCRay16& r) { rtcOccluded16(v, s, &r, &occludedArguments); }
};
#else
struct Query {
  Query() {
    rtcInitIntersectContext(&context);
    rtcInitIntersectContext(&incoherent);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  }
  RTCIntersectContext context, incoherent;
  void intersect(const int* v, RTCScene s, RTCRayHit4& r) { rtcIntersect4(v, s, &context, &r); }
  void intersect(const int* v, RTCScene s, RTCRayHit8& r) { rtcIntersect8(v, s, &context, &r); }
  void intersect(const int* v, RTCScene s, RTCRayHit16& r) { rtcIntersect16(v, s, &context, &r); }
  void occluded(const int* v, RTCScene s, RTCRay4& r) { rtcOccluded4(v, s, &incoherent, &r); }
  void occluded(const int* v, RTCScene s, RTCRay8& r) { rtcOccluded8(v, s, &incoherent, &r); }
  void occluded(const int* v, RTCScene s, RTCRay16& r) { rtcOccluded16(v, s, &incoherent, &r); }
};
#endif

constexpr float kForever = std::numeric_limits<float>::infinity();

template <int Width>
struct Packet;
template <>
struct Packet<4> {
  using Ray = RTCRay4;
  using RayHit = RTCRayHit4;
};
template <>
struct Packet<8> {
  using Ray = RTCRay8;
  using RayHit = RTCRayHit8;
};
template <>
struct Packet<16> {
  using Ray = RTCRay16;
  using RayHit = RTCRayHit16;
};

template <int Width, typename Ray>
void fill(Ray& ray, const RayPacket& from, uint32_t at, float end) {
  constexpr size_t kBytes = Width * sizeof(float);
  std::memcpy(ray.org_x, from.ox + at, kBytes);
  std::memcpy(ray.org_y, from.oy + at, kBytes);
  std::memcpy(ray.org_z, from.oz + at, kBytes);
  std::memcpy(ray.dir_x, from.dx + at, kBytes);
  std::memcpy(ray.dir_y, from.dy + at, kBytes);
  std::memcpy(ray.dir_z, from.dz + at, kBytes);
  for (int k = 0; k < Width; ++k) {
    ray.tnear[k] = 0;
    ray.tfar[k] = end;
    ray.time[k] = 0;
    ray.mask[k] = ~0u;
    ray.flags[k] = 0;
  }
}

template <int Width>
std::array<int, Width> validLanes(uint32_t at, uint32_t which) {
  std::array<int, Width> valid{};
  for (uint32_t k = 0; k < Width; ++k) valid[k] = (which >> (at + k) & 1) != 0 ? -1 : 0;
  return valid;
}

// Rays per packet that the device handles natively.
int packetWidth(RTCDevice device) {
  const auto has = [&](RTCDeviceProperty p) { return rtcGetDeviceProperty(device, p) != 0; };
  return has(RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) ? 16 : has(RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) ? 8 : 4;
}

std::string describe(int width) {
  return fmt::format("Embree {}.{}.{}, packets of {}", RTC_VERSION_MAJOR, RTC_VERSION_MINOR, RTC_VERSION_PATCH, width);
}

}  // namespace

struct Tracer::Impl {
  explicit Impl(const FacetSet& facets) : normals(facets.facets.size()) {
    device = rtcNewDevice(nullptr);  // a number of threads given here would bind the whole program
    if (device == nullptr) throw Error("Embree cannot be started: error {}", static_cast<int>(rtcGetDeviceError(nullptr)));
    scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    addGeometry(facets, true);
    addGeometry(facets, false);
    rtcCommitScene(scene);
    if (const RTCError error = rtcGetDeviceError(device); error != RTC_ERROR_NONE) {
      release();
      throw Error("Embree cannot build its hierarchy over {} facets: error {}", facets.facets.size(), static_cast<int>(error));
    }
    for (size_t i = 0; i < normals.size(); ++i) normals[i] = glm::vec3(facets.facets[i].normal);
    width = packetWidth(device);
  }
  ~Impl() { release(); }

  void release() const {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }

  void addGeometry(const FacetSet& facets, bool parallelograms) {
    std::vector<uint32_t>& ids = facetOf[parallelograms ? 0 : 1];
    for (uint32_t i = 0; i < facets.facets.size(); ++i) {
      if (facets.facets[i].parallelogram == parallelograms) ids.push_back(i);
    }
    if (ids.empty()) return;
    const size_t corners = parallelograms ? 4 : 3;
    RTCGeometry geometry = rtcNewGeometry(device, parallelograms ? RTC_GEOMETRY_TYPE_QUAD : RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* points = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), facets.points.size()));
    auto* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0,
                                                                   parallelograms ? RTC_FORMAT_UINT4 : RTC_FORMAT_UINT3,
                                                                   corners * sizeof(uint32_t), ids.size()));
    if (points == nullptr || indices == nullptr) throw Error("Embree has no memory for {} facets", ids.size());
    for (const Vec3& p : facets.points) {
      for (int c = 0; c < 3; ++c) *points++ = static_cast<float>(p[c]);
    }
    for (const uint32_t i : ids) {
      for (size_t k = 0; k < corners; ++k) *indices++ = facets.facets[i].corners[k];
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene, geometry, parallelograms ? 0 : 1);
    rtcReleaseGeometry(geometry);
  }

  template <int Width>
  void intersect(const RayPacket& rays, uint32_t count, HitPacket& hits) const {
    Query query;
    alignas(64) typename Packet<Width>::RayHit packet;
    for (uint32_t at = 0; at < count; at += Width) {
      alignas(64) const auto valid = validLanes<Width>(at, firstRays(count));
      fill<Width>(packet.ray, rays, at, kForever);
      for (int k = 0; k < Width; ++k) packet.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
      query.intersect(valid.data(), scene, packet);
      for (int k = 0; k < Width; ++k) {
        const uint32_t geometry = packet.hit.geomID[k];
        hits.facet[at + k] = geometry < 2 ? facetOf[geometry][packet.hit.primID[k]] : kNone;
      }
      std::memcpy(hits.u + at, packet.hit.u, sizeof packet.hit.u);
      std::memcpy(hits.v + at, packet.hit.v, sizeof packet.hit.v);
    }
  }

  template <int Width>
  uint32_t occluded(const RayPacket& rays, uint32_t which) const {
    Query query;
    uint32_t bits = 0;
    alignas(64) typename Packet<Width>::Ray packet;
    for (uint32_t at = 0; which >> at != 0; at += Width) {
      alignas(64) const auto valid = validLanes<Width>(at, which);
      fill<Width>(packet, rays, at, 1.0f);
      query.occluded(valid.data(), scene, packet);
      for (uint32_t k = 0; k < Width; ++k) bits |= packet.tfar[k] < 0 ? 1u << (at + k) : 0u;
    }
    return bits & which;
  }

  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::array<std::vector<uint32_t>, 2> facetOf;  // parallelograms, triangles
  std::vector<glm::vec3> normals;
  int width = 4;
};

Tracer::Tracer(const FacetSet& facets) : impl_(std::make_unique<Impl>(facets)) {}
Tracer::~Tracer() = default;

void Tracer::intersect(const RayPacket& rays, uint32_t count, HitPacket& hits) const {
  if (impl_->width == 16) return impl_->intersect<16>(rays, count, hits);
  if (impl_->width == 8) return impl_->intersect<8>(rays, count, hits);
  impl_->intersect<4>(rays, count, hits);
}

uint32_t Tracer::occluded(const RayPacket& rays, uint32_t which) const {
  if (impl_->width == 16) return impl_->occluded<16>(rays, which);
  if (impl_->width == 8) return impl_->occluded<8>(rays, which);
  return impl_->occluded<4>(rays, which);
}

bool Tracer::seenFromBehind(uint32_t facet, const RayPacket& rays, uint32_t k) const {
  const glm::vec3& n = impl_->normals[facet];
  return rays.dx[k] * n.x + rays.dy[k] * n.y + rays.dz[k] * n.z > 0;
}

std::string Tracer::description() const { return describe(impl_->width); }

std::string Tracer::versionText() {
  RTCDevice device = rtcNewDevice(nullptr);
  std::string text = device != nullptr ? describe(packetWidth(device)) : "Embree cannot be started";
  if (device != nullptr) rtcReleaseDevice(device);
  return text;
}

HitPatches::HitPatches(const FacetSet& facets, const PatchSet& patches) : cellMap_(patches.cellMap) {
  for (size_t i = 0; i < facets.facets.size(); ++i) {
    const CellGrid& g = patches.grids[i];
    records_.push_back({glm::vec3(facets.facets[i].normal), static_cast<float>(g.nu), static_cast<float>(g.nv), g.nu - 1, g.nv - 1,
                        g.frontCell, g.backCell, facets.facets[i].parallelogram});
  }
}

}  // namespace farol
