// Rows of F by rays (Malley's method): directions distributed as the cosine, origins spread over the patch, so that a
// row estimates the area-to-area factors. The error of a row falls with the number of rays K as about K^-0.6 (from one
// origin K^-0.73; random directions K^-0.5).
#pragma once

#include "formfactor/form_factors.h"
#include "trace/ray_tree.h"

#include <array>
#include <memory>

namespace farol {

// What rays share: 16 blocks of K consecutive points of Sobol's sequence (two dimensions for the direction, two for the
// origin), each sorted so that neighbours run side by side. The patches of a tile of 4 x 4
// cells take one block each: together they hold one complete sequence of 16 K points, so that what one patch of a tile
// misses another finds. One turn and shift per tile, which also says who takes which block. The seed scrambles the
// sequence as a whole by a digital shift.
struct SampleTable {
  static constexpr uint32_t kBlocks = 16;
  enum class Kind { lowDiscrepancy, random };  // random: for comparison only

  SampleTable(uint32_t samples, uint64_t seed, Kind kind = Kind::lowDiscrepancy);

  // Directions (unit, z along the normal) and origins in the unit square, [16 K] and a packet of zeros.
  struct Columns {
    std::vector<float> dx, dy, dz, s, t;
  };

  uint32_t samples;                   // K, per block
  Columns apart;                      // block after block
  Columns together;                   // all blocks in one order of directions; empty where K is large
  std::vector<uint32_t> togetherFrom;  // [16 K] and a packet of zeros: the block of each
};

// Where a patch stands in its tile, and what its tile does to the table.
struct TileSeat {
  uint64_t tile = 0;
  bool flat = false;   // all patches of the tile lie on one side of one facet
  uint32_t block = 0;  // 0..15
  double turn = 0;     // of directions about the normal [rad]
  float s = 0, t = 0;  // shift of origins, modulo 1
};
TileSeat seatOf(const FacetSet& facets, const PatchSet& patches, uint32_t patch, uint64_t seed);

struct RayOptions {
  uint32_t rays = 256;  // K per patch
  uint64_t seed = 1;
  TreeLimits limits = {};         // of paths over mirrors and glass
  bool spread = true;  // origins over the patch; otherwise all at its centre (for comparison)
  SampleTable::Kind kind = SampleTable::Kind::lowDiscrepancy;
};

// Works on all cores through TBB; a row does not depend on the number of threads.
class RayRowMaker : public RowMaker {
 public:
  // The references must outlive the maker.
  RayRowMaker(const Tracer& tracer, const FacetSet& facets, const PatchSet& patches, const RayOptions& options);
  ~RayRowMaker() override;

  void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The rays of one patch, or of several patches of one flat tile mixed in the order of their directions: packets of few
// rays per patch are then as narrow as those of many.
class TileRays {
 public:
  TileRays(const FacetSet& facets, const PatchSet& patches, const SampleTable& table, const RayOptions& options,
           std::span<const uint32_t> members);

  // The next packet: how many rays it has (0 at the end), and per ray which member it starts from.
  uint32_t next(RayPacket& rays, std::array<uint32_t, kPacketSize>& member);

 private:
  struct Span {  // one piece: origin + s u + t v
    glm::vec3 origin, u, v;
    float end;  // share of the patch's area up to its end
    bool triangle;
    std::array<glm::vec3, 3> frame;  // with its own normal
  };
  struct Member {
    std::vector<Span> pieces;
    float margin = 0;
    bool bent = false;  // pieces have normals of their own
  };
  const Span& place(const Member& member, float s, float t, uint32_t lane, RayPacket& rays) const;

  const SampleTable& table_;
  uint32_t at_, end_;
  bool together_, spread_;
  bool alike_;  // every member is one piece with the same sides
  float shiftS_, shiftT_;
  glm::vec3 tangent_, bitangent_, normal_;
  std::array<uint32_t, SampleTable::kBlocks> memberOf_;  // by block; kNone where nobody sits
  bool full_;                                            // somebody sits everywhere
  std::vector<Member> members_;
};

}  // namespace farol
