#include "cli/report.h"

#include "base/output_file.h"

#include <nlohmann/json.hpp>
#include <thread>

namespace farol {
namespace {

using nlohmann::json;

json channels(const Rgb& c) { return {c.r, c.g, c.b}; }

json optionsOf(const Options& o) {
  return {{"patches", o.patches},
          {"patch_size", o.patchSize},
          {"cluster", o.cluster},
          {"adapt", o.adapt},
          {"method", o.method},
          {"resolution", o.resolution},
          {"projection", projectionName(o.projection)},
          {"positions", o.positions},
          {"near_field", o.nearField},
          {"rays", raysOf(o)},
          {"emitters", o.emittersApart ? "apart" : "matrix"},
          {"shadow_rays", o.shadowRays},
          {"sensors", o.sensors},
          {"max_depth", o.maxDepth},
          {"min_weight", o.minWeight},
          {"max_images", o.maxImages},
          {"seed", o.seed},
          {"factors", o.factors},
          {"sky", channels(o.sky)},
          {"solver", solverName(o.solver)},
          {"solve_on", o.solveOn},
          {"variants", o.variants},
          {"residual", o.residual},
          {"max_sweeps", o.maxSweeps},
          {"illumination", o.localIllumination ? "local" : "global"},
          {"camera", o.camera},
          {"size", {o.width, o.height}},
          {"exposure", o.exposure},
          {"device", o.device},
          {"memory", o.memory},
          {"threads", o.threads}};
}

json sideOf(const std::string& name, const FormFactorChecks& c, double seconds) {
  return {{"method", name},
          {"seconds", seconds},
          {"row_sums", {{"min", c.rowSumMin}, {"mean", c.rowSumMean}, {"max", c.rowSumMax}}},
          {"missed", c.missed},
          {"backs", c.backs},
          {"reciprocity_error", c.reciprocityRms}};
}

json comparisonOf(const ComparisonReport& r) {
  const Comparison& c = r.comparison;
  json rows = json::array();
  for (const RowDifference& d : c.rows) rows.push_back({d.l1, d.largest, d.estimate});
  const RowDifference& worst = c.rows[c.worst];
  return {{"a", sideOf(r.a, r.checksA, r.secondsA)},
          {"b", sideOf(r.b, r.checksB, r.secondsB)},
          {"l1_mean", c.l1Mean},
          {"l1_rms", c.rms},
          {"l1_max", c.l1Max},
          {"entry_max", c.largest},
          {"within_estimate", c.withinEstimate},
          {"irradiance_rms", r.irradianceChange},
          {"worst_row",
           {{"patch", c.worst},
            {"surface", r.worst[0]},
            {"l1", worst.l1},
            {"estimate", worst.estimate},
            {"more_of", r.worst[1]},
            {"more_by", worst.moreBy},
            {"less_of", r.worst[2]},
            {"less_by", -worst.lessBy}}},
          {"rows_l1_max_estimate", rows}};
}

}  // namespace

std::vector<std::string> cpuFeatures() {
  std::vector<std::string> found;
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("sse4.2")) found.emplace_back("sse4.2");
  if (__builtin_cpu_supports("avx")) found.emplace_back("avx");
  if (__builtin_cpu_supports("avx2")) found.emplace_back("avx2");
  if (__builtin_cpu_supports("fma")) found.emplace_back("fma");
  if (__builtin_cpu_supports("avx512f")) found.emplace_back("avx512f");
#endif
  return found;
}

void writeReport(const std::string& path, const Report& r) {
  json j;
  j["program"] = {{"name", "farol"}, {"version", FAROL_VERSION}};
  j["command"] = commandName(r.options.command);
  j["scene"] = r.options.scene;
  j["options"] = optionsOf(r.options);
  j["equivalent_command"] = explicitCommand(r.options, r.method);
  j["cpu"] = {{"threads", std::thread::hardware_concurrency()}, {"features", cpuFeatures()}};
  if (r.device) {
    j["device"] = {{"name", r.device->name},
                   {"type", r.device->type},
                   {"driver", r.device->driver},
                   {"api", r.device->apiVersion},
                   {"memory_bytes", r.device->memoryBytes}};
    j["batch"] = {{"devices", r.devices}, {"hemicubes", r.batch}, {"device_bytes", r.deviceBytes}};
  }
  j["counts"] = {{"surfaces", r.surfaces},
                 {"triangles", r.triangles},
                 {"facets", r.facets},
                 {"cells", r.cells},
                 {"patches", r.patches},
                 {"specular", r.specularPatches},
                 {"emitting", r.emittingPatches},
                 {"degenerate_triangles", r.degenerate},
                 {"duplicate_triangles", r.duplicate},
                 {"welded_vertices", r.welded}};
  j["area"] = r.area;
  if (!r.embree.empty()) j["embree"] = r.embree;
  j["method"] = {{"form_factors", r.checks ? methodName(r.method.kind) : "none"}, {"why", r.why}};
  if (!r.lampsWhy.empty()) {
    j["light"] = {{"lamps_apart", r.lamps}, {"emitters", r.emitters}, {"why", r.lampsWhy}, {"shadow_rays", r.shadowRays}};
  }
  j["matrix_bytes"] = r.matrixBytes;
  j["model"] = {{"colour", r.model.colour},
                {"mirrors_and_glass", r.model.specular},
                {"factors_per_channel", r.model.factorsPerChannel},
                {"change_without_mirrors_and_glass", r.model.withoutSpecular}};
  j["three_form_factors"] = r.coloured;
  if (!r.storageWhy.empty()) {
    j["storage"] = {{"rows_float32", r.denseRows},
                    {"rows_16_bit", r.packedRows},
                    {"rows_as_lists", r.checks ? r.patches - r.denseRows - r.packedRows : 0},
                    {"row_l1_error_by_16_bit", r.packingError},
                    {"why", r.storageWhy}};
  }
  if (r.repair) {
    j["repair"] = {{"mean_l1_change", r.repair->meanChange},
                   {"largest_l1_change", r.repair->largestChange},
                   {"asymmetry_before", r.repair->asymmetry},
                   {"closure", r.repair->closure},
                   {"sweeps", r.repair->sweeps}};
  }
  if (r.checks) {
    const FormFactorChecks& c = *r.checks;
    j["row_sums"] = {{"min", c.rowSumMin}, {"mean", c.rowSumMean}, {"max", c.rowSumMax}};
    j["shares"] = {{"missed", c.missed},
                   {"cut", c.cut},
                   {"backs", c.backs},
                   {"absorbed_in_solids", c.absorbed},
                   {"met_specular_first", c.specular},
                   {"covered_area", c.covered}};
    j["reciprocity_error"] = c.reciprocityRms;
    j["pairs_checked_among"] = c.pairPatches;
    j["near_field_factors"] = {{"min", c.correctionMin}, {"max", c.correctionMax}};
    j["entries"] = {{"min", c.smallest}, {"max", c.largest}, {"largest_share_of_area_bound", c.worstArea}};
    j["row_error"] = {{"mean_l1", r.rowErrorMean},
                      {"max_l1", r.rowErrorMax},
                      {"samples", r.errorModel.samples},
                      {"entry_factor", r.errorModel.entry},
                      {"probe_rows", r.errorModel.probes}};
  }
  if (r.solution) {
    const Solution& s = *r.solution;
    j["solve"] = {{"on", r.solveOn},         {"why", r.solveOnWhy},          {"reflectance_times_row_sum", s.bound},
                  {"history", s.history},    {"sweeps", s.sweeps},           {"channels", s.channels},
                  {"residual", s.residual},  {"contraction", s.contraction}, {"error", s.error},
                  {"converged", s.converged}};
  }
  for (const VariantReport& v : r.variants) {
    j["variants"].push_back({{"name", v.name},
                             {"unit_solutions", v.units},
                             {"sweeps", v.sweeps},
                             {"converged", v.converged},
                             {"estimated_error", v.estimatedError},
                             {"power_in", v.emitted},
                             {"energy_error", v.energyError}});
  }
  if (r.energy) {
    const EnergyBalance& e = *r.energy;
    j["energy"] = {{"emitted", channels(e.emitted)},   {"from_sky", channels(e.fromSky)},
                   {"absorbed", channels(e.absorbed)}, {"to_open", channels(e.toOpen)},
                   {"to_backs", channels(e.toBacks)},  {"in_solids", channels(e.inSolids)},
                   {"cut", channels(e.cut)},           {"from_punctual_lights", channels(e.fromPunctual)},
                   {"relative_error", e.relativeError}};
  }
  j["estimated_error"] = r.estimatedError ? json(*r.estimatedError) : json(nullptr);
  if (r.adapted) j["adapted"] = {{"tried", r.adapted->tried}, {"levels", r.adapted->levels}, {"predicted", r.adapted->predicted}};
  if (r.forecast)
    j["forecast"] = {{"seconds", r.forecast->seconds}, {"peak_bytes", r.forecast->peakBytes}, {"tried", r.forecast->tried}};
  if (r.tolerance) {
    const ToleranceReport& t = *r.tolerance;
    const auto parts = [](const ErrorParts& e) {
      return json{{"patches", e.patches}, {"rows", e.rows}, {"light", e.light}, {"sweeps", e.sweeps}, {"total", e.total()}};
    };
    json choices = json::array();
    for (const Choice& c : t.plan.choices) choices.push_back({{"what", c.what}, {"value", c.value}, {"why", c.why}});
    j["tolerance"] = {{"asked", t.asked},
                      {"met", t.met},
                      {"predicted_error", parts(t.plan.predicted)},
                      {"estimated_error", parts(t.estimated)},
                      {"predicted_seconds", t.plan.seconds},
                      {"seconds", t.seconds},
                      {"choosing_seconds", t.plan.choosing},
                      {"limited_by", t.plan.limitedBy},
                      {"choices", choices}};
  }
  if (r.sensors > 0) j["sensors"] = r.sensors;
  if (r.solverComparison) {
    const SolverComparison& c = *r.solverComparison;
    json& to = j["solver_comparison"] = {{"largest", c.largest}, {"rms", c.rms}};
    for (const SolverComparison::Side& side : c.sides) {
      to["sides"].push_back({{"device", side.device}, {"seconds", side.seconds}, {"sweeps", side.sweeps}, {"error", side.error}});
    }
  }
  if (r.comparison) j["comparison"] = comparisonOf(*r.comparison);
  if (r.displayScale) j["display_scale"] = *r.displayScale;
  j["stages"] = json::array();
  uint64_t peak = peakMemoryBytes();
  for (const Stage& s : r.clock.stages()) {
    j["stages"].push_back({{"name", s.name}, {"seconds", s.seconds}, {"peak_bytes", s.peakBytes}});
    peak = std::max(peak, s.peakBytes);
  }
  j["total_seconds"] = r.clock.totalSeconds();
  j["peak_bytes"] = peak;
  j["warnings"] = json::array();
  for (const Warning& w : r.warnings) {
    j["warnings"].push_back({{"code", w.code},
                             {"sentence", w.sentence},
                             {"surfaces", w.surfaces},
                             {"effect", w.effect ? json(*w.effect) : json(nullptr)}});
  }
  OutputFile file(path);
  file.stream() << j.dump(2, ' ', false, json::error_handler_t::replace) << '\n';
  file.commit();
}

}  // namespace farol
