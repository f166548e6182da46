// `farol compare`: two ways to the same rows, a file of them included, and what the differences do to light.
#pragma once

#include "cli/choices.h"
#include "cli/lighting.h"
#include "cli/report.h"

namespace farol {

class CompareRun {
 public:
  // The references must outlive this. The first method settles which patches there are.
  CompareRun(const Situation& at, PatchSet& patches, const LightingMaker& lightings, const Log& log, StageClock& clock)
      : at_(at), options_(at.options), patches_(patches), lightings_(lightings), log_(log), clock_(clock) {}

  // options.methodA and methodB. Throws Error where a method cannot make the scene's rows or a file does not fit.
  ComparisonReport compare();
  const MethodSpec& spec() const { return spec_; }  // the first method that is no file; rays where both are

 private:
  // One side: a matrix with its name and error model.
  struct Side {
    std::string name;
    FormFactorMatrix f;
    ErrorModel error;
    double seconds = 0;
  };
  std::optional<MethodSpec> specOf(const std::string& text) const;  // none: a file
  FormFactorMatrix loadFile(const std::string& path) const;
  Side makeSide(const std::string& text, const std::optional<MethodSpec>& spec);
  double irradianceChange(const FormFactorMatrix& a, const FormFactorMatrix& b) const;

  const Situation& at_;
  const Options& options_;
  PatchSet& patches_;
  const LightingMaker& lightings_;
  const Log& log_;
  StageClock& clock_;
  MethodSpec spec_;
};

// Largest and rms difference of B.
void addDifference(const Solution& a, const Solution& b, const PatchSet& patches, SolverComparison& to);

}  // namespace farol
