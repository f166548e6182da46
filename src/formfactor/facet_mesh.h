// Facets as a GPU draws them: vertex and index data, and clusters of near facets for culling.
#pragma once

#include "patch/facets.h"
#include "shared/interface.h"

#include <span>
#include <vector>

namespace farol {

// 16 bytes per corner: position in unit coordinates, then 4 * facet + corner number. Welded corners have the same
// bits, so that shared edges leave no crack.
struct FacetMesh {
  struct Vertex {
    float x, y, z;
    uint32_t corner;
  };
  std::vector<Vertex> vertices;
  std::vector<uint32_t> indices;
};

// Facets in the order given, or in their own when `order` is empty.
FacetMesh buildFacetMesh(const FacetSet& facets, std::span<const uint32_t> order = {});

// Facets are culled in clusters: few enough that one draw per face and cluster costs little beside the drawing.
struct FacetClusters {
  std::vector<uint32_t> order;                 // facets, near ones together
  std::vector<shader::ClusterRecord> records;  // ranges of the index buffer of a mesh in that order
};
FacetClusters buildClusters(const FacetSet& facets);
size_t clusterCountOf(const FacetSet& facets);

}  // namespace farol
