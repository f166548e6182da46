// Which hemicubes of a batch may see a cluster of facets through a face: a list of layers and an indirect draw per
// (face, cluster). A cluster is left out where its box lies wholly beyond a side of the face's pyramid or below the
// horizon; the pixels of what is drawn do not depend on what is left out.
// Reads: frames [layers], clusters [clusters], faces [faces]. Writes: visible [faces x clusters x maxLayers], draws
// [faces x clusters]. A workgroup makes the lists of some clusters and one face, gl_WorkGroupID.y: its lanes look at as many
// layers side by side and keep their order, so that lists are always the same.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(local_size_x = kCullGroupSize) in;
layout(push_constant) uniform Push { CullPush push; };
layout(std430, set = 0, binding = kBindingCullFrames) readonly buffer Frames { HemicubeFrame frames[]; };
layout(std430, set = 0, binding = kBindingCullClusters) readonly buffer Clusters { ClusterRecord clusters[]; };
layout(std430, set = 0, binding = kBindingCullFaces) readonly buffer Faces { FaceRecord faces[]; };
layout(std430, set = 0, binding = kBindingCullVisible) writeonly buffer Visible { uint visible[]; };
layout(std430, set = 0, binding = kBindingCullDraws) writeonly buffer Draws { uint draws[]; };

// Float rounding of distances in unit coordinates, generously: what touches a plane is kept.
const float kMargin = 1e-6;

bool beyond(vec3 plane, HemicubeFrame frame, vec3 centre, vec3 halfSize) {
  const vec3 normal = frame.axisX.xyz * plane.x + frame.axisY.xyz * plane.y + frame.axisN.xyz * plane.z;
  return dot(normal, centre) + dot(abs(normal), halfSize) < -kMargin;
}

// Bits of the lanes whose layer is kept. Three by turns, one filled, one read, one cleared: a single barrier a step is enough.
shared uint keptLanes[3][2];

void main() {
  const uint lane = gl_LocalInvocationID.x, face = gl_WorkGroupID.y;
  const vec3 r = faces[face].right.xyz, u = faces[face].up.xyz, f = faces[face].forward.xyz;
  const float low = faces[face].right.w, bottom = faces[face].up.w;
  if (lane < 2u) keptLanes[0][lane] = 0u;
  barrier();
  uint turn = 0u;
  for (uint k = gl_WorkGroupID.x; k < push.clusters; k += gl_NumWorkGroups.x) {
    const ClusterRecord cluster = clusters[k];
    const uint list = face * push.clusters + k, first = list * push.maxLayers;
    uint count = 0u;
    for (uint start = 0u; start < push.layers; start += kCullGroupSize) {
      const uint layer = start + lane;
      bool kept = layer < push.layers;
      if (kept) {
        const HemicubeFrame frame = frames[layer];
        const vec3 c = cluster.centre.xyz - frame.origin.xyz, h = cluster.halfSize.xyz;
        kept = !(beyond(f - r, frame, c, h) || beyond(r - low * f, frame, c, h) || beyond(f - u, frame, c, h) ||
                 beyond(u - bottom * f, frame, c, h) || beyond(vec3(0.0, 0.0, 1.0), frame, c, h));
      }
      const uint next = turn == 2u ? 0u : turn + 1u;
      if (lane < 2u) keptLanes[next][lane] = 0u;
      if (kept) atomicOr(keptLanes[turn][lane / 32u], 1u << (lane % 32u));
      barrier();
      const uint bits0 = keptLanes[turn][0], bits1 = keptLanes[turn][1];
      if (kept) {
        const uint below = bitCount((lane < 32u ? bits0 : bits1) & ((1u << (lane % 32u)) - 1u)) + (lane < 32u ? 0u : bitCount(bits0));
        visible[first + count + below] = layer;
      }
      count += bitCount(bits0) + bitCount(bits1);
      turn = next;
    }
    if (lane == 0u) {
      // An indexed indirect draw: index count, instances, first index, vertex offset, first instance.
      draws[5u * list] = cluster.indexCount;
      draws[5u * list + 1u] = count;
      draws[5u * list + 2u] = cluster.firstIndex;
      draws[5u * list + 3u] = 0u;
      draws[5u * list + 4u] = first;
    }
  }
}
