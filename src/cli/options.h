// The command line as plain data. Member initialisers are the defaults that --help prints.
#pragma once

#include "base/math.h"
#include "formfactor/projection.h"
#include "solve/solver.h"

#include <string>

namespace farol {

enum class Command { none, render, solve, factors, info, devices };

struct Options {
  Command command = Command::none;
  std::string scene, output;

  // patches
  size_t patches = 4000;
  double patchSize = 0;  // [scene units]; 0: from `patches`

  // form factors
  std::string method = "auto";
  uint32_t resolution = 64;
  Projection projection = Projection::hemicube;
  int positions = 1;
  uint64_t seed = 1;
  std::string by;  // factors: "surface" or "patch"; empty: from the file's ending

  // light and solution
  Rgb sky{0};
  SolverKind solver = SolverKind::gaussSeidel;
  double residual = 1e-5;
  size_t maxSweeps = 100000;
  bool localIllumination = false;

  // picture
  std::string camera;
  uint32_t width = 1280, height = 720;
  double exposure = 0;  // [stops]

  // machine
  std::string device;
  uint64_t memory = 0;  // [bytes] for form factors; 0: four fifths of what is free
  int threads = 0;      // 0: all

  // results beside the main one
  std::string patchesCsv, report;
  bool quiet = false;
};

// Throws UsageError with one sentence. `handled` is true when --help or --version has printed and nothing is left to
// do.
Options parseOptions(int argc, char** argv, bool& handled);

// A command line that states every option in force and repeats the run.
std::string explicitCommand(const Options& options);

const char* commandName(Command command);
const char* projectionName(Projection projection);
const char* solverName(SolverKind kind);

}  // namespace farol
