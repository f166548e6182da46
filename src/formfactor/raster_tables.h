// What the shaders of raster.cpp look up, per facet, per item (a cell, then what is no cell) and per face of a projection.
// Internal to this room.
#pragma once

#include "formfactor/projection.h"
#include "patch/patches.h"
#include "shared/interface.h"

namespace farol {

class ImageTrees;

std::vector<shader::FacetRecord> facetRecords(const FacetSet& facets, const PatchSet& patches);

// Bin of every item: its cell's patch; then the bins for nothing seen, for black backs, where cells without a patch go as
// well, and for what an image does not show.
std::vector<uint32_t> itemBins(const PatchSet& patches);

// The mirror that an item shows, or kNoCell.
std::vector<uint32_t> itemMirrors(const PatchSet& patches, const ImageTrees* images);

std::vector<shader::FaceRecord> faceRecordsOf(const ProjectionLayout& layout);

// Every cell is a patch: items are their own bins.
bool isIdentity(const PatchSet& patches);

}  // namespace farol
