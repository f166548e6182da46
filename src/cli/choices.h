// What `auto` means: the method, how F is stored, and where the solve runs, each with its reason.
#pragma once

#include "cli/methods.h"

namespace farol {

// What choices are made from. The references must outlive this.
struct Situation {
  const Options& options;
  const Scene& scene;
  const FacetSet& facets;
  const PatchSet& patches;
  Methods& methods;
};

struct MethodChoice {
  MethodSpec spec;
  std::string why;
};
MethodSpec specFrom(const Options& options, MethodSpec::Kind kind);
// Throws Error where closed forms are asked for and something may block.
MethodChoice chooseMethod(const Situation& at);

// Throws Error where the scene has mirrors or glass and the method does not follow them.
void requireFollowed(const Situation& at, MethodSpec::Kind kind);

// Rows of F that `spec` makes, measured on rows of front sides that are spread over the scene.
struct RowProbe {
  double rowsPerSecond = 0;
  double bytesPerRow = 0;  // of all channels, in float32
  size_t rows = 0;         // of F in all: the front sides, and the back sides that the probe met
};
RowProbe probeRows(const Situation& at, const MethodSpec& spec, double seconds = 0.1);

struct StorageChoice {
  Storage storage = Storage::float32;
  double bytes = 0;  // that F will take, predicted
  std::string why;
};
uint64_t allowedBytes(const Options& options);
// Throws Error where F fits in no form.
StorageChoice chooseStorage(const Situation& at, const MethodSpec& spec);

struct PlaceChoice {
  bool onDevice = false;
  std::string why;
};
PlaceChoice chooseSolvePlace(const Situation& at, const FormFactorMatrix& f);

}  // namespace farol
