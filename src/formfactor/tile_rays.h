// Where rays start and which way they go: one low-discrepancy sequence, shared by the patches of a tile.
#pragma once

#include "patch/patches.h"
#include "trace/tracer.h"

#include <array>
#include <span>
#include <vector>

namespace farol {

// What rays share: 16 blocks of K consecutive points of Sobol's sequence (two dimensions for the direction, two for the
// origin), each sorted so that neighbours run side by side. The patches of a tile of 4 x 4
// cells take one block each: together they hold one complete sequence of 16 K points, so that what one patch of a tile
// misses another finds. One turn and shift per tile, which also says who takes which block. The seed scrambles the
// sequence as a whole by a digital shift.
struct SampleTable {
  static constexpr uint32_t kBlocks = 16;
  static constexpr uint32_t kMostTogether = 1024;  // K up to which the patches of a tile are traced together
  enum class Kind { lowDiscrepancy, random };      // random: for comparison only

  SampleTable(uint32_t samples, uint64_t seed, Kind kind = Kind::lowDiscrepancy);

  // Directions (unit, z along the normal) and origins in the unit square, [16 K] and a packet of zeros.
  struct Columns {
    std::vector<float> dx, dy, dz, s, t;
  };

  uint32_t samples;                    // K, per block
  Columns apart;                       // block after block
  Columns together;                    // all blocks in one order of directions; empty beyond kMostTogether
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

// The rays of one patch, or of several patches of one flat tile mixed in the order of their directions: packets of few
// rays per patch are then as narrow as those of many.
class TileRays {
 public:
  // `spread`: origins over the patch; otherwise all at its centre. `seed`: of the seats.
  TileRays(const FacetSet& facets, const PatchSet& patches, const SampleTable& table, bool spread, uint64_t seed,
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
