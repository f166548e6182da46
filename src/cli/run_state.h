// What one run of render, solve, factors, compare or info has at hand: each stage reads what stages before it left
// here, and leaves its own result.
#pragma once

#include "cli/choices.h"
#include "cli/lighting.h"
#include "cli/report.h"
#include "cli/variants.h"
#include "output/factor_archive.h"
#include "output/sensor_files.h"

#include <optional>
#include <vector>

namespace farol {

struct RunState {
  explicit RunState(const Options& options);
  RunState(const RunState&) = delete;  // members refer to each other
  RunState& operator=(const RunState&) = delete;

  bool lit() const;     // something emits light
  void countPatches();  // into the report, after every change of them

  // A line of the summary.
  template <typename... Args>
  void say(fmt::format_string<Args...> format, Args&&... args) const {
    if (!options.quiet) fmt::print("{}\n", fmt::format(format, std::forward<Args>(args)...));
  }

  Options options;
  Log log;
  Report report;
  Scene scene;
  Camera camera;
  FacetSet facets;
  PatchSet patches;
  Methods methods;
  Situation situation;
  LightingMaker lightings;
  std::vector<Variant> variants;
  std::optional<FactorArchive> kept;         // --factors
  std::optional<MethodSpec> spec;            // the method chosen
  const gpu::Device* solveDevice = nullptr;  // null: the CPU
  std::optional<FormFactorMatrix> f;
  Replicates replicates;
  ErrorModel model;
  std::optional<TolerancePlan> plan;
  Lighting lighting;
  std::vector<Sensor> sensors;
};

void openKept(RunState& run);  // before the scene: the file says which patches its factors are for
void load(RunState& run);
void cut(RunState& run);
void chooseMethod(RunState& run);
void chooseSolvePlace(RunState& run);

}  // namespace farol
