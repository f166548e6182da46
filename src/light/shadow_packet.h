// Sixteen shadow rays side by side, between points spread over a receiver and over its light sources.
#pragma once

#include "light/lamps.h"
#include "trace/tracer.h"

namespace farol {

// Four columns of a sequence, as fractions of 2^32: where on the receiver, where on the source. Sixteen numbers beyond the
// end are the first ones again.
struct ShadowPoints {
  std::array<std::vector<uint32_t>, 4> columns;
  uint32_t count = 0;

  explicit ShadowPoints(uint32_t count);  // of Sobol's sequence
};

class ShadowPacket {
 public:
  RayPacket rays;  // from the receiver to the source: direction times one
  // cos cos / r^2 x `scale` [unit coordinates squared]: with area / pi of the lamp its mean is the form factor to the lamp. 0: one
  // end does not see the other's front.
  alignas(64) float kernel[kPacketSize];

  // Where rays of a lane start: on a piece of a patch, `offset` before it, or at a point (no sides).
  void startOn(uint32_t lane, const Piece& piece, double offset);
  // Where they end: on a lamp; `shift` moves the sequence, so that lamps do not share one.
  void endOn(uint32_t lane, const Lamp& lamp, double scale, const std::array<uint32_t, 4>& shift);
  // At no lamp: the caller sets direction and kernel.
  void endNowhere(uint32_t lane, const std::array<uint32_t, 4>& shift);

  // Points `first` and following of the sequence, moved by the shifts, into s, t, a, b; first < points.count.
  void draw(const ShadowPoints& points, uint32_t first);
  alignas(64) float s[kPacketSize], t[kPacketSize], a[kPacketSize], b[kPacketSize];  // in [0, 1)

  Vec3 normalAt(uint32_t lane) const { return {from_.normal[0][lane], from_.normal[1][lane], from_.normal[2][lane]}; }

  // Rays and kernel from s, t, a, b; s and t are kept `margin` from the edges of the piece.
  void place(float margin);

 private:
  using Lanes = float[kPacketSize];
  struct alignas(64) Side {  // a flat piece: its corner, sides, normal and the step off it
    Lanes origin[3], u[3], v[3], normal[3], step[3], folds;
  };
  void set(Side& side, uint32_t lane, const Vec3& origin, const Vec3& u, const Vec3& v, const Vec3& normal, double offset,
           bool triangle);

  Side from_{}, to_{};  // to_.origin is relative to from_.origin
  Vec3 start_[kPacketSize];
  alignas(64) Lanes scale_{};
  alignas(64) uint32_t shift_[4][kPacketSize]{};
};

}  // namespace farol
