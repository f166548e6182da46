// rows [layers x bins] -> lists [layers x (1 + most)]: the bins of each layer that hold something, ascending, with their
// sums; the first pair of a layer is their number. Lists lie in memory of the host, which then never sees the empty bins.
// Reads: rows. Writes: lists. A workgroup makes the list of one layer, gl_WorkGroupID.x: its lanes look at as many bins
// side by side and keep their order.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(local_size_x = kCompactGroupSize) in;
layout(push_constant) uniform Push { CompactPush push; };
layout(std430, set = 0, binding = kBindingCompactRows) readonly buffer Rows { uint rows[]; };
layout(std430, set = 0, binding = kBindingCompactLists) writeonly buffer Lists { uvec2 lists[]; };

// Bits of the lanes whose bin holds something. Three by turns, one filled, one read, one cleared: a single barrier a step
// is enough.
const uint kWords = kCompactGroupSize / 32u;
shared uint filled[3][kWords];

void main() {
  const uint lane = gl_LocalInvocationID.x, layer = gl_WorkGroupID.x, list = layer * (1u + push.most);
  if (lane < kWords) filled[0][lane] = 0u;
  barrier();
  uint turn = 0u, count = 0u;
  for (uint start = 0u; start < push.bins; start += kCompactGroupSize) {
    const uint bin = start + lane;
    const uint sum = bin < push.bins ? rows[layer * push.bins + bin] : 0u;
    const uint next = turn == 2u ? 0u : turn + 1u;
    if (lane < kWords) filled[next][lane] = 0u;
    if (sum != 0u) atomicOr(filled[turn][lane / 32u], 1u << (lane % 32u));
    barrier();
    uint place = count;
    for (uint w = 0u; w < kWords; ++w) {
      const uint bits = filled[turn][w], found = bitCount(bits);
      if (w < lane / 32u) place += found;
      if (w == lane / 32u) place += bitCount(bits & ((1u << (lane % 32u)) - 1u));
      count += found;
    }
    if (sum != 0u) lists[list + 1u + place] = uvec2(bin, sum);
    turn = next;
  }
  if (lane == 0u) lists[list] = uvec2(count, 0u);
}
