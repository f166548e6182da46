// Bad input to the real program: each gets its exit code and one sentence, and leaves no file behind.
#include "program.h"
#include "test_scene.h"

#include <cstring>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

const std::string kCornell = FAROL_SCENES "/cornell_box/cornell_box.gltf";

json square() { return gltfOf({{"square", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}); }

class BadInput : public ::testing::Test {
 protected:
  // Renders into the folder and expects a failure with this exit code and sentence, and nothing written.
  void expectRefusal(const std::string& scene, int exitCode, const std::string& sentence, const std::string& options = "",
                     const std::string& environment = "") {
    const std::vector<std::string> before = folder_.files();
    const Outcome o = farol("render " + scene + " -o " + folder_.path("picture.png") + " --size 16x16 --patches 50 --patches-csv " +
                                folder_.path("p.csv") + " --report " + folder_.path("r.json") + " " + options,
                            environment);
    EXPECT_EQ(o.exitCode, exitCode) << o.err;
    EXPECT_THAT(o.err, HasSubstr(sentence));
    EXPECT_THAT(o.err, HasSubstr("error: "));
    EXPECT_EQ(folder_.files(), before);
  }

  std::string file(const std::string& name, const std::string& content) {
    writeText(folder_.path(name), content);
    return folder_.path(name);
  }
  std::string file(const json& document) { return file("scene.gltf", document.dump()); }

  TemporaryFolder folder_;
};

TEST_F(BadInput, MissingFile) { expectRefusal("/no/such/scene.gltf", 1, "/no/such/scene.gltf: there is no such file"); }
TEST_F(BadInput, NotGltf) { expectRefusal(file("note.gltf", "dear diary"), 1, "is not glTF"); }
TEST_F(BadInput, JsonButNotGltf) { expectRefusal(file("j.gltf", "{\"a\": 1}"), 1, "not glTF"); }
TEST_F(BadInput, TruncatedGlb) {
  const std::string good = readText(FAROL_SCENES "/reading_corner/reading_corner.glb");
  expectRefusal(file("cut.glb", good.substr(0, 5000)), 1, "truncated GLB");
}
TEST_F(BadInput, BufferOutOfRange) {
  json j = square();
  j["bufferViews"][0]["byteOffset"] = 4096;
  expectRefusal(file(j), 1, "bufferView 0: ends at byte");
}
TEST_F(BadInput, IndexOutOfRange) {
  json j = square();
  j["accessors"][1]["bufferView"] = 0;
  expectRefusal(file(j), 1, "surface 'square': index");
}
TEST_F(BadInput, NodeCycle) {
  json j = square();
  j["nodes"].push_back({{"children", {2}}});
  j["nodes"].push_back({{"children", {1}}});
  expectRefusal(file(j), 1, "cycle of nodes");
}
TEST_F(BadInput, NanVertex) {
  json j = square();
  std::string data(48, '\0');
  const float bad = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(&data[12], &bad, 4);
  file("v.bin", data);
  j["buffers"].push_back({{"byteLength", 48}, {"uri", "v.bin"}});
  j["bufferViews"][0]["buffer"] = 1;
  expectRefusal(file(j), 1, "not a finite number");
}
TEST_F(BadInput, ZeroTriangles) {
  json j = square();
  j["nodes"][0].erase("mesh");
  expectRefusal(file(j), 1, "has no triangles");
}
TEST_F(BadInput, OnlyDegenerateTriangles) {
  expectRefusal(file(gltfOf({{"line", {{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}}}})), 1, "the scene is empty");
}
TEST_F(BadInput, ReflectanceAboveOne) {
  json j = square();
  j["materials"][0]["extras"]["farol"]["diffuse"] = {0.5, 1.02, 0.5};
  expectRefusal(file(j), 1, "material 'paint of square': diffuse channel g is 1.02, outside [0, 1]");
}
TEST_F(BadInput, UnknownRequiredExtension) {
  json j = square();
  j["extensionsRequired"] = {"EXT_meshopt_compression"};
  expectRefusal(file(j), 1, "EXT_meshopt_compression is required but not supported");
}
TEST_F(BadInput, AbsolutePathInTheScene) {
  json j = square();
  j["buffers"][0]["uri"] = "/etc/hostname";
  expectRefusal(file(j), 1, "uri '/etc/hostname' is not allowed");
}
TEST_F(BadInput, ClosedSceneWithoutAbsorber) {
  expectRefusal(file(gltfOf(closedBox({1, 1, 1}, Rgb(1), Rgb(1)))), 1, "no steady state");
}
TEST_F(BadInput, UnknownOption) {
  expectRefusal(kCornell, 2, "unknown argument --resolutoin; did you mean --resolution?", "--resolutoin 64");
}
TEST_F(BadInput, OutOfRangeNumbers) {
  expectRefusal(kCornell, 2, "--resolution", "--resolution 2000");
  expectRefusal(kCornell, 2, "65 is not even", "--resolution 65");
  expectRefusal(kCornell, 2, "--positions", "--positions 0");
  expectRefusal(kCornell, 2, "--patch-size", "--patch-size -3");
  expectRefusal(kCornell, 2, "--residual", "--residual 0");
  expectRefusal(kCornell, 2, "--max-sweeps", "--max-sweeps nine");
  expectRefusal(kCornell, 2, "--sky", "--sky 1,2");
  expectRefusal(kCornell, 2, "--sky", "--sky 1,-2,3");
}
TEST_F(BadInput, OutOfRangeNumbersComeBeforeMissingFiles) {
  expectRefusal("/no/such/file.gltf", 2, "--resolution", "--resolution 4");
}
TEST_F(BadInput, ZeroSizeImage) {
  const Outcome o = farol("render " + kCornell + " -o " + folder_.path("p.png") + " --size 0x480");
  EXPECT_EQ(o.exitCode, 2);
  EXPECT_THAT(o.err, HasSubstr("--size: 0x480 is not WIDTHxHEIGHT"));
  EXPECT_TRUE(folder_.files().empty());
}
TEST_F(BadInput, UnknownEnding) {
  const Outcome o = farol("render " + kCornell + " -o " + folder_.path("p.gif"));
  EXPECT_EQ(o.exitCode, 2);
  EXPECT_THAT(o.err, HasSubstr("does not end in .png, .exr"));
}
TEST_F(BadInput, UnknownCommand) {
  const Outcome o = farol("rendr " + kCornell);
  EXPECT_EQ(o.exitCode, 2);
  EXPECT_THAT(o.err, HasSubstr("did you mean render?"));
}
TEST_F(BadInput, NoVulkanDriver) {
  expectRefusal(kCornell, 1, "no Vulkan driver was found", "",
                "FAROL_VALIDATION=0 VK_ICD_FILENAMES=/nonexistent.json VK_DRIVER_FILES=/nonexistent.json");
}
TEST_F(BadInput, NoDeviceOfThatName) { expectRefusal(kCornell, 1, "no usable Vulkan device 'voodoo'", "--device voodoo"); }
TEST_F(BadInput, UnknownCamera) { expectRefusal(kCornell, 1, "there is no camera 'rear'; the scene has camera", "--camera rear"); }
TEST_F(BadInput, TooLittleMemory) { expectRefusal(kCornell, 1, "allow more with --memory", "--memory 1K"); }
TEST_F(BadInput, UnwritableOutput) {
  const Outcome missing = farol("render " + kCornell + " -o /no/such/folder/p.png --patches 50");
  EXPECT_EQ(missing.exitCode, 1);
  EXPECT_THAT(missing.err, HasSubstr("cannot write /no/such/folder/p.png: there is no folder"));
  const Outcome folder = farol("solve " + kCornell + " -o " + folder_.path("") + " --patches 50");
  EXPECT_EQ(folder.exitCode, 2);  // a folder has no ending .glb
  std::filesystem::create_directory(folder_.path("d.glb"));
  const Outcome named = farol("solve " + kCornell + " -o " + folder_.path("d.glb") + " --patches 50");
  EXPECT_EQ(named.exitCode, 1);
  EXPECT_THAT(named.err, HasSubstr("it is a folder"));
}
TEST_F(BadInput, FullDisk) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  const Outcome o = farol("factors " + kCornell + " -o " + folder_.path("f.csv") + " --patches 50 --report /dev/full");
  EXPECT_EQ(o.exitCode, 1);
  EXPECT_THAT(o.err, HasSubstr("cannot write /dev/full"));
}

// No emitter is no error: a black picture, with a sentence.
TEST_F(BadInput, NoEmitterGivesABlackPicture) {
  const Outcome o = farol("render " + file(square()) + " -o " + folder_.path("black.png") + " --size 16x16");
  EXPECT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.err, HasSubstr("nothing emits light"));
  EXPECT_TRUE(std::filesystem::exists(folder_.path("black.png")));
}

// Not converging is an answer: exit code 3, results written all the same.
TEST_F(BadInput, NoConvergenceIsExitCodeThree) {
  const Outcome o = farol("solve " + kCornell + " --patches 100 --max-sweeps 1 --patches-csv " + folder_.path("p.csv"));
  EXPECT_EQ(o.exitCode, 3) << o.err;
  EXPECT_THAT(o.out, HasSubstr("NOT converged"));
  EXPECT_TRUE(std::filesystem::exists(folder_.path("p.csv")));
}

TEST_F(BadInput, InterruptionCleansUp) {
  for (const auto& [signal, code] : {std::pair("INT", 130), std::pair("TERM", 143)}) {
    // The stopwatch starts after the program does; form factors of this size take many seconds.
    const Outcome o = farol("factors " + kCornell + " --method raster --patches 8000 --resolution 512 -o " + folder_.path("f.npy") +
                                " & pid=$!; sleep 1.5; kill -" + signal + " $pid; wait $pid",
                            "");
    EXPECT_EQ(o.exitCode, code) << o.err;
    EXPECT_TRUE(folder_.files().empty());
  }
}

}  // namespace
}  // namespace farol::test
