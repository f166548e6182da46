#include "light/shadow_packet.h"

#include "base/clones.h"
#include "base/sobol.h"

namespace farol {
namespace {

#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
FAROL_CLONES
#endif
void drawColumn(const uint32_t* numbers, const uint32_t* shift, float* x) {
  for (uint32_t k = 0; k < kPacketSize; ++k)
    x[k] = static_cast<float>(static_cast<int32_t>((numbers[k] + shift[k]) >> 8)) * 0x1p-24f;
}

// Triangles are half of a parallelogram: points of the other half are turned over.
[[gnu::always_inline]] inline void fold(float folds, float& x, float& y) {
  const bool over = folds * (x + y) > 1;
  x = over ? 1 - x : x;
  y = over ? 1 - y : y;
}

}  // namespace

ShadowPoints::ShadowPoints(uint32_t n) : count(n) {
  for (auto& column : columns) column.resize(n + kPacketSize);
  for (uint32_t k = 0; k < n + kPacketSize; ++k) {
    const std::array<uint32_t, 4> x = sobolPoint(k % n);
    for (size_t c = 0; c < 4; ++c) columns[c][k] = x[c];
  }
}

void ShadowPacket::set(Side& side, uint32_t lane, const Vec3& origin, const Vec3& u, const Vec3& v, const Vec3& normal,
                       double offset, bool triangle) {
  for (int c = 0; c < 3; ++c) {
    side.origin[c][lane] = static_cast<float>(origin[c]);
    side.u[c][lane] = static_cast<float>(u[c]);
    side.v[c][lane] = static_cast<float>(v[c]);
    side.normal[c][lane] = static_cast<float>(normal[c]);
    side.step[c][lane] = static_cast<float>(offset * normal[c]);
  }
  side.folds[lane] = triangle ? 1.0f : 0.0f;
}

void ShadowPacket::startOn(uint32_t lane, const Piece& piece, double offset) {
  set(from_, lane, piece.origin, piece.u, piece.v, piece.normal, offset, piece.triangle);
  start_[lane] = piece.origin;
}

void ShadowPacket::endOn(uint32_t lane, const Lamp& lamp, double scale, const std::array<uint32_t, 4>& shift) {
  const std::vector<Vec3>& v = lamp.polygon;
  set(to_, lane, v[0] - start_[lane], v[1] - v[0], v.back() - v[0], lamp.normal, kRayOffset, v.size() == 3);
  scale_[lane] = static_cast<float>(scale);
  for (size_t c = 0; c < 4; ++c) shift_[c][lane] = shift[c];
}

void ShadowPacket::endNowhere(uint32_t lane, const std::array<uint32_t, 4>& shift) {
  set(to_, lane, Vec3(0), Vec3(0), Vec3(0), Vec3(0), 0, false);
  scale_[lane] = 0;
  for (size_t c = 0; c < 4; ++c) shift_[c][lane] = shift[c];
}

void ShadowPacket::draw(const ShadowPoints& points, uint32_t first) {
  float* const to[4] = {s, t, a, b};
  for (size_t c = 0; c < 4; ++c) drawColumn(points.columns[c].data() + first, shift_[c], to[c]);
}

void ShadowPacket::place(float margin) {
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    float x = s[k], y = t[k], e = a[k], f = b[k];
    fold(from_.folds[k], x, y);
    fold(to_.folds[k], e, f);
    x = std::min(std::max(x, margin), 1 - margin);
    y = std::min(std::max(y, margin), 1 - margin);
    float p[3], d[3];
    for (int c = 0; c < 3; ++c) {
      p[c] = x * from_.u[c][k] + y * from_.v[c][k];
      d[c] = to_.origin[c][k] + e * to_.u[c][k] + f * to_.v[c][k] - p[c];
    }
    const float squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    const float ci = from_.normal[0][k] * d[0] + from_.normal[1][k] * d[1] + from_.normal[2][k] * d[2];
    const float cj = -(to_.normal[0][k] * d[0] + to_.normal[1][k] * d[1] + to_.normal[2][k] * d[2]);
    constexpr float kLeast = 1e-18f;  // squared lengths whose square a float holds
    kernel[k] = std::max(ci, 0.0f) * std::max(cj, 0.0f) / (std::max(squared, kLeast) * std::max(squared, kLeast)) * scale_[k];
    rays.ox[k] = from_.origin[0][k] + from_.step[0][k] + p[0];
    rays.oy[k] = from_.origin[1][k] + from_.step[1][k] + p[1];
    rays.oz[k] = from_.origin[2][k] + from_.step[2][k] + p[2];
    rays.dx[k] = d[0] + to_.step[0][k] - from_.step[0][k];
    rays.dy[k] = d[1] + to_.step[1][k] - from_.step[1][k];
    rays.dz[k] = d[2] + to_.step[2][k] - from_.step[2][k];
  }
}

}  // namespace farol
