// One Jacobi sweep over a block of rows: to = r + rho F from, for three channels, and the largest change.
// Reads: factors [rows x columns] in half precision, from, residual and reflectance [3 x columns]. Writes: to. A workgroup
// makes some rows, which share every load of `from`; its lanes walk the columns side by side, eight at a time.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

#ifdef WIDE
layout(local_size_x = kJacobiWideGroupSize) in;
const uint kLanes = kJacobiWideGroupSize;
#else
layout(local_size_x = kJacobiGroupSize) in;
const uint kLanes = kJacobiGroupSize;
#endif
layout(push_constant) uniform Push { JacobiPush push; };
layout(std430, set = 0, binding = kBindingFactors) readonly buffer Factors { uvec4 factors[]; };
layout(std430, set = 0, binding = kBindingFrom) readonly buffer From { vec4 from[]; };
layout(std430, set = 0, binding = kBindingTo) writeonly buffer To { float to[]; };
layout(std430, set = 0, binding = kBindingResidual) readonly buffer Residual { float residual[]; };
layout(std430, set = 0, binding = kBindingReflectance) readonly buffer Reflectance { float reflectance[]; };
layout(std430, set = 0, binding = kBindingChanges) buffer Changes { uint changes[]; };

shared float partial[kJacobiRows * 3u][kLanes];

void main() {
  const uint lane = gl_LocalInvocationID.x;
  const uint quads = push.columns / 4u, eights = push.columns / 8u;
  const uint row = gl_WorkGroupID.x * kJacobiRows;
  vec3 sums[kJacobiRows];
  for (int k = 0; k < int(kJacobiRows); ++k) sums[k] = vec3(0.0);
  for (uint e = lane; e < eights; e += kLanes) {
    const uint q = 2u * e;
    const vec4 red0 = from[q], red1 = from[q + 1u];
    const vec4 green0 = from[quads + q], green1 = from[quads + q + 1u];
    const vec4 blue0 = from[2u * quads + q], blue1 = from[2u * quads + q + 1u];
    for (int k = 0; k < int(kJacobiRows); ++k) {
      const uvec4 f = factors[(row + uint(k)) * eights + e];
      const vec4 f0 = vec4(unpackHalf2x16(f.x), unpackHalf2x16(f.y)), f1 = vec4(unpackHalf2x16(f.z), unpackHalf2x16(f.w));
      sums[k] += vec3(dot(f0, red0) + dot(f1, red1), dot(f0, green0) + dot(f1, green1), dot(f0, blue0) + dot(f1, blue1));
    }
  }
  for (int k = 0; k < int(kJacobiRows); ++k) {
    for (int c = 0; c < 3; ++c) partial[3 * k + c][lane] = sums[k][c];
  }
  barrier();
  float change = 0.0;
  for (uint place = lane; place < kJacobiRows * 3u; place += kLanes) {
    float sum = 0.0;
    for (uint l = 0u; l < kLanes; ++l) sum += partial[place][l];
    const uint channel = place % 3u;
    const uint i = channel * push.columns + push.firstRow + row + place / 3u;
    const float next = residual[i] + reflectance[i] * sum;
    change = max(change, abs(next - from[i / 4u][i % 4u]));
    to[i] = next;
  }
  atomicMax(changes[push.sweep], floatBitsToUint(change));
}
