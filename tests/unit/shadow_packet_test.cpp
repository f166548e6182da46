#include "light/shadow_packet.h"

#include <gtest/gtest.h>

using namespace farol;

namespace {

// Two unit squares face to face at distance 1; Siegel and Howell, Thermal Radiation Heat Transfer, case C-11.
constexpr double kParallelSquares = 0.19982489569838746;

Piece receiver(bool triangle) {
  Piece piece;
  piece.origin = Vec3(0.2, 0.3, 0);
  piece.u = Vec3(0.5, 0, 0);
  piece.v = Vec3(0, 0.5, 0);
  piece.normal = Vec3(0, 0, 1);
  piece.triangle = triangle;
  return piece;
}

// Above the receiver, seen from below; `half` 1 and 2: its triangles.
Lamp lamp(int half) {
  const Vec3 a(0.2, 0.3, 0.5), b(0.2, 0.8, 0.5), c(0.7, 0.8, 0.5), d(0.7, 0.3, 0.5);
  Lamp l;
  l.polygon = half == 0 ? std::vector{a, b, c, d} : half == 1 ? std::vector{a, b, c} : std::vector{a, c, d};
  l.normal = Vec3(0, 0, -1);
  l.area = half == 0 ? 0.25 : 0.125;
  return l;
}

// Mean of the kernel over many pairs of points: the form factor from the receiver to the lamp.
double meanKernel(const Piece& from, const Lamp& to) {
  constexpr uint32_t kCount = 1u << 14;
  const ShadowPoints points(kCount);
  ShadowPacket packet;
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    packet.startOn(k, from, kRayOffset);
    packet.endOn(k, to, to.area / kPi, {1u << 30, 123456789u, 0xC0000000u, 5u});
  }
  double sum = 0;
  for (uint32_t first = 0; first < kCount; first += kPacketSize) {
    packet.draw(points, first);
    packet.place(0);
    for (const float k : packet.kernel) sum += static_cast<double>(k);
  }
  return sum / kCount;
}

}  // namespace

TEST(ShadowPacket, KernelsOfPairsOfPointsAddUpToTheFormFactor) {
  constexpr double kSampling = 1e-4;
  EXPECT_NEAR(meanKernel(receiver(false), lamp(0)), kParallelSquares, kSampling);
  EXPECT_NEAR(meanKernel(receiver(false), lamp(1)) + meanKernel(receiver(false), lamp(2)), kParallelSquares, kSampling);
  // Both halves of the receiver see the lamp alike, by symmetry.
  EXPECT_NEAR(meanKernel(receiver(true), lamp(0)), kParallelSquares, kSampling);
}

TEST(ShadowPacket, RaysRunFromThePieceToTheLampAndKeepOffTheEdges) {
  constexpr float kMargin = 0.01f;
  const ShadowPoints points(256);
  for (const bool triangle : {false, true}) {
    const Piece from = receiver(triangle);
    ShadowPacket packet;
    for (uint32_t k = 0; k < kPacketSize; ++k) {
      packet.startOn(k, from, kRayOffset);
      packet.endOn(k, lamp(2), 1, {});
    }
    for (uint32_t first = 0; first < 256; first += kPacketSize) {
      packet.draw(points, first);
      packet.place(kMargin);
      for (uint32_t k = 0; k < kPacketSize; ++k) {
        const Vec3 start(packet.rays.ox[k], packet.rays.oy[k], packet.rays.oz[k]);
        const Vec3 end = start + Vec3(packet.rays.dx[k], packet.rays.dy[k], packet.rays.dz[k]);
        EXPECT_NEAR(start.z, kRayOffset, 1e-9);
        EXPECT_NEAR(end.z, 0.5 - kRayOffset, 1e-7);
        const double s = (start.x - from.origin.x) / 0.5, t = (start.y - from.origin.y) / 0.5;
        EXPECT_GE(std::min(s, t), 0.0099);
        EXPECT_LE(triangle ? s + t : std::max(s, t), triangle ? 1.0101 : 0.9901);  // the margin is taken after folding
        EXPECT_GE(end.x - 0.2, end.y - 0.3 - 1e-6);                                // the lamp's lower right half
      }
    }
  }
}

// Rays end a step before the lamp, along its normal.
TEST(ShadowPacket, RaysEndBeforeTheLamp) {
  Lamp point = lamp(0);
  point.polygon.assign(4, Vec3(0.4, 0.5, 0.5));
  point.normal = glm::normalize(Vec3(3, 4, -12));
  constexpr double kStep = 100 * kRayOffset;  // of the receiver; the lamp's is kRayOffset
  ShadowPacket packet;
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    packet.startOn(k, receiver(false), kStep);
    packet.endOn(k, point, 1, {});
  }
  packet.draw(ShadowPoints(16), 0);
  packet.place(0);
  const Vec3 wanted = point.polygon[0] + kRayOffset * point.normal;
  for (uint32_t k = 0; k < kPacketSize; ++k) {
    EXPECT_NEAR(packet.rays.ox[k] + packet.rays.dx[k], wanted.x, 0.3 * kRayOffset);
    EXPECT_NEAR(packet.rays.oy[k] + packet.rays.dy[k], wanted.y, 0.3 * kRayOffset);
    EXPECT_NEAR(packet.rays.oz[k] + packet.rays.dz[k], wanted.z, 0.3 * kRayOffset);
    EXPECT_NEAR(packet.rays.oz[k], kStep, 1e-9);
  }
}

TEST(ShadowPacket, PointsBehindOneAnotherDoNotCount) {
  Piece from = receiver(false);
  from.normal = Vec3(0, 0, -1);
  EXPECT_EQ(meanKernel(from, lamp(0)), 0);
  Lamp away = lamp(0);
  away.normal = Vec3(0, 0, 1);
  EXPECT_EQ(meanKernel(receiver(false), away), 0);
}

TEST(ShadowPacket, SequencesGoRound) {
  const ShadowPoints points(48);
  for (const auto& column : points.columns) {
    ASSERT_EQ(column.size(), 48 + kPacketSize);
    for (uint32_t k = 0; k < kPacketSize; ++k) EXPECT_EQ(column[48 + k], column[k]);
  }
}
