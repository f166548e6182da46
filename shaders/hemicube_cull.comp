// Which hemicubes of a batch may see a cluster of facets through a face: a list of layers and an indirect draw per
// (face, cluster). A cluster is left out where its box lies wholly beyond a side of the face's pyramid or below the
// horizon; the pixels of what is drawn do not depend on what is left out.
// Reads: frames [layers], clusters [clusters], faces [faces]. Writes: visible [faces x clusters x maxLayers], draws
// [faces x clusters]. One invocation walks the layers of one (face, cluster) in order, so that lists are always the same.
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

void main() {
  const uint k = gl_GlobalInvocationID.x;
  if (k >= push.faces * push.clusters) return;
  const FaceRecord face = faces[k / push.clusters];
  const ClusterRecord cluster = clusters[k % push.clusters];
  const vec3 r = face.right.xyz, u = face.up.xyz, f = face.forward.xyz;
  const uint first = k * push.maxLayers;
  uint count = 0;
  for (uint layer = 0; layer < push.layers; ++layer) {
    const HemicubeFrame frame = frames[layer];
    const vec3 c = cluster.centre.xyz - frame.origin.xyz, h = cluster.halfSize.xyz;
    if (beyond(f - r, frame, c, h) || beyond(r - face.right.w * f, frame, c, h) || beyond(f - u, frame, c, h) ||
        beyond(u - face.up.w * f, frame, c, h) || beyond(vec3(0.0, 0.0, 1.0), frame, c, h)) {
      continue;
    }
    visible[first + count] = layer;
    ++count;
  }
  // An indexed indirect draw: index count, instances, first index, vertex offset, first instance.
  draws[5 * k] = cluster.indexCount;
  draws[5 * k + 1] = count;
  draws[5 * k + 2] = cluster.firstIndex;
  draws[5 * k + 3] = 0;
  draws[5 * k + 4] = first;
}
