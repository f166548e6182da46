#include "cli/results.h"

#include "base/error.h"
#include "cli/comparison_text.h"
#include "output/output.h"
#include "output/sensor_files.h"
#include "view/tone.h"
#include "view/view.h"

#include <algorithm>

namespace farol {
namespace {

NodeIrradiance nodes(RunState& run) {
  return NodeIrradiance(run.scene, run.facets, run.patches, run.f ? &*run.f : nullptr, run.lighting.solution.irradiance);
}

void writePatches(RunState& run) {
  if (run.options.patchesCsv.empty()) return;
  writePatchesCsv(run.options.patchesCsv, run.scene, run.patches, run.f ? &*run.f : nullptr, run.lighting.solution,
                  run.lighting.error);
  run.say("patches: {}", run.options.patchesCsv);
}

void draw(RunState& run) {
  const gpu::Device& device = run.methods.device();
  run.report.device = device.info();
  run.report.clock.finish("device");
  const NodeIrradiance irradiance = nodes(run);
  ViewOptions o;
  o.width = run.options.width;
  o.height = run.options.height;
  o.sky = run.options.sky;
  std::optional<RayTree> tree;
  if (run.patches.anySpecular()) {
    tree.emplace(run.methods.tracer(), run.facets, run.patches, run.methods.limits());
    o.tree = &*tree;
    o.patches = &run.patches;
  }
  const Image image = renderView(device, run.scene, run.facets, irradiance, run.camera, o, run.log);
  run.report.clock.finish("view");
  const double stops = std::exp2(run.options.exposure);
  if (run.options.output.ends_with(".exr")) {
    run.report.displayScale = stops;
    writeExr(run.options.output, image, stops);
  } else {
    run.report.displayScale = stops * automaticScale(image);
    writePng(run.options.output, image.width, image.height, toSrgb(image, *run.report.displayScale));
  }
  writePatches(run);
  run.report.clock.finish("write");
  run.say("picture: {} ({} x {}, camera '{}', radiance x {:.4g})", run.options.output, image.width, image.height, run.camera.name,
          *run.report.displayScale);
}

void writeSolved(RunState& run) {
  if (!run.options.output.empty()) {
    writeLitGlb(run.options.output, run.scene, run.facets, run.patches, nodes(run), run.options.exposure);
    run.say("lit scene: {}", run.options.output);
  }
  writePatches(run);
  run.report.clock.finish("write");
}

void readSensorsHere(RunState& run) {
  if (run.sensors.empty()) return;
  if (!run.f) throw Error("{}: sensors need a global solution of a scene with light", run.options.scene);
  SensorOptions o;
  o.seed = run.options.seed;
  o.sky = run.options.sky;
  const RayTree tree(run.methods.tracer(), run.facets, run.patches, run.methods.limits());
  const Shining shining = run.lightings.shining(run.lighting.plan, run.scene, run.patches, false);
  if (shining.follow) {
    run.log.warn({"sensors-and-punctual-lights",
                  "what mirrors and glass pass on of point, spot and directional lights does not reach sensors, only patches: they "
                  "have no area that a sensor's rays could meet"});
  }
  const DirectIrradiance lamps(run.methods.tracer(), run.facets, run.patches, shining.lamps, shining.lights,
                               {run.options.shadowRays, run.options.seed, shining.mirrors ? &*shining.mirrors : nullptr});
  const auto readings = readSensors(tree, run.methods.tracer(), run.facets, run.patches, lamps, run.lighting.direct,
                                    run.lighting.solution, run.sensors, o);
  writeSensorReadings(run.options.sensorsOut, run.sensors, readings);
  double low = 1e300, high = 0, mean = 0;
  for (const SensorReading& r : readings) {
    low = std::min(low, luminance(r.irradiance));
    high = std::max(high, luminance(r.irradiance));
    mean += luminance(r.irradiance) / static_cast<double>(readings.size());
  }
  run.report.sensors = readings.size();
  run.report.clock.finish("sensors");
  run.say("sensors: {} readings in {}: {:.4g} to {:.4g}, mean {:.4g} (luminance)", readings.size(), run.options.sensorsOut, low,
          high, mean);
}

}  // namespace

void writeResults(RunState& run) {
  readSensorsHere(run);
  if (run.options.command == Command::render)
    draw(run);
  else
    writeSolved(run);
}

void writeFactors(RunState& run) {
  if (!run.options.output.empty()) {
    if (run.options.by == "surface")
      writeFactorsBySurface(run.options.output, run.scene, run.patches, *run.f);
    else if (run.options.output.ends_with(".npz"))
      writeFactorsNpz(run.options.output, *run.f, run.patches,
                      {methodText(*run.spec), run.spec->seed, patchOptionsOf(run.options), fingerprintOf(run.facets, run.patches)},
                      run.replicates.patches, run.replicates.rows ? &*run.replicates.rows : nullptr);
    else if (run.options.output.ends_with(".npy"))
      writeFactorsNpy(run.options.output, *run.f);
    else
      writeFactorsMtx(run.options.output, *run.f);
    run.say("factors: {}", run.options.output);
  }
  run.report.clock.finish("write");
}

void drawDifference(RunState& run, const Comparison& c) {
  const std::vector<Rgb> colors = differenceColors(c);
  run.lighting.solution.irradiance.assign(run.patches.size(), Rgb(0));
  ViewOptions o;
  o.width = run.options.width;
  o.height = run.options.height;
  o.patches = &run.patches;
  o.colors = &colors;
  const Image image = renderView(run.methods.device(), run.scene, run.facets, nodes(run), run.camera, o, run.log);
  writePng(run.options.output, image.width, image.height, toSrgb(image, 1.0));
  run.report.clock.finish("view");
  run.say("picture: {} (yellow: L1 {:.3g}; dark blue: 0)", run.options.output, c.l1Max);
}

}  // namespace farol
