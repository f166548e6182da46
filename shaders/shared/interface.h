// What C++ and GLSL share: structs, binding numbers, workgroup sizes. Compiled by both.
#ifndef FAROL_INTERFACE_H
#define FAROL_INTERFACE_H

#ifdef __cplusplus
#include <array>
#include <cstdint>
namespace farol::shader {
using uint = uint32_t;
struct vec4 {
  float x = 0, y = 0, z = 0, w = 0;
};
// From any vector with x, y, z, such as GLM's.
template <typename Vector>
vec4 toVec4(const Vector& v, double w = 0) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z), static_cast<float>(w)};
}
#define FAROL_CONST inline constexpr uint32_t
#else
#define FAROL_CONST const uint
#endif

// Bindings of the item-buffer pipeline, set 0.
FAROL_CONST kBindingFacets = 0;   // FacetRecord [facets]
FAROL_CONST kBindingFrames = 1;   // HemicubeFrame [layers]
FAROL_CONST kBindingVisible = 2;  // uint [faces x clusters x maxLayers], layers that may see a cluster
FAROL_CONST kItemBindingCount = 3;

// Bindings of the culling, set 0.
FAROL_CONST kBindingCullFrames = 0;
FAROL_CONST kBindingCullClusters = 1;  // ClusterRecord [clusters]
FAROL_CONST kBindingCullFaces = 2;     // FaceRecord [faces]
FAROL_CONST kBindingCullVisible = 3;
FAROL_CONST kBindingCullDraws = 4;  // uint [faces x clusters x 5], indexed indirect draws
FAROL_CONST kCullBindingCount = 5;
FAROL_CONST kCullGroupSize = 64;  // layers side by side: two words of bits

// Bindings of the reduction, set 0. An item is a cell's number; the number of cells for nothing seen; one more for a
// black back.
FAROL_CONST kBindingItems = 0;         // uint [layers x pixels], item seen by each pixel
FAROL_CONST kBindingDeltaFactors = 1;  // uint [pixels], delta form factors that sum to 2^32 - 1
FAROL_CONST kBindingItemBins = 2;      // uint [cells + 2], item -> bin: the cell map, then the bins of the two below
FAROL_CONST kBindingRows = 3;          // uint [layers x bins], sums per bin: patches, nothing seen, black backs
FAROL_CONST kReduceBindingCount = 4;

FAROL_CONST kReduceGroupSize = 64;      // lanes per workgroup
FAROL_CONST kReducePixelsPerLane = 16;  // consecutive pixels that one lane walks as runs

// Bindings of the compaction, set 0.
FAROL_CONST kBindingCompactRows = 0;   // uint [layers x bins]
FAROL_CONST kBindingCompactLists = 1;  // uvec2 [layers x (1 + most)]
FAROL_CONST kCompactBindingCount = 2;
FAROL_CONST kCompactGroupSize = 128;  // bins side by side, a multiple of 32

// Bindings of the masking of images, set 0.
FAROL_CONST kBindingMaskItems = 0;
FAROL_CONST kBindingMaskMirrors = 1;  // uint [cells + 3], mirror of an item, or kNoCell
FAROL_CONST kBindingMaskImages = 2;   // uvec2 [layers], parent layer (kNoCell: a hemicube itself) and mirror
FAROL_CONST kBindingMasked = 3;
FAROL_CONST kMaskBindingCount = 4;
FAROL_CONST kMaskGroupSize = 64;

// Bindings of a Jacobi sweep, set 0.
FAROL_CONST kBindingFactors = 0;      // half [rows x columns], each row scaled by a power of two
FAROL_CONST kBindingFrom = 1;         // float [3 x columns]
FAROL_CONST kBindingTo = 2;           // float [3 x columns]
FAROL_CONST kBindingResidual = 3;     // float [3 x columns]
FAROL_CONST kBindingReflectance = 4;  // float [3 x columns], over the row's scale
FAROL_CONST kBindingChanges = 5;      // uint [sweeps], bits of the largest change
FAROL_CONST kJacobiBindingCount = 6;

FAROL_CONST kJacobiRows = 16;           // per workgroup
FAROL_CONST kJacobiGroupSize = 8;       // lanes on software devices, whose vectors are that wide
FAROL_CONST kJacobiWideGroupSize = 32;  // lanes elsewhere

FAROL_CONST kNoCell = 0xFFFFFFFFu;   // FacetRecord::backCell of a facet whose back is black
FAROL_CONST kBackBit = 0x80000000u;  // set in the view's facet ids where a back side is seen

// A facet as the shaders need it (32 bytes).
struct FacetRecord {
  vec4 plane;      // xyz: unit normal; w: distance from the origin along it [unit coordinates]
  uint frontCell;  // first cell of the front side
  uint backCell;   // first cell of the back side, or kNoCell
  uint nu;         // cells along u; a triangle's rows
  uint nv;         // cells along v; 0 marks a triangle
};

// Facets that are culled together (48 bytes): an axis-parallel box and a range of the index buffer.
struct ClusterRecord {
  vec4 centre;    // [unit coordinates], w unused
  vec4 halfSize;  // [unit coordinates], w unused
  uint firstIndex;
  uint indexCount;
  uint pad0;
  uint pad1;
};

// The pyramid of a face in the frame's own axes (48 bytes): low <= right . p / forward . p <= 1, likewise up.
struct FaceRecord {
  vec4 right;  // w: low
  vec4 up;     // w: bottom
  vec4 forward;
};

// Where a hemicube stands (80 bytes): a right-handed frame, axisN the patch normal; or its image in mirrors.
struct HemicubeFrame {
  vec4 origin;  // [unit coordinates], w: 1 where the frame is left-handed
  vec4 axisX;
  vec4 axisY;
  vec4 axisN;
  vec4 clip;  // of an image: only what has clip.xyz . p + clip.w > 0 is drawn
};

// One face of the hemicube or tetrahedron, in the frame's own axes (80 bytes, push constants).
// clip.x = right . p * right.w + shift.x * depth, clip.y likewise with up, depth = forward . p.
struct ItemPush {
  vec4 right;     // w: horizontal scale
  vec4 up;        // w: vertical scale
  vec4 forward;   // w: near distance [unit coordinates]
  vec4 shift;     // x, y: shifts; z: facets whose plane is this close to the eye are edge-on; w unused
  uint layer;     // without layered drawing: the frame that is drawn
  uint backItem;  // written where a black back is seen
  uint pad0;
  uint pad1;
};

// The camera (80 bytes, push constants): rows that map a point relative to the origin to clip coordinates.
struct ViewPush {
  vec4 origin;  // [unit coordinates]
  vec4 rowX;
  vec4 rowY;
  vec4 rowZ;
  vec4 rowW;
};

// Push constants of the culling (16 bytes).
struct CullPush {
  uint clusters;
  uint layers;     // of this batch
  uint maxLayers;  // stride of the lists
  uint pad0;
};

// Push constants of the reduction (16 bytes).
struct ReducePush {
  uint pixels;  // per layer, a multiple of 4
  uint bins;    // per layer: patches, then one for nothing seen, one for black backs
  uint pad0;
  uint pad1;
};

// Push constants of the compaction (16 bytes).
struct CompactPush {
  uint bins;  // per layer
  uint most;  // of them that may hold something
  uint pad0;
  uint pad1;
};

// Push constants of the masking (16 bytes).
struct MaskPush {
  uint pixels;      // per layer
  uint maskedItem;  // written where an image does not show
  uint pad0;
  uint pad1;
};

// Push constants of a Jacobi sweep (16 bytes).
struct JacobiPush {
  uint columns;   // a multiple of 32: padded with zeros
  uint firstRow;  // of the block
  uint sweep;     // whose change is told
  uint pad0;
};

#ifdef __cplusplus
static_assert(sizeof(FacetRecord) == 32 && sizeof(HemicubeFrame) == 80);
static_assert(sizeof(ClusterRecord) == 48 && sizeof(FaceRecord) == 48 && sizeof(CullPush) == 16 && sizeof(CompactPush) == 16);
static_assert(sizeof(ItemPush) == 80 && sizeof(ViewPush) == 80 && sizeof(ReducePush) == 16);
static_assert(sizeof(JacobiPush) == 16);
}  // namespace farol::shader
#endif
#undef FAROL_CONST
#endif
