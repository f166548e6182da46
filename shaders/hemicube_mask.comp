// Takes out of an image what its mirror does not show: a pixel of an image counts only where its parent, at the same pixel,
// shows the image's mirror, and so on up to the hemicube itself.
// Reads: items [layers x pixels], mirrorOfItem [cells + 3], images [layers] (parent layer, mirror). Writes: masked
// [layers x pixels].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(local_size_x = kMaskGroupSize) in;
layout(push_constant) uniform Push { MaskPush push; };
layout(std430, set = 0, binding = kBindingMaskItems) readonly buffer Items { uint items[]; };
layout(std430, set = 0, binding = kBindingMaskMirrors) readonly buffer Mirrors { uint mirrorOfItem[]; };
layout(std430, set = 0, binding = kBindingMaskImages) readonly buffer Images { uvec2 images[]; };
layout(std430, set = 0, binding = kBindingMasked) writeonly buffer Masked { uint masked[]; };

void main() {
  const uint pixel = gl_GlobalInvocationID.x, layer = gl_WorkGroupID.y;
  if (pixel >= push.pixels) return;
  uint item = items[layer * push.pixels + pixel];
  for (uvec2 image = images[layer]; image.x != kNoCell; image = images[image.x]) {
    if (mirrorOfItem[items[image.x * push.pixels + pixel]] != image.y) {
      item = push.maskedItem;
      break;
    }
  }
  masked[layer * push.pixels + pixel] = item;
}
