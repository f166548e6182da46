#include "base/error.h"
#include "scene/scene.h"
#include "test_scene.h"

#include <cstring>
#include <functional>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

json square() { return gltfOf({{"square", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}); }

Scene load(const json& document) {
  const TemporaryFolder folder;
  writeText(folder.path("scene.gltf"), document.dump());
  Log log(true);
  return loadScene(folder.path("scene.gltf"), log);
}

double areaOf(const Surface& s) {
  double sum = 0;
  for (const auto& t : s.triangles)
    sum += 0.5 * glm::length(glm::cross(s.positions[t[1]] - s.positions[t[0]], s.positions[t[2]] - s.positions[t[0]]));
  return sum;
}

Vec3 normalOf(const Surface& s) {
  const auto& t = s.triangles[0];
  return glm::normalize(glm::cross(s.positions[t[1]] - s.positions[t[0]], s.positions[t[2]] - s.positions[t[0]]));
}

TEST(SceneLoader, ReadsTheSuppliedScenes) {
  Log log(true);
  const Scene box = loadScene(FAROL_SCENES "/cornell_box/cornell_box.gltf", log);
  ASSERT_EQ(box.cameras.size(), 1u);
  double lamp = 0;
  for (const Surface& s : box.surfaces) lamp += s.name == "lamp" ? areaOf(s) : 0;
  EXPECT_NEAR(lamp, 130 * 105, 1e-2);
  for (const Material& m : box.materials) {
    if (m.name != "lamp") continue;
    EXPECT_NEAR(m.emission.r, 17 * kPi, 1e-12);  // radiance L becomes exitance pi L
    EXPECT_NEAR(m.emission.g, 12 * kPi, 1e-12);
  }
  EXPECT_EQ(loadScene(FAROL_SCENES "/reading_corner/reading_corner.glb", log).textures.size(), 2u);
}

TEST(SceneLoader, NamesSurfacesByNodeAndPrimitive) {
  json j = square();
  j["meshes"][0]["primitives"].push_back(j["meshes"][0]["primitives"][0]);
  j["nodes"].push_back({{"name", "square"}, {"mesh", 0}});
  j["nodes"].push_back({{"mesh", 0}});
  j["scenes"][0]["nodes"] = {0, 1, 2};
  std::vector<std::string> names;
  const Scene scene = load(j);
  for (const Surface& s : scene.surfaces) names.push_back(s.name);
  EXPECT_THAT(names, ::testing::ElementsAre("square", "square#2", "square~2", "square#2~2", "node2", "node2#2"));
}

TEST(SceneLoader, KeepsNamesUniqueEvenAgainstTheirOwnSuffix) {
  json j = square();
  j["nodes"].push_back({{"name", "square~2"}, {"mesh", 0}});
  j["nodes"].push_back({{"name", "square"}, {"mesh", 0}});
  j["scenes"][0]["nodes"] = {0, 1, 2};
  std::vector<std::string> names;
  const Scene scene = load(j);
  for (const Surface& s : scene.surfaces) names.push_back(s.name);
  EXPECT_THAT(names, ::testing::ElementsAre("square", "square~2", "square~3"));
}

TEST(SceneLoader, AppliesNodeTransformsAndFlipsMirroredOnes) {
  json j = square();
  j["nodes"][0]["scale"] = {2, 3, 1};
  EXPECT_NEAR(areaOf(load(j).surfaces[0]), 6, 1e-12);
  EXPECT_NEAR(normalOf(load(j).surfaces[0]).z, 1, 1e-12);
  j["nodes"][0]["scale"] = {-2, 3, 1};  // a mirrored object still faces the same way
  EXPECT_NEAR(normalOf(load(j).surfaces[0]).z, 1, 1e-12);
  j["nodes"].push_back({{"children", {0}}, {"translation", {5, 0, 0}}});
  j["scenes"][0]["nodes"] = {1};
  EXPECT_NEAR(load(j).surfaces[0].positions[0].x, 5, 1e-12);
}

TEST(SceneLoader, ReadsStripsAndFans) {
  json j = square();
  j["meshes"][0]["primitives"][0].erase("indices");
  for (const int mode : {5, 6}) {
    j["meshes"][0]["primitives"][0]["mode"] = mode;
    EXPECT_EQ(load(j).surfaces[0].triangles.size(), 2u);
  }
  EXPECT_NEAR(areaOf(load(j).surfaces[0]), 1, 1e-12);  // as a fan the four corners make the square
}

TEST(SceneLoader, AppliesSparseAccessors) {
  json j = square();
  // The last index (of 6) of the index accessor becomes what the first two bytes of the positions hold: 0.
  j["accessors"][1]["sparse"] = {
      {"count", 1}, {"indices", {{"bufferView", 1}, {"byteOffset", 4}, {"componentType", 5125}}}, {"values", {{"bufferView", 0}}}};
  EXPECT_EQ(load(j).surfaces[0].triangles[0][1], 0u);  // element 1 (index list 0 1 2 ...) replaced by 0
}

TEST(SceneLoader, ReadsQuantisedPositions) {
  json j = square();
  j["extensionsRequired"] = {"KHR_mesh_quantization"};
  j["accessors"][0]["componentType"] = 5121;  // the bytes of the floats, read as such: finite numbers from 0 to 255
  j["accessors"][0]["normalized"] = true;
  const Scene scene = load(j);
  for (const Vec3& p : scene.surfaces[0].positions) EXPECT_LE(p.x, 1.0);
}

TEST(SceneLoader, ReadsEmissionStrengthAndTheExactOverride) {
  json j = square();
  j["materials"][0] = {{"emissiveFactor", {1, 0.5, 0}},
                       {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 4}}}}}};
  EXPECT_NEAR(load(j).materials[0].emission.g, 2 * kPi, 1e-12);
  j["materials"][0]["extras"]["farol"] = {{"emission", {7, 7, 7}}, {"diffuse", {0.1, 0.2, 0.3}}};
  const Optics o = load(j).materials[0].evaluate({}, {});
  EXPECT_EQ(o.emission, Rgb(7));
  EXPECT_EQ(o.diffuse, Rgb(0.1, 0.2, 0.3));
}

TEST(SceneLoader, KeepsPunctualLights) {
  json j = square();
  j["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "spot"}, {"intensity", 5}, {"color", {1, 0.5, 0}}, {"spot", {{"outerConeAngle", 0.5}}}}};
  j["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = 0;
  const Scene scene = load(j);
  ASSERT_EQ(scene.lights.size(), 1u);
  EXPECT_EQ(scene.lights[0].kind, PunctualLight::Kind::spot);
  EXPECT_NEAR(scene.lights[0].intensity.g, 2.5, 1e-12);
  EXPECT_NEAR(scene.lights[0].outerCone, 0.5, 1e-12);
}

TEST(SceneLoader, ChoosesCamerasByName) {
  json j = square();
  j["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 0.7}, {"znear", 0.1}}}}};
  j["nodes"].push_back({{"name", "front"}, {"camera", 0}, {"translation", {0, 0, 3}}});
  j["scenes"][0]["nodes"] = {0, 1};
  const Scene scene = load(j);
  EXPECT_NEAR(chooseCamera(scene, "").position.z, 3, 1e-12);
  EXPECT_NEAR(chooseCamera(scene, "front").forward.z, -1, 1e-12);
  EXPECT_THAT([&] { chooseCamera(scene, "back"); }, ThrowsMessage<Error>(AllOf(HasSubstr("no camera 'back'"), HasSubstr("front"))));
  EXPECT_TRUE(chooseCamera(load(square()), "").frontFacesOnly);
}

// Each change breaks a good file in one place; the sentence names the object and what is wrong.
struct Broken {
  const char* name;
  std::function<void(json&)> change;
  const char* sentence;
};

class BrokenFile : public ::testing::TestWithParam<Broken> {};

TEST_P(BrokenFile, IsRefusedWithASentence) {
  json j = square();
  GetParam().change(j);
  EXPECT_THAT([&] { load(j); }, ThrowsMessage<Error>(AllOf(HasSubstr("scene.gltf: "), HasSubstr(GetParam().sentence))));
}

const Broken kBroken[] = {
    {"NoAsset", [](json& j) { j.erase("asset"); }, "not glTF"},
    {"OldVersion", [](json& j) { j["asset"]["version"] = "1.0"; }, "only glTF 2 is read"},
    {"UnknownRequiredExtension", [](json& j) { j["extensionsRequired"] = {"KHR_draco_mesh_compression"}; },
     "KHR_draco_mesh_compression is required but not supported"},
    {"BufferViewBeyondBuffer", [](json& j) { j["bufferViews"][0]["byteLength"] = 100000; }, "bufferView 0: ends at byte 100000"},
    {"BufferShorterThanSaid", [](json& j) { j["buffers"][0]["byteLength"] = 1000; }, "file"},
    {"AccessorBeyondView", [](json& j) { j["accessors"][0]["count"] = 400; }, "accessor 0: needs"},
    {"NegativeCount", [](json& j) { j["accessors"][0]["count"] = -1; }, "accessor 0: count is -1"},
    {"HugeCount",
     [](json& j) {
       j["accessors"][0].erase("bufferView");
       j["accessors"][0]["count"] = uint64_t{1} << 40;
     },
     "accessor 0: count"},
    {"UnknownComponentType", [](json& j) { j["accessors"][0]["componentType"] = 5130; }, "componentType"},
    {"BadStride", [](json& j) { j["bufferViews"][0]["byteStride"] = 3; }, "byteStride is 3"},
    {"MeshIndexOutOfRange", [](json& j) { j["nodes"][0]["mesh"] = 7; }, "mesh is 7, but the file has 1 meshes"},
    {"AttributeIndexOutOfRange", [](json& j) { j["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9; }, "POSITION is 9"},
    {"VertexIndexOutOfRange", [](json& j) { j["accessors"][1]["bufferView"] = 0; }, "index"},  // float bits read as indices
    {"NodeCycle",
     [](json& j) {
       j["nodes"].push_back({{"children", {2}}});
       j["nodes"].push_back({{"children", {1}}});
     },
     "cycle of nodes"},
    {"NodeOfItself", [](json& j) { j["nodes"][0]["children"] = {0}; }, "cycle of nodes"},
    {"TwoParents",
     [](json& j) {
       j["nodes"].push_back({{"children", {0}}});
       j["nodes"].push_back({{"children", {0}}});
     },
     "is a child of node 1 and of node 2"},
    {"AbsolutePath", [](json& j) { j["buffers"][0]["uri"] = "/etc/passwd"; }, "uri '/etc/passwd' is not allowed"},
    {"OtherScheme", [](json& j) { j["buffers"][0]["uri"] = "file:///etc/passwd"; }, "is not allowed"},
    {"MissingBufferFile", [](json& j) { j["buffers"][0]["uri"] = "nowhere.bin"; }, "nowhere.bin"},
    {"NoTriangles", [](json& j) { j["nodes"][0].erase("mesh"); }, "has no triangles"},
    {"ReflectanceAboveOne",
     [](json& j) {
       j["materials"][0] = {{"name", "chalk"}, {"pbrMetallicRoughness", {{"baseColorFactor", {1.02, 0.5, 0.5, 1}}}}};
     },
     "material 'chalk': baseColorFactor channel r is 1.02, outside [0, 1]"},
    {"SumAboveOne",
     [](json& j) {
       j["materials"][0]["extras"]["farol"] = {{"diffuse", {0.6, 0, 0}}, {"specular", {0.6, 0, 0}}};
     },
     "above 1"},
    {"NegativeEmission",
     [](json& j) {
       j["materials"][0]["extras"]["farol"] = {{"emission", {-1, 0, 0}}};
     },
     "emission channel r is -1"},
    {"TextWhereANumberBelongs", [](json& j) { j["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] = "shiny"; },
     "metallicFactor"},
    {"RoughTransmission",
     [](json& j) {
       j["materials"][0] = {{"name", "frost"}, {"extensions", {{"KHR_materials_transmission", {{"transmissionFactor", 0.5}}}}}};
     },
     "'frost': transmission with roughness 1"},
    {"TextureMissing",
     [](json& j) {
       j["materials"][0] = {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
     },
     "baseColorTexture"},
    {"BadFieldOfView",
     [](json& j) {
       j["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 4}, {"znear", 1}}}}};
       j["nodes"][0]["camera"] = 0;
     },
     "yfov is 4"},
};
INSTANTIATE_TEST_SUITE_P(SceneLoader, BrokenFile, ::testing::ValuesIn(kBroken),
                         [](const auto& p) { return std::string(p.param.name); });

// A vertex that is not a number, in the binary data.
TEST(SceneLoader, RefusesAVertexThatIsNotANumber) {
  const TemporaryFolder folder;
  json j = square();
  std::string floats;
  const float bad[12] = {0, 0, 0, 1, 0, 0, std::numeric_limits<float>::quiet_NaN(), 1, 0, 0, 1, 0};
  floats.assign(reinterpret_cast<const char*>(bad), sizeof(bad));
  writeText(folder.path("bad.bin"), floats);
  j["buffers"].push_back({{"byteLength", sizeof(bad)}, {"uri", "bad.bin"}});
  j["bufferViews"][0]["buffer"] = 1;
  writeText(folder.path("scene.gltf"), j.dump());
  Log log(true);
  EXPECT_THAT([&] { loadScene(folder.path("scene.gltf"), log); },
              ThrowsMessage<Error>(AllOf(HasSubstr("surface 'square'"), HasSubstr("not a finite number"))));
}

TEST(SceneLoader, RefusesDamagedContainers) {
  const TemporaryFolder folder;
  Log log(true);
  const std::string good = readText(FAROL_SCENES "/reading_corner/reading_corner.glb");
  const auto refuses = [&](const std::string& bytes, const char* sentence) {
    writeText(folder.path("x.glb"), bytes);
    EXPECT_THAT([&] { loadScene(folder.path("x.glb"), log); }, ThrowsMessage<Error>(HasSubstr(sentence)));
  };
  refuses(good.substr(0, 10), "truncated GLB");
  refuses(good.substr(0, good.size() / 2), "truncated GLB");
  refuses("PK\x03\x04 something else", "is not glTF");
  refuses("", "is not glTF");
  std::string oldVersion = good;
  oldVersion[4] = 1;
  refuses(oldVersion, "version is 1");
  EXPECT_THROW(loadScene(folder.path("missing.gltf"), log), Error);
  EXPECT_THROW(loadScene("/", log), Error);
}

// A deep chain of nodes neither overflows the stack nor takes quadratic time.
TEST(SceneLoader, WalksDeepChains) {
  json j = square();
  const size_t depth = 20000;
  for (size_t k = 0; k < depth; ++k) j["nodes"].push_back({{"children", {k == 0 ? 0 : k}}});
  j["scenes"][0]["nodes"] = {depth};
  EXPECT_NEAR(areaOf(load(j).surfaces[0]), 1, 1e-12);
}

}  // namespace
}  // namespace farol::test
