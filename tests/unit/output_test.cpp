#include "output/output.h"

#include "base/error.h"
#include "base/output_file.h"
#include "test_scene.h"

#include <cstring>
#include <gtest/gtest.h>

namespace farol::test {
namespace {

TEST(OutputFile, AppearsWholeOrNotAtAll) {
  const TemporaryFolder folder;
  {
    OutputFile file(folder.path("a.txt"));
    file.stream() << "half";
    EXPECT_FALSE(std::filesystem::exists(folder.path("a.txt")));
  }
  EXPECT_TRUE(folder.files().empty());
  OutputFile file(folder.path("a.txt"));
  file.stream() << "whole";
  file.commit();
  EXPECT_EQ(readText(folder.path("a.txt")), "whole");
  EXPECT_EQ(folder.files().size(), 1u);
}

TEST(OutputFile, SaysThatADiskIsFull) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  OutputFile file("/dev/full");
  file.stream() << std::string(100000, 'x');
  EXPECT_THROW(file.commit(), Error);
}

TEST(OutputFile, RefusesFoldersThatDoNotExist) { EXPECT_THROW(requireWritable("/no/such/folder/file"), Error); }

struct Solved {
  Solved() : scene(loadSurfaces(closedBox({1, 1, 1}, Rgb(0.5), Rgb(1)), {{0, 0, 0, 1}, {1000, 0, 0}, 1})) {
    scene.surfaces[0].name = "wall, \"left\"";
    Log log(true);
    facets = buildFacets(scene, log);
    patches = buildPatches(scene, facets, {24, 0});
    solution.radiosity.assign(patches.size(), Rgb(2, 1, 0.5));
    solution.irradiance.assign(patches.size(), Rgb(2));
  }
  Scene scene;
  FacetSet facets;
  PatchSet patches;
  Solution solution;
};

TEST(PatchesCsv, QuotesNamesAndHasAColumnPerHeader) {
  const Solved s;
  const TemporaryFolder folder;
  writePatchesCsv(folder.path("p.csv"), s.scene, s.patches, nullptr, s.solution, {});
  const std::string text = readText(folder.path("p.csv"));
  EXPECT_EQ(text.substr(0, text.find("\r\n")),
            "patch,surface,cx,cy,cz,nx,ny,nz,area,rho_r,rho_g,rho_b,E_r,E_g,E_b,B_r,B_g,B_b,H_r,H_g,H_b,exposed_area,err");
  EXPECT_NE(text.find("\r\n0,\"wall, \"\"left\"\"\",1000,0."), std::string::npos);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 25);
}

TEST(PatchesCsv, TellsTheErrorOfTheWorstChannel) {
  const Solved s;
  const TemporaryFolder folder;
  std::vector<Rgb> error(s.patches.size(), Rgb(0.25, 0.125, 0.0625));
  error[1] = Rgb(0.25, 0.5, 0.125);
  writePatchesCsv(folder.path("p.csv"), s.scene, s.patches, nullptr, s.solution, error);
  const auto lines = readCsv(folder.path("p.csv"));
  EXPECT_EQ(lines.at(1).back(), "0.25");
  EXPECT_EQ(lines.at(2).back(), "0.5");
}

TEST(FactorsNpy, HasTheHeaderThatNumPyReads) {
  FormFactorMatrix f(3);
  for (uint32_t i = 0; i < 3; ++i) f.row(i)[i] = 0.5f;
  const TemporaryFolder folder;
  writeFactorsNpy(folder.path("f.npy"), f);
  const std::string bytes = readText(folder.path("f.npy"));
  const size_t header = 10 + static_cast<unsigned char>(bytes[8]) + 256 * static_cast<size_t>(static_cast<unsigned char>(bytes[9]));
  EXPECT_EQ(bytes.substr(1, 5), "NUMPY");
  EXPECT_EQ(header % 64, 0u);
  EXPECT_NE(bytes.find("'shape': (3, 3)"), std::string::npos);
  ASSERT_EQ(bytes.size(), header + 9 * sizeof(float));
  float diagonal = 0;
  std::memcpy(&diagonal, bytes.data() + header + 4 * sizeof(float), sizeof(float));
  EXPECT_EQ(diagonal, 0.5f);
}

// lit.glb goes back through the loader: same area, and colour is radiosity times the stated scale.
TEST(LitGlb, IsReadableAndCarriesTheLight) {
  const Solved s;
  const TemporaryFolder folder;
  const NodeIrradiance nodes(s.scene, s.facets, s.patches, nullptr, s.solution.irradiance);
  writeLitGlb(folder.path("lit.glb"), s.scene, s.facets, s.patches, nodes, 0);
  Log log(true);
  const Scene lit = loadScene(folder.path("lit.glb"), log);
  ASSERT_EQ(lit.surfaces.size(), 6u);
  EXPECT_TRUE(lit.materials[0].unlit);
  double area = 0;
  for (const Surface& surface : lit.surfaces) {
    for (const auto& t : surface.triangles)
      area += 0.5 * glm::length(glm::cross(surface.positions[t[1]] - surface.positions[t[0]],
                                           surface.positions[t[2]] - surface.positions[t[0]]));
    for (const Rgb& c : surface.colors) EXPECT_NEAR(c.r, 1.0, 1e-6);  // B = E + rho H = 2 everywhere: the brightest
    for (const Vec3& p : surface.positions) EXPECT_NEAR(p.x, 1000.5, 0.51);
  }
  EXPECT_NEAR(area, 6.0, 1e-5);
  const std::string bytes = readText(folder.path("lit.glb"));
  uint32_t jsonBytes = 0;
  std::memcpy(&jsonBytes, bytes.data() + 12, 4);
  const auto json = nlohmann::json::parse(bytes.substr(20, jsonBytes));
  EXPECT_NEAR(json["scenes"][0]["extras"]["scale"].get<double>(), kPi / 2, 1e-12);
  EXPECT_TRUE(json["meshes"][0]["primitives"][0]["attributes"].contains("_RADIOSITY"));
}

}  // namespace
}  // namespace farol::test
