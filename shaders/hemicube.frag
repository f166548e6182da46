// Writes the item seen by a pixel: (u,v) -> cell of the facet's grid, or push.backItem for a black back.
// The cell map, cell -> patch, is applied by the reduction: there once per run of equal pixels, here it would
// cost a load per pixel (on Mesa lavapipe 1.2 times the time of a row at R = 64, 1.6 times at R = 256).
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(push_constant) uniform Push { ItemPush push; };

layout(location = 0) in vec2 grid;
layout(location = 1) flat in uvec4 facet;  // frontCell, backCell, nu, nv
layout(location = 0) out uint item;

// The same arithmetic as cellAt in patch/patches.h; a triangle's corners are (0,0), (1,0), (0,1).
uint cellOf() {
  const uint nu = facet.z, nv = facet.w;
  const uvec2 c = uvec2(max(grid, vec2(0.0)));
  if (nv != 0u) return min(c.y, nv - 1u) * nu + min(c.x, nu - 1u);
  const uint row = min(c.y, nu - 1u);
  const uint column = min(c.x, nu - 1u - row);
  const bool inverted = (grid.x - column) + (grid.y - row) > 1.0 && column + row + 1u < nu;
  return row * (2u * nu - row) + 2u * column + (inverted ? 1u : 0u);
}

void main() {
  const uint first = gl_FrontFacing ? facet.x : facet.y;
  item = first == kNoCell ? push.backItem : first + cellOf();
}
