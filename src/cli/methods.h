// The ways to make rows of F that a user can ask for, and what they need: Embree, Vulkan devices, or both.
#pragma once

#include "cli/options.h"
#include "formfactor/form_factors.h"
#include "gpu/gpu.h"
#include "trace/cover.h"
#include "trace/ray_tree.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace farol {

// Parses what `compare` takes: raster:R[@DEVICE][,tetrahedron][,positions=P][,near-field=on|off] or rays:K. Throws
// UsageError.
MethodSpec parseMethod(const std::string& text);
std::string methodText(const MethodSpec& spec);  // the same, complete
double samplesOf(const MethodSpec& spec);        // of the hemisphere per row, for laws of error

// Makes row makers for one set of patches; opens what they need when it is first needed, and keeps it.
class Methods {
 public:
  // The references must outlive this.
  Methods(const Options& options, const Scene& scene, const FacetSet& facets, const PatchSet& patches, Log& log)
      : options_(options), scene_(scene), facets_(facets), patches_(patches), log_(log) {}

  std::unique_ptr<RowMaker> maker(const MethodSpec& spec);

  const Tracer& tracer();
  TreeLimits limits() const { return {options_.maxDepth, options_.minWeight}; }
  const gpu::Device& device(const std::string& name = "");
  const ExposedArea& exposedArea();

  void patchesChanged() { exposed_.reset(); }  // the set is another one now

  bool deviceOpen() const { return !devices_.empty(); }
  bool tracerOpen() const { return tracer_ != nullptr; }
  size_t validationMessages() const;

  // Of the raster maker made last.
  size_t softwareDevices = 1;
  uint32_t batch = 0;        // hemicubes per submission
  uint64_t deviceBytes = 0;  // for batches

 private:
  std::unique_ptr<RowMaker> rasterMaker(const MethodSpec& spec);

  const Options& options_;
  const Scene& scene_;
  const FacetSet& facets_;
  const PatchSet& patches_;
  Log& log_;
  std::unique_ptr<Tracer> tracer_;
  std::optional<ExposedArea> exposed_;
  struct Opened {
    std::string name;
    std::vector<std::unique_ptr<gpu::Device>> team;  // the device, and the same software device again
  };
  std::vector<std::unique_ptr<Opened>> devices_;
};

size_t coresFor(const Options& options);
size_t mostSoftwareDevices(const Options& options);

}  // namespace farol
