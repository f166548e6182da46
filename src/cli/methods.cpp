#include "cli/methods.h"

#include "base/error.h"
#include "formfactor/images.h"
#include "formfactor/near_field.h"
#include "formfactor/raster.h"
#include "formfactor/rays.h"
#include "formfactor/team.h"

#include <charconv>
#include <future>
#include <thread>

namespace farol {
namespace {

// The whole of `text` as a number in [low, high].
uint32_t numberIn(const std::string& text, uint32_t low, uint32_t high, const std::string& method, const char* what) {
  uint32_t value = 0;
  const auto [stop, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc() || stop != text.data() + text.size() || value < low || value > high)
    throw UsageError("{}: {} '{}' is not a number from {} to {}", method, what, text, low, high);
  return value;
}

// A near-field correction and paths must live as long as the maker that uses them.
class CorrectedRaster : public RowMaker {
 public:
  CorrectedRaster(std::unique_ptr<NearField> nearField, std::unique_ptr<RayTree> tree, std::unique_ptr<ImageTrees> images,
                  std::unique_ptr<RowMaker> rows)
      : nearField_(std::move(nearField)), tree_(std::move(tree)), images_(std::move(images)), rows_(std::move(rows)) {}
  void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) override {
    rows_->makeRows(patches, store, done);
  }

 private:
  std::unique_ptr<NearField> nearField_;
  std::unique_ptr<RayTree> tree_;
  std::unique_ptr<ImageTrees> images_;
  std::unique_ptr<RowMaker> rows_;
};

}  // namespace

MethodSpec parseMethod(const std::string& text) {
  MethodSpec spec;
  std::vector<std::string> parts;
  for (size_t start = 0; start <= text.size();) {
    const size_t comma = std::min(text.find(',', start), text.size());
    parts.push_back(text.substr(start, comma - start));
    start = comma + 1;
  }
  const size_t colon = parts[0].find(':');
  const std::string kind = parts[0].substr(0, colon);
  std::string number = colon == std::string::npos ? "" : parts[0].substr(colon + 1);
  if (kind == "raster" || kind == "hybrid") {
    spec.kind = kind == "raster" ? MethodSpec::Kind::raster : MethodSpec::Kind::hybrid;
    if (const size_t at = number.find('@'); at != std::string::npos) {
      spec.device = number.substr(at + 1);
      number.resize(at);
    }
    if (!number.empty()) spec.resolution = numberIn(number, 8, 1024, text, "resolution");
    if (spec.resolution % 2 != 0) throw UsageError("{}: resolution {} is not even", text, spec.resolution);
  } else if (kind == "rays") {
    spec.kind = MethodSpec::Kind::rays;
    spec.rays = number.empty() ? 4096 : numberIn(number, 1, 1u << 22, text, "number of rays");
  } else if (kind == "exact" && colon == std::string::npos) {
    spec.kind = MethodSpec::Kind::exact;
  } else {
    throw UsageError(
        "'{}' is not a method: raster:R[@DEVICE][,tetrahedron][,positions=P][,near-field=on|off], hybrid:R..., rays:K, exact, or a "
        "file of factors (.npz, .npy); gpu and cpu compare the solve",
        text);
  }
  for (size_t k = 1; k < parts.size(); ++k) {
    const std::string& part = parts[k];
    const bool raster = spec.hemicubes();
    if (raster && (part == "tetrahedron" || part == "hemicube"))
      spec.projection = part == "tetrahedron" ? Projection::tetrahedron : Projection::hemicube;
    else if (raster && part.starts_with("positions="))
      spec.positions = static_cast<int>(numberIn(part.substr(10), 1, 4096, text, "number of positions"));
    else if (raster && (part == "near-field=on" || part == "near-field=off"))
      spec.nearField = part == "near-field=on";
    else
      throw UsageError("{}: '{}' is not known here", text, part);
  }
  return spec;
}

std::string methodText(const MethodSpec& spec) {
  if (spec.kind == MethodSpec::Kind::exact) return "exact";
  if (spec.kind == MethodSpec::Kind::rays) return fmt::format("rays:{}", spec.rays);
  std::string text = fmt::format("{}:{}{}{}", methodName(spec.kind), spec.resolution, spec.device.empty() ? "" : "@", spec.device);
  if (spec.projection == Projection::tetrahedron) text += ",tetrahedron";
  if (spec.positions > 1) text += fmt::format(",positions={}", spec.positions);
  if (spec.positions == 1 && !spec.nearField) text += ",near-field=off";
  return text;
}

double samplesOf(const MethodSpec& s) {
  if (s.kind == MethodSpec::Kind::rays) return s.rays;
  if (s.kind == MethodSpec::Kind::exact) return 1e12;
  return (s.projection == Projection::hemicube ? 3.0 : 1.5) * s.resolution * s.resolution * s.positions;
}

size_t coresFor(const Options& options) {
  return options.threads > 0 ? static_cast<size_t>(options.threads) : std::max<size_t>(1, std::thread::hardware_concurrency());
}

size_t mostSoftwareDevices(const Options& options) { return std::min<size_t>(coresFor(options), 8); }

const Tracer& Methods::tracer() {
  if (!tracer_) tracer_ = std::make_unique<Tracer>(facets_);
  return *tracer_;
}

const ExposedArea& Methods::exposedArea() {
  constexpr int kSamples = 64;
  if (!exposed_) exposed_ = findExposedArea(tracer(), facets_, patches_, kSamples, options_.seed);
  return *exposed_;
}

const gpu::Device& Methods::device(const std::string& name) {
  const std::string& wanted = name.empty() ? options_.device : name;
  for (const auto& opened : devices_) {
    if (opened->name == wanted) return *opened->team[0];
  }
  auto opened = std::make_unique<Opened>();
  opened->name = wanted;
  opened->team.push_back(std::make_unique<gpu::Device>(wanted));
  const gpu::DeviceInfo& info = opened->team[0]->info();
  log_.note(fmt::format("device: {} ({}, {})", info.name, info.type, info.driver));
  devices_.push_back(std::move(opened));
  return *devices_.back()->team[0];
}

size_t Methods::validationMessages() const {
  size_t messages = 0;
  for (const auto& opened : devices_) {
    for (const auto& device : opened->team) messages += device->validationMessages();
  }
  return messages;
}

std::unique_ptr<RowMaker> Methods::rasterMaker(const MethodSpec& spec) {
  const gpu::Device& first = device(spec.device);
  const std::string& wanted = spec.device.empty() ? options_.device : spec.device;
  auto& team = (*std::find_if(devices_.begin(), devices_.end(), [&](const auto& d) { return d->name == wanted; }))->team;
  RasterOptions o;
  o.resolution = spec.resolution;
  o.projection = spec.projection;
  o.positions = spec.positions;
  o.seed = spec.seed;
  o.exposed = &exposedArea();
  std::unique_ptr<RayTree> tree;
  if (spec.kind == MethodSpec::Kind::hybrid && patches_.anySpecular()) {
    tree = std::make_unique<RayTree>(tracer(), facets_, patches_, limits());
    o.tree = tree.get();
  }
  std::unique_ptr<ImageTrees> images;
  if (spec.kind == MethodSpec::Kind::raster && patches_.anySpecular()) {
    images = std::make_unique<ImageTrees>(scene_, facets_, patches_, limits(), options_.maxImages);
    o.images = images.get();
    o.deviceMemory *= 2;
  }
  std::unique_ptr<NearField> nearField;
  if (spec.nearField && spec.positions == 1) {
    // Errors far below what a pixel adds or takes are not looked for.
    nearField = std::make_unique<NearField>(tracer(), facets_, patches_, exposedArea(), spec.seed, 0.1 / samplesOf(spec));
    o.nearField = nearField.get();
  }
  // A software device shares the host's memory: nothing travels, and looking for empty bins takes twice the time of a row.
  o.lists = first.info().type != "CPU";
  // Setting up a device takes as long as some hundred hemicubes: small jobs do with fewer.
  constexpr size_t kWorthADevice = 1000;  // hemicubes
  const size_t worthwhile = patches_.frontPatchCount * static_cast<size_t>(spec.positions) / kWorthADevice;
  softwareDevices = first.info().type == "CPU" ? std::clamp<size_t>(worthwhile, 1, mostSoftwareDevices(options_)) : 1;
  o.deviceMemory /= softwareDevices;
  while (team.size() < softwareDevices) team.push_back(std::make_unique<gpu::Device>(std::to_string(first.info().index)));
  std::vector<std::future<std::unique_ptr<RasterRowMaker>>> starting;  // pipelines take their time
  for (size_t k = 0; k < softwareDevices; ++k)
    starting.push_back(
        std::async(std::launch::async, [&, k] { return std::make_unique<RasterRowMaker>(*team[k], facets_, patches_, o); }));
  std::vector<std::unique_ptr<RowMaker>> makers;
  for (auto& start : starting) {
    auto maker = start.get();
    batch = maker->batchSize();
    deviceBytes = softwareDevices * maker->deviceBytes();
    makers.push_back(std::move(maker));
  }
  // Chunks of several batches keep a device busy while the host stores rows, and are still small enough to share.
  constexpr size_t kBatchesPerChunk = 3;
  const size_t chunk = kBatchesPerChunk * batch / static_cast<size_t>(spec.positions);
  return std::make_unique<CorrectedRaster>(std::move(nearField), std::move(tree), std::move(images),
                                           std::make_unique<TeamRowMaker>(std::move(makers), chunk));
}

std::unique_ptr<RowMaker> Methods::maker(const MethodSpec& spec) {
  if (spec.hemicubes()) return rasterMaker(spec);
  if (spec.kind == MethodSpec::Kind::exact) return std::make_unique<ExactRowMaker>(facets_, patches_);
  RayOptions o;
  o.rays = spec.rays;
  o.seed = spec.seed;
  o.limits = limits();
  return std::make_unique<RayRowMaker>(tracer(), facets_, patches_, o);
}

}  // namespace farol
