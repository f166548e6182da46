// Form factors of a test scene by any method.
#pragma once

#include "formfactor/error_model.h"
#include "formfactor/near_field.h"
#include "formfactor/rays.h"
#include "test_scene.h"

#include <memory>

namespace farol::test {

struct FactorRun {
  FactorRun(Scene scene, const PatchOptions& patchOptions);
  virtual ~FactorRun() = default;

  // Area-weighted mean factor from one surface to another. Makes the rows it needs.
  double factor(const std::string& from, const std::string& to);
  void makeRowsOf(const std::string& surface);
  std::vector<uint32_t> patchesOf(const std::string& surface) const;
  void makeAll();
  virtual std::unique_ptr<RowMaker> maker() = 0;

  // Standard error of factor(from, to). Errors of rows are independent, or, where all rows stand for points, of one sign.
  double factorError(const ErrorModel& model, const std::string& from, const std::string& to, bool oneSign = false) const;
  // An even choice of the rows made so far.
  std::vector<uint32_t> probePatches(size_t count) const;

  Scene scene;
  FacetSet facets;
  PatchSet patches;
  FormFactorMatrix f;
};

struct RayRun : FactorRun {
  RayRun(Scene scene, const PatchOptions& patchOptions, const RayOptions& rayOptions);
  std::unique_ptr<RowMaker> maker() override;

  // From at most 24 rows against 16 times as many rays.
  ErrorModel errorModel();
  ProbeRows probes();

  RayOptions options;
  Tracer tracer;
};

struct ExactRun : FactorRun {
  using FactorRun::FactorRun;
  std::unique_ptr<RowMaker> maker() override { return std::make_unique<ExactRowMaker>(facets, patches); }
};

}  // namespace farol::test
