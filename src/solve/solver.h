// The radiosity system B = E + rho H, H = F B (+ sky), three channels with one F. With emitters apart: B = E + R for
// them and H = D + F R, where D is the direct irradiance that they give.
#pragma once

#include "formfactor/form_factors.h"
#include "light/direct.h"

#include <string>
#include <vector>

namespace farol {

namespace gpu {
class Device;
}

// Conjugate residuals take a fraction of the sweeps of the others where light fades slowly, and no more elsewhere.
enum class SolverKind { gaussSeidel, jacobi, conjugateResiduals };

struct SolveOptions {
  SolverKind kind = SolverKind::conjugateResiduals;
  // Stop when the error that the residual bounds, max|r| / (1 - contraction), is below this share of the
  // area-weighted mean radiosity of the non-emitting patches.
  double residual = 1e-5;
  size_t maxSweeps = 100000;
  Rgb sky{0};  // uniform radiosity seen wherever a row misses the scene
  // Sweeps by Jacobi in float32 there, inside a correction in double here; on the CPU from where it fails.
  const gpu::Device* device = nullptr;
};

struct Solution {
  std::vector<Rgb> radiosity;   // B [flux per area], one per patch
  std::vector<Rgb> irradiance;  // H = D_i + sum_j F_ij B_j (without E of emitters apart) + missed_i sky

  bool converged = true;
  // The one asked for, or Gauss-Seidel where conjugate residuals are no help: on rows far from reciprocal, or where light grows.
  SolverKind kind{};
  int channels = 3;  // that were solved: 1 where all patches are grey and all light has one colour
  size_t sweeps = 0;
  double residual = 0;          // max|E - B + rho H| over patches and channels [flux per area]
  double contraction = 0;       // spectral radius of rho F, estimated: what a Jacobi sweep leaves of the residual
  double bound = 0;             // largest reflectance times row sum: the contraction is not above it
  double error = 0;             // residual / (1 - contraction) over the mean radiosity of non-emitters
  std::string deviceFailure;    // why the device was left for the CPU; empty when it was not
  std::vector<double> history;  // the first residual, then each sweep's largest change, or residual (conjugate residuals)
};

// B and the residual are in double. Throws Error when the scene has no steady state: a closed part that
// receives light and absorbs none (naming a surface and channel), or a residual that grows. Not converging
// within maxSweeps is an answer, not an error.
Solution solveRadiosity(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Scene& scene,
                        const SolveOptions& options, const Log& log);

// Seconds of a Jacobi sweep here and on the device, and of bringing F there; from a few sweeps.
struct SweepSeconds {
  double host = 0, device = 0, upload = 0;
};
SweepSeconds measureSweeps(const FormFactorMatrix& f, const PatchSet& patches, const gpu::Device& device);

// Power in and out of the scene, per channel [flux]; for a converged solution of a reciprocal F,
// emitted + fromSky + fromPunctual = absorbed + toOpen + toBacks + inSolids + cut. Of punctual lights only what reaches surfaces
// counts.
struct EnergyBalance {
  Rgb emitted{0}, fromSky{0}, fromPunctual{0}, absorbed{0}, toOpen{0}, toBacks{0};
  Rgb inSolids{0}, cut{0};   // taken by clear solids on the way; not followed among mirrors and glass
  double relativeError = 0;  // worst channel, relative to the power that comes in
};
EnergyBalance energyBalance(const FormFactorMatrix& f, const PatchSet& patches, const Solution& solution, const Rgb& sky,
                            const std::vector<Rgb>& fromPunctual = {});  // irradiance per patch

// Direct light only, from punctual lights and the centre of each emitting patch as if it were a point, nothing in between and no
// interreflection: the local illumination that radiosity is compared with (Figure 2.1 of the thesis).
Solution localIllumination(const PatchSet& patches, std::span<const PunctualLight> lights, const Rgb& sky);

}  // namespace farol
