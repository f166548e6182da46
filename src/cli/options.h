// The command line as plain data. Member initialisers are the defaults that --help prints.
#pragma once

#include "base/math.h"
#include "formfactor/projection.h"
#include "solve/solver.h"

#include <set>
#include <string>

namespace farol {

enum class Command { none, render, solve, factors, compare, chart, info, devices };

// One way to make rows of F, with its settings.
struct MethodSpec {
  enum class Kind { raster, rays, exact, hybrid };
  Kind kind = Kind::rays;
  bool hemicubes() const { return kind == Kind::raster || kind == Kind::hybrid; }
  uint32_t resolution = 64;
  Projection projection = Projection::hemicube;
  int positions = 1;
  bool nearField = true;
  std::string device;  // raster: as --device
  uint32_t rays = 256;
  uint64_t seed = 1;
};

struct Options {
  Command command = Command::none;
  std::string scene, output;
  std::set<std::string> given;  // names of the options that stand on the command line
  bool gave(const std::string& name) const { return given.contains(name); }

  double tolerance = 0;  // error of H (relative to its mean, rms over area) to be met; 0: the options as they are

  // patches
  size_t patches = 4000;
  double patchSize = 0;  // [scene units]; 0: from `patches`
  double cluster = 0;    // facets smaller than a patch are gathered up to this turn [degrees]; 0: not
  double adapt = 0;      // error of H that constant patches may cost; 0: patches of one size

  // form factors
  std::string method = "auto";
  uint32_t resolution = 64;
  Projection projection = Projection::hemicube;
  int positions = 1;
  uint32_t rays = 0;  // 0: 256, or 4096 for factors, compare and with emitters in F
  bool nearField = true;
  uint32_t maxDepth = 512;   // mirrors and glass met one after the other
  double minWeight = 1e-4;   // of a path; what carries less is cut
  uint32_t maxImages = 256;  // raster: mirrored images per hemicube
  uint64_t seed = 1;
  bool repair = false;  // rows balanced to reciprocity and their own sums
  std::string factors;  // F kept in a file, instead of making it
  std::string by;       // factors: "surface" or "patch"; empty: from the file's ending

  // compare
  std::string methodA, methodB;

  // light and solution
  Rgb sky{0};
  bool emittersApart = true;
  uint32_t shadowRays = 64;
  SolverKind solver = SolverKind::conjugateResiduals;
  std::string solveOn = "auto";
  double residual = 1e-5;
  size_t maxSweeps = 100000;
  bool localIllumination = false;
  std::string variants;  // a file of lightings; empty: the scene's own

  // picture
  std::string camera;
  uint32_t width = 1280, height = 720;
  double exposure = 0;  // [stops]

  // machine
  std::string device;
  double time = 0;      // [s] for form factors, light and solve, or for a chart; 0: no limit
  uint64_t memory = 0;  // [bytes] for form factors; 0: four fifths of what is free
  int threads = 0;      // 0: all

  // results beside the main one
  std::string patchesCsv, report;
  std::string sensors, sensorsOut;  // empty output: the input's name with .out.csv
  bool quiet = false;
};

inline PatchOptions patchOptionsOf(const Options& o) {
  PatchOptions p{o.patches, o.patchSize};
  p.cluster = o.cluster;
  return p;
}

// Throws UsageError with one sentence. `handled` is true when --help or --version has printed and nothing is left to
// do.
Options parseOptions(int argc, char** argv, bool& handled);

// As options are told and chosen: few digits are enough, and read better.
double rounded(double value, int digits = 3);

// A command line that states every option in force and repeats the run with the method that was chosen.
std::string explicitCommand(const Options& options, const MethodSpec& method);

const char* commandName(Command command);
const char* methodName(MethodSpec::Kind kind);
uint32_t raysOf(const Options& options);
const char* projectionName(Projection projection);
const char* solverName(SolverKind kind);

}  // namespace farol
