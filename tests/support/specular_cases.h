// Cases with mirrors and glass whose extended factors are known (tests/analytic/specular.json).
#pragma once

#include "factor_run.h"
#include "solve/solver.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace farol::test {

inline const nlohmann::json& caseOf(const std::string& id) {
  static const nlohmann::json all = nlohmann::json::parse(readText(FAROL_TESTS "/analytic/specular.json"));
  for (const nlohmann::json& c : all["cases"]) {
    if (c["id"] == id) return c;
  }
  throw std::runtime_error("no case " + id);
}

inline double expected(const std::string& id, const std::string& what) { return caseOf(id)["expected"].at(what); }

inline std::vector<TestSurface> surfacesOf(const std::string& id) {
  std::vector<TestSurface> surfaces;
  const nlohmann::json& c = caseOf(id);
  for (const nlohmann::json& s : c["surfaces"]) {
    TestSurface surface{s["name"], {{}}, Rgb(0)};
    for (const nlohmann::json& v : s["vertices"]) surface.polygons[0].push_back(Vec3(v[0], v[1], v[2]));
    surface.mirror = Rgb(s.value("specular", 0.0));
    if (s.contains("dielectric")) {
      surface.transmission = Rgb(1);
      surface.ior = s["dielectric"];
      surface.solid = true;
    }
    surfaces.push_back(surface);
  }
  if (c.contains("materials")) {
    for (size_t k = 0; k < surfaces.size(); ++k) {
      surfaces[k].reflectance = Rgb(std::stod(c["materials"]["rho_diffuse"][k].get<std::string>()));
      surfaces[k].emission = Rgb(std::stod(c["materials"]["E"][k].get<std::string>()));
    }
  }
  return surfaces;
}

// A floor of 4 x 3 before a wall that is a mirror, 2 high, at x = 0, and lights that reach both.
inline const Rgb kMirrorWall(0.9, 0.6, 0.3);
inline std::vector<TestSurface> floorBeforeAMirror() {
  return {{"floor", {{{0, 0, 0}, {4, 0, 0}, {4, 3, 0}, {0, 3, 0}}}, Rgb(0)},
          {"wall", {{{0, 0, 0}, {0, 3, 0}, {0, 3, 2}, {0, 0, 2}}}, Rgb(0), Rgb(0), false, kMirrorWall}};
}
inline PunctualLight spotAtTheMirror(double down) {
  return {.name = "spot",
          .kind = PunctualLight::Kind::spot,
          .position = {2, 1.5, 1.8},
          .direction = glm::normalize(Vec3(-2, 0, down)),
          .intensity = Rgb(100),
          .innerCone = 0.1,
          .outerCone = 0.5};
}
inline PunctualLight sunAtTheMirror() {
  return {.name = "sun", .kind = PunctualLight::Kind::directional, .direction = {-0.6, 0, -0.8}, .intensity = Rgb(5)};
}

// Terminated, missed, backs, absorbed and cut are all there is.
inline void expectAccounted(const FactorRun& run, const std::string& what) {
  for (uint32_t i = 0; i < run.patches.size(); ++i) {
    const FormFactorRow row = run.f[i];
    if (!row.made() || run.f.shares(i).exposed <= 0) continue;
    double ended = 0;
    row.forEach([&](size_t j, double value) { ended += value * (1 - run.patches.patches[j].specular().r); });
    const RowShares& s = run.f.shares(i);
    EXPECT_NEAR(ended + s.missed + s.backs + s.absorbed + s.cut, 1, 1e-6) << what << " row " << i;
  }
}

// The radiosity of a mirror cube (C5a to C5c) whose six rows are made, and its energy balance.
inline void expectKnownRadiosity(const FactorRun& run, const std::string& id, double tolerance) {
  expectAccounted(run, id);
  SolveOptions options;
  options.residual = 1e-9;
  const Solution s = solveRadiosity(run.f, run.patches, {}, run.scene, options, Log(true));
  for (const auto& [what, value] : caseOf(id)["expected"].items()) {
    if (!what.starts_with("B[")) continue;
    const double exact = value;
    EXPECT_NEAR(s.radiosity[run.patchesOf(what.substr(2, 2))[0]].r, exact, tolerance * exact) << id << " " << what;
  }
  EXPECT_LT(energyBalance(run.f, run.patches, s, Rgb(0)).relativeError, 0.005) << id;
}

struct SpecularCase {
  const char *id, *from, *to, *what;
};
inline const SpecularCase kFactors[] = {{"C1a", "1", "2", "F12 extended (through the mirror)"},
                                        {"C1c", "1", "2", "F12 extended (through the mirror)"},
                                        {"C2a", "1", "2", "F12 extended"},
                                        {"C2b", "1", "2", "F12 extended"},
                                        {"C2c", "1", "2", "F12 extended"},
                                        {"C3a", "1", "2", "F12 extended"},
                                        {"C4a", "1", "2", "transmission F12 extended"},
                                        {"C4b", "1", "2", "transmission F12 extended"},
                                        {"C4c", "1", "2", "transmission F12 extended"}};

}  // namespace farol::test
