// Small scenes for tests, made of polygons and written as glTF, so that every test goes through the loader.
#pragma once

#include "scene/scene.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace farol::test {

struct TestSurface {
  std::string name;
  std::vector<std::vector<Vec3>> polygons;  // counter-clockwise from the front, fanned into triangles
  Rgb reflectance{0.5}, emission{0};        // exact, through extras.farol
  bool twoSided = false;
  Rgb mirror{0}, transmission{0};
  double ior = 1.5;
  bool solid = false;
  double attenuationDistance = 0;  // to a tenth; 0: clear
};

// A node transform that all surfaces share.
struct Placement {
  std::array<double, 4> rotation{0, 0, 0, 1};  // quaternion x y z w
  Vec3 translation{0};
  double scale = 1;
};

// The rotation R = 1/3 [[2,-1,2],[2,2,-1],[-1,2,2]]: no axis stays where it was.
std::array<double, 4> generalRotation();

nlohmann::json gltfOf(const std::vector<TestSurface>& surfaces, const Placement& placement = {});

// A folder that is removed with everything in it.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::vector<std::string> files() const;  // names, sorted

 private:
  std::filesystem::path folder_;
};

void writeText(const std::string& path, const std::string& text);
std::string readText(const std::string& path);
std::vector<std::vector<std::string>> readCsv(const std::string& path);  // [lines][fields]

Scene loadSurfaces(const std::vector<TestSurface>& surfaces, const Placement& placement = {});

// Axis-parallel, seen from above.
std::vector<Vec3> rectangle(double x0, double y0, double x1, double y1, double z);

// Axis-parallel closed box with inward faces x0, x1, y0, y1, z0, z1.
std::vector<TestSurface> closedBox(const Vec3& size, const Rgb& reflectance = Rgb(0.5), const Rgb& emission = Rgb(0));

// A bumpy ball of about so many triangles, of radius 0.9, at a point.
TestSurface bumpyBall(int triangles, const Vec3& centre);
// The same in a closed room of 4 x 4 x 3 with a lamp below its ceiling.
std::vector<TestSurface> ballRoom(int triangles);

std::vector<TestSurface> colouredBox();  // 1 x 2 x 3, coloured walls, the ceiling emits (truth B4b)

// A sphere of quadrilaterals and triangles; `zones` lists heights z/r between which surfaces are cut, from -1 to 1.
std::vector<TestSurface> sphereZones(const std::string& name, double radius, bool inward, const std::vector<double>& zones,
                                     int segments, const Vec3& centre = Vec3(0));
TestSurface disk(const std::string& name, double radius, const Vec3& centre, const Vec3& normal, int segments);

}  // namespace farol::test
