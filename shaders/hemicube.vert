// Projects welded facet vertices onto one face of the hemicube (or cubic tetrahedron) of each instance.
// Reads: facets [facets], frames [layers], with LAYERED visible [instances]. One invocation: one facet corner of one
// hemicube. With LAYERED an instance looks its layer up in the list that culling made; without it each layer is drawn
// in a pass of its own, whole. With IMAGES frames may be images in mirrors.
#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef LAYERED_IMAGES
#define LAYERED
#define IMAGES
#endif
#ifdef LAYERED
#extension GL_ARB_shader_viewport_layer_array : require
#endif
#include "shared/interface.h"

layout(push_constant) uniform Push { ItemPush push; };
layout(std430, set = 0, binding = kBindingFacets) readonly buffer Facets { FacetRecord facets[]; };
layout(std430, set = 0, binding = kBindingFrames) readonly buffer Frames { HemicubeFrame frames[]; };

#ifdef LAYERED
layout(std430, set = 0, binding = kBindingVisible) readonly buffer Visible { uint visible[]; };
#endif

layout(location = 0) in vec3 position;  // [unit coordinates]
layout(location = 1) in uint corner;    // 4 * facet + corner number

layout(location = 0) out vec2 grid;         // (u,v) times the number of cells
layout(location = 1) flat out uvec4 facet;  // the FacetRecord, fetched here and not once per pixel

invariant gl_Position;  // shared vertices land on the same pixel: no cracks

void main() {
#ifdef LAYERED
  const uint layer = visible[gl_InstanceIndex];
  gl_Layer = int(layer);
#else
  const uint layer = push.layer;
#endif
  const HemicubeFrame frame = frames[layer];
  const vec3 d = position - frame.origin.xyz;
  const vec3 p = vec3(dot(frame.axisX.xyz, d), dot(frame.axisY.xyz, d), dot(frame.axisN.xyz, d));
  const float depth = dot(push.forward.xyz, p);
  gl_Position = vec4(dot(push.right.xyz, p) * push.right.w + push.shift.x * depth,
                     dot(push.up.xyz, p) * push.up.w + push.shift.y * depth,
                     push.forward.w, depth);  // reversed z: near / depth, infinite far plane
#ifdef IMAGES
  gl_ClipDistance[0] = dot(frame.clip.xyz, position) + frame.clip.w;
#endif
  const uint k = corner & 3u;
  const FacetRecord f = facets[corner >> 2];
  // A facet whose plane holds the eye, the patch's own first of all, is seen edge-on and covers nothing; rounding
  // would make it a sliver that is large where it passes the eye. Put all of it in front of the near plane.
  if (abs(dot(f.plane.xyz, frame.origin.xyz) - f.plane.w) < push.shift.z) gl_Position = vec4(0.0, 0.0, 1.0, 0.0);
  facet = uvec4(f.frontCell, f.backCell, f.nu, f.nv);
#ifdef IMAGES
  if (frame.origin.w != 0.0) facet.xy = facet.yx;  // a left-handed frame turns the winding round
#endif
  grid = vec2(f.nu, f.nv != 0u ? f.nv : f.nu) * vec2(k == 1u || k == 2u ? 1.0 : 0.0, k >= 2u ? 1.0 : 0.0);  // a triangle has corners 0, 1, 3
}
