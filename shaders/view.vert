// Projects facet vertices into the camera's picture. One invocation: one facet corner.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(push_constant) uniform Push { ViewPush push; };

layout(location = 0) in vec3 position;  // [unit coordinates]
layout(location = 1) in uint corner;    // 4 * facet + corner number

layout(location = 0) out vec2 uv;
layout(location = 1) flat out uint facet;

invariant gl_Position;

void main() {
  const vec4 p = vec4(position - push.origin.xyz, 1.0);
  gl_Position = vec4(dot(push.rowX, p), dot(push.rowY, p), dot(push.rowZ, p), dot(push.rowW, p));
  const uint k = corner & 3u;
  facet = corner >> 2;
  uv = vec2(k == 1u || k == 2u ? 1.0 : 0.0, k >= 2u ? 1.0 : 0.0);  // a triangle has corners 0, 1, 3
}
