// Copies structs of interface.h member by member, so that a test can compare both languages' layouts.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) readonly buffer FacetsIn { FacetRecord facetsIn[]; };
layout(std430, set = 0, binding = 1) readonly buffer FramesIn { HemicubeFrame framesIn[]; };
layout(std430, set = 0, binding = 2) writeonly buffer FacetsOut { FacetRecord facetsOut[]; };
layout(std430, set = 0, binding = 3) writeonly buffer FramesOut { HemicubeFrame framesOut[]; };

void main() {
  const uint i = gl_GlobalInvocationID.x;
  if (i >= facetsIn.length()) return;
  facetsOut[i] = FacetRecord(facetsIn[i].plane, facetsIn[i].frontCell, facetsIn[i].backCell, facetsIn[i].nu, facetsIn[i].nv);
  framesOut[i] = HemicubeFrame(framesIn[i].origin, framesIn[i].axisX, framesIn[i].axisY, framesIn[i].axisN,
                               framesIn[i].clip);
}
