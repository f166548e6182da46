// What a trial of some patches tells of more patches and other samples: error of H, seconds and bytes, by laws whose constants it
// has measured.
#pragma once

#include "cli/patch_size_error.h"
#include "cli/trials.h"

#include <cmath>

namespace farol {

// The parts of the error of H, relative to its mean; their squares add.
struct ErrorParts {
  double patches = 0, rows = 0, light = 0, sweeps = 0;
  double total() const { return std::sqrt(patches * patches + rows * rows + light * light + sweeps * sweeps); }
};

struct TrialLaws {
  Setting setting;     // of the trial
  size_t patches = 0;  // of the trial
  size_t sweeps = 8;
  double channels = 1;  // with an F of their own
  double fronts = 1;    // share of patches that are front sides
  double perSize = 2;   // power of the cell size that the number of patches falls with

  PatchSizeError patchError;
  double rowError = 0, lightError = 0;  // of H, relative

  double perSample = 0;     // of a row [s]
  double perShadowRay = 0;  // [s]
  double shadowShare = 0;   // shadow rays traced per patch and one asked for
  size_t images = 0;        // of lamps: from so many shadow rays on they take the place of following light; 0: never

  // From the seconds of the trial, when all above them is known.
  void learnCosts(const Trial& trial);

  // `n` patches, with samples and residual as `s` says.
  ErrorParts errorFor(double n, const Setting& s) const;
  double secondsFor(double n, const Setting& s) const;  // rows, direct light and solve
  double bytesFor(double n, const Setting& s) const;    // of F where light goes over no mirrors, rows packed in 16 bits

  // What direct light costs a patch, in shadow rays of the trial.
  double shadowWork(uint32_t rays) const;
};

}  // namespace farol
