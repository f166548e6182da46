// The cases of form_factors.json (sources per case there) as test scenes.
#pragma once

#include "test_scene.h"

#include <string>
#include <vector>

namespace farol::test {

const std::vector<nlohmann::json>& truthCases();

struct TruthCase {
  explicit TruthCase(size_t index) : json(truthCases()[index]) {}
  const nlohmann::json& json;

  bool hasSphere() const { return json["surfaces"][0]["kind"] == "sphere"; }
  bool hasElement() const { return json["surfaces"][0]["kind"] == "element"; }
  bool onlyPolygons() const;  // no faceting error
  std::string id() const { return json["id"]; }

  // Disks and spheres of so many segments; a differential element is a square so small that its size does not show.
  std::vector<TestSurface> surfaces(int segments) const;
  std::string renamed(const std::string& surface) const;  // what a surface of the case is called in the scene
};

}  // namespace farol::test
