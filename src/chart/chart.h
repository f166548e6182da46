// Error against time: points measured, the front of those that nothing beats, laws fitted through them; as CSV, JSON and
// picture.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace farol {

// One setting measured.
struct ChartPoint {
  std::string series;   // "rays", "raster, 9 positions", ...
  std::string method;   // as `farol compare` takes it
  std::string options;  // that repeat it with `farol solve`
  size_t patches = 0;
  double seconds = 0, cpuSeconds = 0;       // form factors, direct light and solve: median of `repeats`; of all cores
  double rowSeconds = 0, lightSeconds = 0;  // the two parts of `seconds`
  int repeats = 1;
  size_t sweeps = 0;
  double rowError = 0;         // mean over probe rows of sum_j |dF_ij|
  double error = 0;            // of H (HError)
  double noise = 0;            // errors below it cannot be told from none
  double samplesPerPatch = 0;  // of a row, over the patches that it sees
  bool onFront = false;        // no point is both faster and better
};

// error = constant x samplesPerPatch^-exponent, least squares over the logarithms.
struct ErrorLaw {
  std::string series;
  size_t points = 0;
  double constant = 0, exponent = 0;
};

struct Chart {
  std::string scene, machine;
  double timeAsked = 0, otherSeconds = 0;           // load, patches, ray tracing structure: on top of every point
  double referenceSeconds = 0, referenceError = 0;  // its own standard error (largest over patch sizes)
  size_t referencePaths = 0;
  bool complete = true;  // false: ended by its time limit or a signal
  std::vector<ChartPoint> points;
  std::vector<ErrorLaw> laws;
};

void markFront(std::vector<ChartPoint>& points);
// Series with three points or more; only points with at least a sample per patch.
std::vector<ErrorLaw> fitLaws(const std::vector<ChartPoint>& points);

// `path` ends in .svg, .png or .html; the data lie beside it as .csv and .json. Throws Error where gnuplot is missing or
// fails: the data are written first.
void writeChart(const std::string& path, const Chart& chart);
std::string besideChart(const std::string& path, const std::string& ending);

}  // namespace farol
