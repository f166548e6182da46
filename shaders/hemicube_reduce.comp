// rows[layer][bin] = sum of the delta form factors of the layer's pixels that see an item of the bin.
// Reads: items [layers x pixels], deltaFactors [pixels], with MAPPED itemBins [items]. Adds to: rows [layers x bins].
// One lane walks 16 consecutive pixels and adds once per run of equal items; a workgroup covers 1024 pixels
// of layer gl_WorkGroupID.y. Integer sums do not depend on the order and cannot overflow: a layer's factors
// sum to 2^32 - 1.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(local_size_x = kReduceGroupSize) in;
layout(push_constant) uniform Push { ReducePush push; };
layout(std430, set = 0, binding = kBindingItems) readonly buffer Items { uvec4 items[]; };
layout(std430, set = 0, binding = kBindingDeltaFactors) readonly buffer DeltaFactors { uvec4 deltaFactors[]; };
layout(std430, set = 0, binding = kBindingRows) buffer Rows { uint rows[]; };

// Where every cell is a patch of its own, items and bins have the same numbers: no look-up.
#ifdef MAPPED
layout(std430, set = 0, binding = kBindingItemBins) readonly buffer ItemBins { uint itemBins[]; };
uint binOf(uint item) { return itemBins[item]; }
#else
uint binOf(uint item) { return item; }
#endif

void main() {
  const uint quads = push.pixels / 4u;
  const uint perLane = kReducePixelsPerLane / 4u;
  const uint first = gl_GlobalInvocationID.x * perLane;
  if (first >= quads) return;
  const uint last = min(first + perLane, quads);
  const uint layer = gl_WorkGroupID.y;
  const uint row = layer * push.bins;

  uint current = items[layer * quads + first].x;
  uint sum = 0u;
  for (uint q = first; q < last; ++q) {
    const uvec4 item = items[layer * quads + q];
    const uvec4 factor = deltaFactors[q];
    for (int k = 0; k < 4; ++k) {
      if (item[k] != current) {
        atomicAdd(rows[row + binOf(current)], sum);
        current = item[k];
        sum = 0u;
      }
      sum += factor[k];
    }
  }
  if (sum != 0u) atomicAdd(rows[row + binOf(current)], sum);
}
