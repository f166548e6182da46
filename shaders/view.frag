// Writes which facet a sample of the picture sees, from which side (kBackBit), and where on it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(location = 0) in vec2 uv;
layout(location = 1) flat in uint facet;
layout(location = 0) out uint seenFacet;
layout(location = 1) out vec2 seenUv;

void main() {
  seenFacet = gl_FrontFacing ? facet : facet | kBackBit;
  seenUv = uv;
}
