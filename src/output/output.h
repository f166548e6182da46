// Writers of result files. No computation; every file appears whole or not at all.
#pragma once

#include "base/image.h"
#include "solve/node_irradiance.h"

#include <string>
#include <vector>

namespace farol {

// 8-bit sRGB [3 x width x height] as PNG.
void writePng(const std::string& path, uint32_t width, uint32_t height, const std::vector<uint8_t>& srgb);

// Linear radiance times `scale` as OpenEXR, 32-bit float R, G, B.
void writeExr(const std::string& path, const Image& image, double scale);

// One line per patch (RFC 4180); columns as in the README. `error` is the column err, nan where it is empty.
void writePatchesCsv(const std::string& path, const Scene& scene, const PatchSet& patches, const FormFactorMatrix* f,
                     const Solution& solution, const std::vector<Rgb>& error);

// Mean factors between surfaces, weighted by exposed area: header "surface,area,<names...>,(open),(cut)"; what
// black backs and solids take is in no column. Of coloured mirrors: red's factors.
void writeFactorsBySurface(const std::string& path, const Scene& scene, const PatchSet& patches, const FormFactorMatrix& f);

// F by patch: NumPy dense float32 [N x N], or MatrixMarket coordinates of the entries above 0.
void writeFactorsNpy(const std::string& path, const FormFactorMatrix& f);
void writeFactorsMtx(const std::string& path, const FormFactorMatrix& f);

// Reads what writeFactorsNpy wrote; what a row falls short of 1 by counts as missed. Throws Error when the file is not
// a square float32 matrix of `patches` rows with entries in [0, 1].
FormFactorMatrix loadFactorsNpy(const std::string& path, size_t patches);

// The lit scene for any glTF viewer: cells as unlit triangles, COLOR_0 = scale B / pi; float B and H in
// _RADIOSITY and _IRRADIANCE. The scale makes the brightest vertex 2^exposure; what exceeds 1 is cut.
void writeLitGlb(const std::string& path, const Scene& scene, const FacetSet& facets, const PatchSet& patches,
                 const NodeIrradiance& irradiance, double exposure);

}  // namespace farol
