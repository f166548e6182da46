#include "cli/options.h"

#include "base/error.h"

#include <CLI/CLI.hpp>
#include <map>
#include <vector>

namespace farol {
namespace {

const std::map<std::string, Projection> kProjections = {{"hemicube", Projection::hemicube},
                                                        {"tetrahedron", Projection::tetrahedron}};
const std::map<std::string, SolverKind> kSolvers = {{"gauss-seidel", SolverKind::gaussSeidel},
                                                    {"jacobi", SolverKind::jacobi},
                                                    {"conjugate-residuals", SolverKind::conjugateResiduals}};

std::string endingOf(const std::string& path) {
  const size_t dot = path.rfind('.');
  return dot == std::string::npos || path.find('/', dot) != std::string::npos ? "" : path.substr(dot);
}

// Values that CLI11 has no type for, as text until they are checked.
struct RawOptions {
  std::string size = "1280x720", sky, projection = "hemicube", solver = "conjugate-residuals", illumination = "global";
  std::string nearField = "on", emitters = "apart";
};

// A number in [low, high] that is written out completely; throws a sentence otherwise.
template <typename T>
CLI::Validator inRange(T low, T high) {
  return CLI::Validator(
      [low, high](std::string& text) -> std::string {
        T value{};
        if (!CLI::detail::lexical_cast(text, value)) return fmt::format("{} is not a number from {} to {}", text, low, high);
        if (!(value >= low && value <= high)) return fmt::format("{} is outside the range from {} to {}", text, low, high);
        return "";
      },
      fmt::format("{}..{}", low, high));
}

void addScene(CLI::App* app, Options& o) { app->add_option("SCENE", o.scene, "glTF 2.0 scene (.gltf or .glb)")->required(); }

void addPatches(CLI::App* app, Options& o) {
  auto* count =
      app->add_option("--patches", o.patches, "About so many patches")->check(inRange<size_t>(1, 1u << 30))->group("Patches");
  app->add_option("--patch-size", o.patchSize, "Longest cell edge [scene units], instead of --patches")
      ->check(CLI::Validator(
          [](std::string& text) {
            double value = 0;
            return CLI::detail::lexical_cast(text, value) && value > 0 && std::isfinite(value) ? ""
                                                                                               : text + " is not a length above 0";
          },
          "LENGTH"))
      ->excludes(count)
      ->group("Patches");
  app->add_option(
         "--cluster", o.cluster,
         "Gather facets smaller than a patch into patches where they turn by no more than so many degrees; 0: a patch each")
      ->check(inRange<double>(0, 60))
      ->group("Patches");
}

void addPaths(CLI::App* app, Options& o) {
  app->add_option("--max-depth", o.maxDepth, "Mirrors and glass that a path may meet one after the other")
      ->check(inRange<uint32_t>(0, 1u << 20))
      ->group("Mirrors and glass");
  app->add_option("--min-weight", o.minWeight, "Paths that carry less are cut, in shares of a ray")
      ->check(inRange<double>(0, 1))
      ->group("Mirrors and glass");
  app->add_option("--max-images", o.maxImages, "Raster: mirrored images per hemicube")
      ->check(inRange<uint32_t>(0, 4096))
      ->group("Mirrors and glass");
}

void addSeedAndSky(CLI::App* app, Options& o, RawOptions& raw) {
  app->add_option("--seed", o.seed, "Of all random choices: turns of hemicubes, shifts of rays")
      ->check(inRange<uint64_t>(0, UINT64_MAX))
      ->group("Form factors");
  app->add_option("--sky", raw.sky, "Radiosity r,g,b of what lies outside the scene")->group("Light");
}

void addFormFactors(CLI::App* app, Options& o, RawOptions& raw) {
  app->add_option("--method", o.method,
                  "How rows of F are made: raster, rays, hybrid (raster, rays from mirrors and glass), or exact (closed forms)")
      ->check(CLI::IsMember({"auto", "raster", "rays", "hybrid", "exact"}))
      ->group("Form factors");
  app->add_option("--resolution", o.resolution, "Pixels along a hemicube's edge, even")
      ->check(inRange<uint32_t>(8, 1024))
      ->check(CLI::Validator([](std::string& text) { return std::stoul(text) % 2 == 0 ? "" : text + " is not even"; }, ""))
      ->group("Form factors");
  app->add_option("--projection", raw.projection, "hemicube or tetrahedron")
      ->check(CLI::IsMember({"hemicube", "tetrahedron"}))
      ->group("Form factors");
  app->add_option("--positions", o.positions, "Hemicubes per patch, spread over its area")
      ->check(inRange<int>(1, 4096))
      ->group("Form factors");
  app->add_option("--near-field", raw.nearField, "Correct near entries of raster rows of one position: on or off")
      ->check(CLI::IsMember({"on", "off"}))
      ->group("Form factors");
  app->add_option("--rays", o.rays, "Rays per patch; 0: 256, or 4096 for factors and compare and with --emitters matrix")
      ->check(inRange<uint32_t>(0, 1u << 22))
      ->group("Form factors");
  addPaths(app, o);
  addSeedAndSky(app, o, raw);
}

void addLight(CLI::App* app, Options& o, RawOptions& raw) {
  app->add_option("--emitters", raw.emitters, "apart: small bright lamps light directly, F carries the rest; or matrix")
      ->check(CLI::IsMember({"apart", "matrix"}))
      ->group("Light");
  app->add_option("--shadow-rays", o.shadowRays,
                  "Shadow rays per patch, shared by all lamps: four times as many in penumbras, a fourth where all is clear")
      ->check(inRange<uint32_t>(1, 1u << 20))
      ->group("Light");
}

void addSolve(CLI::App* app, Options& o, RawOptions& raw) {
  addLight(app, o, raw);
  app->add_option("--solver", raw.solver, "conjugate-residuals, gauss-seidel or jacobi")
      ->check(CLI::IsMember({"conjugate-residuals", "gauss-seidel", "jacobi"}))
      ->group("Solution");
  app->add_option("--solve-on", o.solveOn, "cpu, or gpu: Jacobi sweeps on the Vulkan device; auto measures")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->group("Solution");
  app->add_option("--residual", o.residual, "Stop at this error of B, relative to the mean of non-emitters")
      ->check(inRange<double>(1e-14, 1))
      ->group("Solution");
  app->add_option("--max-sweeps", o.maxSweeps, "Stop after so many sweeps (exit code 3)")
      ->check(inRange<size_t>(1, 1000000000))
      ->group("Solution");
  app->add_option("--illumination", raw.illumination, "global, or local: emitters as points, nothing in between")
      ->check(CLI::IsMember({"global", "local"}))
      ->group("Solution");
  app->add_option("--patches-csv", o.patchesCsv, "Write a line per patch")->group("Results");
  app->add_option("--variants", o.variants, "JSON list of lightings on one F: emission and diffuse by material name")
      ->group("Light");
  auto* sensors = app->add_option("--sensors", o.sensors,
                                  "Points to read irradiance at: lines x,y,z,nx,ny,nz or "
                                  "grid,x,y,z,ux,uy,uz,vx,vy,vz,nu,nv");
  sensors->group("Results");
  app->add_option("--sensors-out", o.sensorsOut, "Readings; default: the sensors' file with .out.csv")
      ->needs(sensors)
      ->group("Results");
}

void addMachine(CLI::App* app, Options& o) {
  app->add_option("--device", o.device, "Vulkan device by index or part of its name (farol devices lists them)")->group("Machine");
  app->add_option("--memory", o.memory, "Memory for form factors, such as 4G; 0: four fifths of what is free")
      ->transform(CLI::AsSizeValue(false))
      ->group("Machine");
  app->add_option("--threads", o.threads, "CPU threads; 0: all")->check(inRange<int>(0, 4096))->group("Machine");
  app->add_option("--report", o.report, "Write all figures of the run as JSON")->group("Results");
}

void addExposure(CLI::App* app, Options& o, const char* text) {
  app->add_option("--exposure", o.exposure, text)->check(inRange<double>(-64, 64))->group("Picture");
}

Rgb parseSky(const std::string& text) {
  if (text.empty()) return Rgb(0);
  const std::vector<std::string> parts = CLI::detail::split(text, ',');
  Rgb sky(0);
  for (size_t c = 0; c < parts.size() && c < 3; ++c) {
    if (!CLI::detail::lexical_cast(parts[c], sky[static_cast<int>(c)])) sky[static_cast<int>(c)] = -1;
  }
  if (parts.size() != 3 || !(minChannel(sky) >= 0) || !std::isfinite(maxChannel(sky))) {
    throw UsageError("--sky: {} is not three numbers r,g,b of 0 or more", text);
  }
  return sky;
}

void parseSize(const std::string& text, Options& o) {
  constexpr unsigned kMax = 32768;
  const std::vector<std::string> parts = CLI::detail::split(text, 'x');
  unsigned w = 0, h = 0;
  const bool good = parts.size() == 2 && CLI::detail::lexical_cast(parts[0], w) && CLI::detail::lexical_cast(parts[1], h);
  if (!good || w < 1 || h < 1 || w > kMax || h > kMax) {
    throw UsageError("--size: {} is not WIDTHxHEIGHT with 1 to {} pixels each", text, kMax);
  }
  o.width = w;
  o.height = h;
}

void checkEnding(const std::string& path, const std::vector<std::string>& allowed) {
  if (path.empty() || std::find(allowed.begin(), allowed.end(), endingOf(path)) != allowed.end()) return;
  std::string list;
  for (const std::string& a : allowed) list += (list.empty() ? "" : ", ") + a;
  throw UsageError("-o: {} does not end in {}", path, list);
}

// Number of single-letter changes between two words (Levenshtein 1966).
size_t distanceBetween(const std::string& a, const std::string& b) {
  std::vector<size_t> row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t keep = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({keep, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

// The sentence for arguments that no option took, with the nearest known option.
std::string unknownArgument(const CLI::App& app) {
  const CLI::App* active = app.get_subcommands().empty() ? &app : app.get_subcommands().front();
  const std::vector<std::string> left = app.remaining(true);
  const std::string found = left.empty() ? "" : left.front();
  std::vector<std::string> known;
  if (active == &app) {
    for (const CLI::App* command : app.get_subcommands({})) known.push_back(command->get_name());
  }
  for (const CLI::Option* option : active->get_options()) {
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  }
  const std::string stem = found.substr(0, found.find('='));
  std::string nearest;
  for (const std::string& name : known) {
    if (nearest.empty() || distanceBetween(stem, name) < distanceBetween(stem, nearest)) nearest = name;
  }
  const bool close = !nearest.empty() && distanceBetween(stem, nearest) <= std::max<size_t>(2, stem.size() / 2);
  return fmt::format("unknown argument {}{}", found,
                     close ? fmt::format("; did you mean {}?", nearest) : "; --help lists what is known");
}

// 1 % where render and solve are asked for nothing that decides accuracy.
void chooseTolerance(Options& o) {
  constexpr double kUsual = 0.01;
  const bool kept = !o.factors.empty() || !o.variants.empty() || o.localIllumination;
  if (o.gave("--adapt") && kept)
    throw UsageError("--adapt chooses patches before F is made: it does not go with --factors, --variants or --illumination local");
  if (o.gave("--cluster") && o.gave("--adapt"))
    throw UsageError("--cluster makes patches of several facets: it does not go with --adapt, which makes several of one");
  if (o.gave("--adapt") && o.gave("--tolerance"))
    throw UsageError("--adapt and --tolerance both choose patches: one of them is enough");
  if (o.gave("--tolerance")) {
    if (kept)
      throw UsageError("--tolerance chooses how F is made: it does not go with --factors, --variants or --illumination local");
    return;
  }
  if (kept || (o.command != Command::render && o.command != Command::solve && o.command != Command::info)) return;
  for (const char* own : {"--patches", "--patch-size", "--cluster", "--adapt", "--method", "--resolution", "--projection",
                          "--positions", "--rays", "--near-field", "--emitters", "--shadow-rays"}) {
    if (o.gave(own)) return;
  }
  o.tolerance = kUsual;
}

}  // namespace

const char* commandName(Command command) {
  constexpr const char* names[] = {"", "render", "solve", "factors", "compare", "chart", "info", "devices"};
  return names[static_cast<size_t>(command)];
}

const char* methodName(MethodSpec::Kind kind) {
  constexpr const char* names[] = {"raster", "rays", "exact", "hybrid"};
  return names[static_cast<size_t>(kind)];
}

uint32_t raysOf(const Options& o) {
  if (o.rays > 0) return o.rays;
  const bool forItsOwnSake = o.command == Command::factors || o.command == Command::compare;
  return forItsOwnSake || !o.emittersApart ? 4096 : 256;
}

const char* projectionName(Projection projection) { return projection == Projection::hemicube ? "hemicube" : "tetrahedron"; }
const char* solverName(SolverKind kind) {
  for (const auto& [name, k] : kSolvers) {
    if (k == kind) return name.c_str();
  }
  return "";
}

Options parseOptions(int argc, char** argv, bool& handled) {
  Options o;
  RawOptions raw;
  CLI::App app("Radiosity: diffuse interreflection by form factors, on Vulkan devices.", "farol");
  app.option_defaults()->always_capture_default();
  app.set_version_flag("--version", std::string("farol " FAROL_VERSION));
  app.require_subcommand(0, 1);
  app.footer(
      "Exit codes: 0 done; 1 failed (scene, device, memory, file); 2 wrong usage; 3 not converged, results written all "
      "the same; 130 and 143 after SIGINT and SIGTERM.");

  std::map<CLI::App*, Command> commands;
  const auto command = [&](const char* name, const char* text, Command kind) {
    CLI::App* sub = app.add_subcommand(name, text);
    commands[sub] = kind;
    sub->add_flag("--quiet", o.quiet, "Print warnings and errors only")->group("Results");
    return sub;
  };
  CLI::App* render = command("render", "Solve, then draw the camera's view", Command::render);
  CLI::App* solve = command("solve", "Solve; write the lit scene for any glTF viewer", Command::solve);
  CLI::App* factors = command("factors", "Form factors only", Command::factors);
  CLI::App* compare = command("compare", "Two methods row by row, or a method and a file of factors", Command::compare);
  CLI::App* chart = command("chart", "Error against time over methods and settings, with their data beside it", Command::chart);
  CLI::App* info =
      command("info", "What is in the scene, what would be done, memory and time forecast; writes nothing", Command::info);
  command("devices", "Vulkan devices and CPU features", Command::devices);
  for (CLI::App* sub : {render, solve, factors, compare, info}) {
    addScene(sub, o);
    addPatches(sub, o);
    addFormFactors(sub, o, raw);
    addMachine(sub, o);
  }
  for (CLI::App* sub : {render, solve}) {
    sub->add_option("--adapt", o.adapt,
                    "Patches as small as their light asks for, --patch-size at most: constant patches may cost so much of the mean "
                    "irradiance")
        ->check(inRange<double>(1e-4, 1))
        ->excludes(sub->get_option("--patches"))
        ->group("Patches");
  }
  for (CLI::App* sub : {render, solve, factors, info}) {
    sub->add_option(
           "--tolerance", o.tolerance,
           "Error of irradiance, relative to its mean, that patches, method and samples are chosen for; what is given is kept. "
           "Without options of these, render and solve take 0.01")
        ->check(inRange<double>(1e-5, 1))
        ->group("Accuracy");
    sub->add_option("--time", o.time, "Seconds that a tolerance may take; 0: any")
        ->check(inRange<double>(0, 1e9))
        ->group("Accuracy");
  }
  addScene(chart, o);
  addPatches(chart, o);
  addPaths(chart, o);
  addSeedAndSky(chart, o, raw);
  addMachine(chart, o);
  chart->add_option("-o,--output", o.output, "Chart: .svg, .png or .html; .csv, .json and .reference.csv lie beside it")
      ->required()
      ->group("Results");
  chart->add_option("--time", o.time, "Seconds that all may take together; default: 60")
      ->check(inRange<double>(1, 1e6))
      ->group("Machine");
  for (CLI::App* sub : {render, solve, factors}) {
    sub->add_flag("--repair", o.repair, "Balance rows of F: A_i F_ij = A_j F_ji, every row's sum kept; the change is told")
        ->group("Form factors");
  }
  for (CLI::App* sub : {render, solve}) {
    CLI::Option* kept =
        sub->add_option("--factors", o.factors, "F kept by `farol factors -o F.npz`, with its patches")->group("Form factors");
    for (const char* own : {"--method", "--resolution", "--projection", "--positions", "--near-field", "--rays"})
      kept->excludes(sub->get_option(own));
  }
  render->add_option("-o,--output", o.output, "Picture: .png (sRGB) or .exr (linear radiance)")->required()->group("Results");
  solve->add_option("-o,--output", o.output, "Lit scene: .glb")->group("Results");
  factors->add_option("-o,--output", o.output, "Form factors: .csv, .npz (can be solved again), .npy or .mtx")->group("Results");
  factors->add_option("--by", o.by, "surface or patch; default: surface for .csv, patch otherwise")
      ->check(CLI::IsMember({"surface", "patch"}))
      ->group("Results");
  const char* methodHelp =
      "raster:R[@DEVICE][,tetrahedron][,positions=P][,near-field=off], hybrid:R[...], rays:K, exact, F.npz, F.npy; or gpu and cpu";
  compare->add_option("A", o.methodA, methodHelp)->required();
  compare->add_option("B", o.methodB, methodHelp)->required();
  compare->add_option("-o,--output", o.output, "Picture of where they differ: .png")->group("Results");
  compare->add_option("--camera", o.camera, "Camera by name; default: the first")->group("Picture");
  compare->add_option("--size", raw.size, "WIDTHxHEIGHT in pixels")->group("Picture");
  addLight(compare, o, raw);
  addLight(info, o, raw);
  addSolve(render, o, raw);
  addSolve(solve, o, raw);
  render->add_option("--camera", o.camera, "Camera by name; default: the first")->group("Picture");
  render->add_option("--size", raw.size, "WIDTHxHEIGHT in pixels")->group("Picture");
  addExposure(render, o, "Stops added to the picture's own exposure (.png) or to radiance (.exr)");
  addExposure(solve, o, "Stops added to COLOR_0; above 0 the brightest is cut");

  handled = false;
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& e) {  // --help, --version
    app.exit(e);
    handled = true;
    return o;
  } catch (const CLI::ExtrasError&) {
    throw UsageError("{}", unknownArgument(app));
  } catch (const CLI::ParseError& e) {
    throw UsageError("{}", std::string(e.what()));
  }
  if (app.get_subcommands().empty()) {
    fmt::print("{}", app.help());
    handled = true;
    return o;
  }
  CLI::App* chosen = app.get_subcommands().front();
  o.command = commands.at(chosen);
  for (const CLI::Option* option : chosen->get_options()) {
    if (option->count() == 0) continue;
    for (const std::string& name : option->get_lnames()) o.given.insert("--" + name);
  }
  o.projection = kProjections.at(raw.projection);
  o.solver = kSolvers.at(raw.solver);
  if (o.solveOn == "gpu" && o.gave("--solver") && o.solver != SolverKind::jacobi)
    throw UsageError("--solve-on gpu: sweeps on a device are Jacobi's; leave --solver {} out", raw.solver);
  o.localIllumination = raw.illumination == "local";
  chooseTolerance(o);
  o.sky = parseSky(raw.sky);
  o.nearField = raw.nearField == "on";
  o.emittersApart = raw.emitters == "apart";
  if (!o.variants.empty() && o.localIllumination) throw UsageError("--variants are for --illumination global");
  if (!o.sensors.empty() && o.sensorsOut.empty()) {
    const std::string ending = endingOf(o.sensors);
    o.sensorsOut = o.sensors.substr(0, o.sensors.size() - ending.size()) + ".out.csv";
  }
  parseSize(raw.size, o);
  if (o.command == Command::render) checkEnding(o.output, {".png", ".exr"});
  if (o.command == Command::compare) checkEnding(o.output, {".png"});
  if (o.command == Command::solve) checkEnding(o.output, {".glb"});
  if (o.command == Command::chart) {
    checkEnding(o.output, {".svg", ".png", ".html"});
    if (o.time == 0) o.time = 60;
  }
  if (o.command == Command::factors) {
    checkEnding(o.output, {".csv", ".npz", ".npy", ".mtx"});
    const bool table = o.output.empty() || endingOf(o.output) == ".csv";
    if (o.by.empty()) o.by = table ? "surface" : "patch";
    if ((o.by == "surface") != table)
      throw UsageError("--by {} cannot be written to {}: .csv is by surface, .npz, .npy and .mtx are by patch", o.by, o.output);
  }
  return o;
}

double rounded(double value, int digits) { return std::stod(fmt::format("{:.{}g}", value, digits)); }

std::string explicitCommand(const Options& o, const MethodSpec& method) {
  std::string text = fmt::format("farol {} {}", commandName(o.command), o.scene);
  if (o.command == Command::compare) text += fmt::format(" {} {}", o.methodA, o.methodB);
  const auto add = [&text](const char* name, const auto& value) { text += fmt::format(" {} {}", name, value); };
  if (!o.output.empty()) add("-o", o.output);
  if (o.patchSize > 0)
    add("--patch-size", o.patchSize);
  else
    add("--patches", o.patches);
  if (o.cluster > 0) add("--cluster", o.cluster);
  if (o.adapt > 0) add("--adapt", o.adapt);
  if (!o.factors.empty())
    add("--factors", o.factors);
  else if (o.command != Command::compare)
    add("--method", methodName(method.kind));
  if (!o.factors.empty()) {
    // the file says how F was made
  } else if (method.hemicubes()) {
    add("--resolution", method.resolution);
    add("--projection", projectionName(method.projection));
    add("--positions", method.positions);
    add("--near-field", method.nearField ? "on" : "off");
  } else if (method.kind == MethodSpec::Kind::rays) {
    add("--rays", method.rays);
  }
  if (o.factors.empty()) {
    add("--max-depth", o.maxDepth);
    add("--min-weight", o.minWeight);
    add("--max-images", o.maxImages);
    if (o.memory > 0) add("--memory", o.memory);  // decides how rows are stored
  }
  add("--seed", o.seed);
  if (o.repair) text += " --repair";
  if (o.command == Command::factors) add("--by", o.by);
  if (maxChannel(o.sky) > 0) add("--sky", fmt::format("{},{},{}", o.sky.r, o.sky.g, o.sky.b));
  if (o.command != Command::factors) {
    add("--emitters", o.emittersApart ? "apart" : "matrix");
    add("--shadow-rays", o.shadowRays);
  }
  if (o.command == Command::render || o.command == Command::solve) {
    if (o.solveOn != "gpu") add("--solver", solverName(o.solver));
    add("--solve-on", o.solveOn);
    if (!o.variants.empty()) add("--variants", o.variants);
    add("--residual", o.residual);
    add("--max-sweeps", o.maxSweeps);
    add("--illumination", o.localIllumination ? "local" : "global");
    add("--exposure", o.exposure);
  }
  if (o.command == Command::render) {
    if (!o.camera.empty()) add("--camera", o.camera);
    add("--size", fmt::format("{}x{}", o.width, o.height));
  }
  if (!o.device.empty()) add("--device", o.device);
  if (!o.patchesCsv.empty()) add("--patches-csv", o.patchesCsv);
  if (!o.sensors.empty()) {
    add("--sensors", o.sensors);
    add("--sensors-out", o.sensorsOut);
  }
  return text;
}

}  // namespace farol
