// The figures of one run, for the summary and for the JSON report.
#pragma once

#include "base/log.h"
#include "base/machine.h"
#include "cli/options.h"
#include "cli/tolerance.h"
#include "formfactor/comparison.h"
#include "formfactor/repair.h"
#include "gpu/gpu.h"

#include <optional>
#include <string>
#include <vector>

namespace farol {

struct ComparisonReport {
  std::string a, b;
  Comparison comparison;
  FormFactorChecks checksA, checksB;
  double irradianceChange = 0;
  double secondsA = 0, secondsB = 0;
  bool estimated = false;          // at least one side states errors
  std::vector<std::string> worst;  // surfaces: of the worst row, of what A sees most more and most less of
};

// The same system solved twice.
struct SolverComparison {
  std::string a, b;
  struct Side {
    std::string device;
    double seconds = 0;
    size_t sweeps = 0;
    double error = 0;  // of B that the residual bounds, of its mean
  };
  std::array<Side, 2> sides;
  double largest = 0, rms = 0;  // difference of B: of a patch's own B; of the mean
};

struct VariantReport {
  std::string name;
  size_t units = 0;  // unit solutions it was combined from; 0: solved
  size_t sweeps = 0;
  bool converged = true;
  double estimatedError = 0, energyError = 0, emitted = 0;  // of H and of the balance, relative; luminance of power in
};

// What the scene asked of the model.
struct ModelReport {
  bool colour = false, specular = false, factorsPerChannel = false;
  double withoutSpecular = 0;  // relative change of H that leaving mirrors and glass out would make, estimated
};

struct ToleranceReport {
  double asked = 0;
  bool met = false;
  TolerancePlan plan;
  ErrorParts estimated;
  double seconds = 0;  // choosing, form factors, light, solve and errors together
};

// What `solve` would take, predicted.
struct ForecastReport {
  double seconds = 0;      // whole process
  uint64_t peakBytes = 0;  // of its memory
  size_t tried = 0;        // patches of the trial that told
};

struct AdaptedReport {
  size_t tried = 0;      // patches of the trial
  uint32_t levels = 0;   // halvings between the largest patches and the smallest
  double predicted = 0;  // what constant patches change in H, over its mean
};

struct Report {
  Options options;
  MethodSpec method;  // the one chosen
  std::string why;
  std::string embree;
  std::optional<gpu::DeviceInfo> device;
  size_t surfaces = 0, triangles = 0, facets = 0, cells = 0, patches = 0, specularPatches = 0, emittingPatches = 0;
  double area = 0;  // of all patches [scene units squared]
  size_t degenerate = 0, duplicate = 0, welded = 0;
  uint64_t matrixBytes = 0;  // of F
  bool coloured = false;     // one F per channel, as coloured mirrors or glass ask
  ModelReport model;
  size_t denseRows = 0, packedRows = 0;  // in float32 and in 16 bits; the others are lists
  double packingError = 0;               // L1 error that 16 bits added to a row, at most
  std::string storageWhy;
  std::string solveOn, solveOnWhy;
  std::vector<VariantReport> variants;
  size_t devices = 1;        // software devices that shared the rows
  uint32_t batch = 0;        // hemicubes per submission
  uint64_t deviceBytes = 0;  // device memory for batches
  std::optional<Repair> repair;
  std::optional<FormFactorChecks> checks;
  ErrorModel errorModel;
  double rowErrorMean = 0, rowErrorMax = 0;  // estimated L1 errors of rows
  size_t lamps = 0, emitters = 0;            // apart, and in all
  std::string lampsWhy;
  size_t shadowRays = 0, sensors = 0;
  std::optional<double> estimatedError;  // of H, rms relative to its mean
  std::optional<ToleranceReport> tolerance;
  std::optional<AdaptedReport> adapted;
  std::optional<ForecastReport> forecast;
  std::optional<ComparisonReport> comparison;
  std::optional<SolverComparison> solverComparison;
  std::optional<Solution> solution;  // figures only: without the vectors
  std::optional<EnergyBalance> energy;
  std::optional<double> displayScale;
  std::vector<Warning> warnings;
  StageClock clock;
};

void writeReport(const std::string& path, const Report& report);
std::vector<std::string> cpuFeatures();

}  // namespace farol
