#include "truth_cases.h"

#include <cmath>

namespace farol::test {
namespace {

using nlohmann::json;

Vec3 vec(const json& a) { return {a[0].get<double>(), a[1].get<double>(), a[2].get<double>()}; }

// A differential element becomes a square so small that its size does not show (1e-3 of the distances).
TestSurface element(const json& s) {
  const Vec3 p = vec(s["point"]), n = glm::normalize(vec(s["normal"])), a = anyPerpendicular(n), b = glm::cross(n, a);
  constexpr double h = 5e-4;
  return {"element", {{p - h * a - h * b, p + h * a - h * b, p + h * a + h * b, p - h * a + h * b}}};
}

}  // namespace

std::vector<TestSurface> TruthCase::surfaces(int segments) const {
  std::vector<TestSurface> result;
  for (const nlohmann::json& s : json["surfaces"]) {
    const std::string kind = s["kind"], name = s["name"];
    if (kind == "element") {
      result.push_back(element(s));
    } else if (kind == "disk") {
      result.push_back(disk(name, s["radius"], vec(s["center"]), glm::normalize(vec(s["normal"])), segments));
    } else if (kind == "sphere") {
      std::vector<double> zones = {-1, 1};
      std::string base = name;
      if (json["surfaces"].size() > 1 && json["surfaces"][1]["kind"] == "spherical cap") {
        zones = {-1, std::cos(json["surfaces"][1]["half_angle_deg"].get<double>() * kPi / 180), 1};
        base = "zone";  // zone0 is the rest, zone1 the cap
      }
      for (TestSurface& zone : sphereZones(base, s["radius"], s["facing"] == "in", zones, segments))
        result.push_back(std::move(zone));
    } else if (kind == "polygon") {
      TestSurface surface{name, {{}}};
      for (const nlohmann::json& v : s["vertices"]) surface.polygons[0].push_back(vec(v));
      surface.twoSided = s.value("two_sided", false);
      result.push_back(surface);
    }
  }
  return result;
}

std::string TruthCase::renamed(const std::string& name) const {
  if (!id().starts_with("A11")) return name;
  return name == "cap" ? "zone1" : "zone0";
}

bool TruthCase::onlyPolygons() const {
  for (const nlohmann::json& s : json["surfaces"]) {
    if (s["kind"] != "polygon") return false;
  }
  return true;
}

const std::vector<nlohmann::json>& truthCases() {
  static const std::vector<nlohmann::json> all =
      nlohmann::json::parse(readText(FAROL_TESTS "/analytic/form_factors.json"))["cases"];
  return all;
}

}  // namespace farol::test
