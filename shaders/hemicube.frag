// Writes the patch seen by a pixel: (u,v) -> cell of the facet's grid -> patch by the cell map.
// Reads: facets [facets], cellMap [cells]. Writes: item buffer, a patch number or push.backBin.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shared/interface.h"

layout(push_constant) uniform Push { ItemPush push; };
layout(std430, set = 0, binding = kBindingFacets) readonly buffer Facets { FacetRecord facets[]; };
layout(std430, set = 0, binding = kBindingCellMap) readonly buffer CellMap { uint cellMap[]; };

layout(location = 0) in vec2 uv;
layout(location = 1) flat in uint facet;
layout(location = 0) out uint item;

// The same arithmetic as cellAt in patch/patches.h; a triangle's corners are (0,0), (1,0), (0,1).
uint cellOf(FacetRecord f) {
  if (f.nv != 0u) {
    const uvec2 c = uvec2(clamp(floor(uv * vec2(f.nu, f.nv)), vec2(0.0), vec2(f.nu - 1u, f.nv - 1u)));
    return c.y * f.nu + c.x;
  }
  const uint n = f.nu;
  const uint row = uint(clamp(floor(uv.y * n), 0.0, float(n - 1u)));
  const uint column = min(uint(clamp(floor(uv.x * n), 0.0, float(n - 1u))), n - 1u - row);
  const bool inverted = (uv.x * n - column) + (uv.y * n - row) > 1.0 && column + row + 1u < n;
  return row * (2u * n - row) + 2u * column + (inverted ? 1u : 0u);
}

void main() {
  const FacetRecord f = facets[facet];
  const uint first = gl_FrontFacing ? f.frontCell : f.backCell;
  item = first == kNoCell ? push.backBin : cellMap[first + cellOf(f)];
}
