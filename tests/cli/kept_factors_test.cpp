// F kept in a file: solved again under new light without being made again, refused where it does not belong, readable
// by NumPy and SciPy.
#include "program.h"
#include "test_scene.h"

#include <cmath>
#include <cstdlib>
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class KeptFactors : public ::testing::Test {
 protected:
  KeptFactors() {
    room_ = closedBox({2, 3, 2.5}, Rgb(0.5));
    room_[5].emission = Rgb(10, 8, 6);
    room_.push_back({"screen", {{{0.5, 1, 0.2}, {1.5, 1, 0.2}, {1.5, 1.2, 1.4}, {0.5, 1.2, 1.4}}}, Rgb(0.3), Rgb(0), true});
    write("room.gltf", room_);
    const Outcome o = farol("factors " + path("room.gltf") + " --patches 500 --rays 512 --seed 7 -o " + path("F.npz"));
    EXPECT_EQ(o.exitCode, 0) << o.err;
  }
  std::string path(const std::string& name) const { return folder_.path(name); }
  void write(const std::string& name, const std::vector<TestSurface>& surfaces) const {
    writeText(path(name), gltfOf(surfaces).dump());
  }
  // H and B of every patch.
  std::vector<double> solved(const std::string& scene, const std::string& options) const {
    const Outcome o = farol("solve " + path(scene) + " " + options + " --residual 1e-10 --patches-csv " + path("p.csv"));
    EXPECT_EQ(o.exitCode, 0) << o.err;
    std::vector<double> values;
    const auto lines = readCsv(path("p.csv"));
    for (size_t k = 1; k < lines.size(); ++k) {
      for (size_t column = 15; column < 21; ++column) values.push_back(std::stod(lines[k].at(column)));
    }
    return values;
  }
  void expectRefused(const std::string& arguments, const std::string& sentence) const {
    const Outcome o = farol(arguments);
    EXPECT_NE(o.exitCode, 0) << arguments;
    EXPECT_THAT(o.err, HasSubstr(sentence));
  }

  TemporaryFolder folder_;
  std::vector<TestSurface> room_;
};

TEST_F(KeptFactors, GiveWhatTheSameRowsGiveUnderNewLightAndPaint) {
  room_[5].emission = Rgb(0);
  room_[0].emission = Rgb(1, 5, 2);
  room_[4].reflectance = Rgb(0.8, 0.1, 0.4);
  room_[6].emission = Rgb(3);
  write("repainted.gltf", room_);
  for (const char* scene : {"room.gltf", "repainted.gltf"}) {
    const auto fresh = solved(scene, "--patches 500 --rays 512 --seed 7 --emitters matrix"),
               kept = solved(scene, "--emitters matrix --factors " + path("F.npz"));
    ASSERT_GE(kept.size(), fresh.size());  // a fresh run leaves out back sides that nothing sees
    ASSERT_GT(fresh.size(), 3000u);
    for (size_t k = 0; k < fresh.size(); ++k) EXPECT_NEAR(kept[k], fresh[k], 1e-8 * (1 + fresh[k])) << scene << " " << k;
  }
}

// The rows made once more, which tell the error, are kept as well; a file without them has them traced anew.
TEST_F(KeptFactors, KeepWhatTellsTheirError) {
  const std::string strip = fmt::format(
      "import zipfile; a = zipfile.ZipFile('{}'); b = zipfile.ZipFile('{}', 'w'); "
      "[b.writestr(n, a.read(n)) for n in a.namelist() if not n.startswith('farol_again')]; "
      "assert len(b.namelist()) + 5 == len(a.namelist())",
      path("F.npz"), path("stripped.npz"));
  ASSERT_EQ(std::system(("/usr/bin/python3 -c \"" + strip + "\"").c_str()), 0);
  std::array<double, 2> error{};
  for (const size_t k : {size_t{0}, size_t{1}}) {
    const Outcome o = farol("solve " + path("room.gltf") + " --factors " + path(k == 0 ? "F.npz" : "stripped.npz") + " --report " +
                            path("r.json"));
    ASSERT_EQ(o.exitCode, 0) << o.err;
    error[k] = json::parse(readText(path("r.json"))).at("estimated_error").get<double>();
  }
  // Without lamps apart nothing is traced then.
  for (const bool stripped : {false, true}) {
    farol("solve " + path("room.gltf") + " --emitters matrix --factors " + path(stripped ? "stripped.npz" : "F.npz") +
          " --report " + path("r.json"));
    EXPECT_EQ(json::parse(readText(path("r.json"))).contains("embree"), stripped);
  }
  EXPECT_GT(error[0], 0);
  EXPECT_NEAR(error[0], error[1], 1e-9 * error[1]);
}

// Data lie at multiples of 64 bytes, to be used in place; a file whose data do not is read as well, one that something compressed
// is refused.
TEST_F(KeptFactors, AreUsedWhereTheyLie) {
  const std::string look =
      "import zipfile, struct; f = open('" + path("F.npz") +
      "', 'rb'); at = lambda i: (f.seek(i.header_offset + 26), i.header_offset + 30 + sum(struct.unpack('<HH', f.read(4))))[1]; "
      "starts = [at(i) % 64 for i in zipfile.ZipFile(f).infolist()]; assert len(starts) > 10 and not any(starts), starts";
  EXPECT_EQ(std::system(("/usr/bin/python3 -c \"" + look + "\"").c_str()), 0);
  const auto again = [&](const std::string& name, const std::string& how) {
    const std::string copy = fmt::format(
        "import zipfile; a = zipfile.ZipFile('{}'); b = zipfile.ZipFile('{}', 'w', zipfile.{}); b.writestr('x', 'yz'); "
        "[b.writestr(n, a.read(n)) for n in a.namelist()]",
        path("F.npz"), path(name), how);
    return std::system(("/usr/bin/python3 -c \"" + copy + "\"").c_str());
  };
  ASSERT_EQ(again("unaligned.npz", "ZIP_STORED"), 0);
  ASSERT_EQ(again("compressed.npz", "ZIP_DEFLATED"), 0);
  EXPECT_EQ(solved("room.gltf", "--factors " + path("unaligned.npz")), solved("room.gltf", "--factors " + path("F.npz")));
  expectRefused("solve " + path("room.gltf") + " --factors " + path("compressed.npz"),
                "compressed.npz: member farol_method.npy is compressed");
}

TEST_F(KeptFactors, NeedNoVulkanDevice) {
  const Outcome o = farol("solve " + path("room.gltf") + " --factors " + path("F.npz") + " --report " + path("r.json"),
                          "VK_ICD_FILENAMES=/nowhere VK_DRIVER_FILES=/nowhere");
  EXPECT_EQ(o.exitCode, 0) << o.err;
  const json r = json::parse(readText(path("r.json")));
  EXPECT_FALSE(r.contains("device"));
  EXPECT_THAT(r["method"].dump(), HasSubstr("kept in"));
}

TEST_F(KeptFactors, OpenInNumPyAndSciPy) {
  const std::string script = "import numpy, scipy.sparse; f = scipy.sparse.load_npz('" + path("F.npz") + "'); a = numpy.load('" +
                             path("F.npz") +
                             "'); assert f.shape[0] == f.shape[1] == len(a['farol_area']); "
                             "whole = numpy.asarray(f.sum(1)).ravel() + a['farol_missed'] + a['farol_backs'] + a['farol_cut']; "
                             "assert abs(whole[a['farol_exposed'] > 0] - 1).max() < 1e-6; "
                             "assert a['farol_method'] == b'rays:512'";
  EXPECT_EQ(std::system(("/usr/bin/python3 -c \"" + script + "\"").c_str()), 0);
}

TEST_F(KeptFactors, AreRefusedWhereTheyDoNotBelong) {
  const std::string with = " --factors " + path("F.npz");
  auto moved = room_;
  moved[6].polygons[0][0].x += 0.01;
  write("moved.gltf", moved);
  expectRefused("solve " + path("moved.gltf") + with, "the geometry differs");
  json specular = gltfOf(room_);
  specular["materials"][0]["extras"]["farol"]["specular"] = {0.2, 0.2, 0.2};
  writeText(path("specular.gltf"), specular.dump());
  expectRefused("solve " + path("specular.gltf") + with, "mirrors or clear glass differ");
  expectRefused("solve " + path("room.gltf") + " --patches 600" + with, "are for --patches 500");
  expectRefused("solve " + path("room.gltf") + " --cluster 20" + with, "leave --cluster out");
  expectRefused("solve " + path("room.gltf") + " --rays 9" + with, "--factors");
  EXPECT_EQ(farol("solve " + path("room.gltf") + " --patches 500" + with).exitCode, 0);
}

// A byte changed anywhere in a member, or the file cut anywhere: a sentence that names the file, never a result.
TEST_F(KeptFactors, AreDetectedWhenDamaged) {
  const std::string whole = readText(path("F.npz"));
  size_t detected = 0, all = 0;
  for (size_t k = 1; k < 24; ++k) {
    for (const bool cut : {true, false}) {
      std::string damaged = whole;
      const size_t at = whole.size() * k / 24;
      if (cut)
        damaged.resize(at);
      else
        damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
      writeText(path("D.npz"), damaged);
      const Outcome o = farol("solve " + path("room.gltf") + " --factors " + path("D.npz"));
      ++all;
      detected += o.exitCode == 1 && o.err.find("D.npz") != std::string::npos ? 1 : 0;
    }
  }
  EXPECT_EQ(detected, all);
  // Small members come first, among what the archive itself does not check, such as times: refused, or no harm.
  const auto right = solved("room.gltf", "--factors " + path("F.npz"));
  for (size_t at = 70; at < 6000; at += 601) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    writeText(path("D.npz"), damaged);
    if (farol("solve " + path("room.gltf") + " --factors " + path("D.npz")).exitCode != 1) {
      EXPECT_EQ(solved("room.gltf", "--factors " + path("D.npz")), right) << at;
    }
  }
  writeText(path("D.npz"), "not an archive");
  expectRefused("solve " + path("room.gltf") + " --factors " + path("D.npz"), "D.npz: the file of factors cannot be read");
}

// Written by another program, with checksums that fit.
TEST_F(KeptFactors, AreRefusedWhereEntriesAreNotPossible) {
  const auto rewritten = [&](const std::string& change) {
    const std::string script = "import numpy; a = dict(numpy.load('" + path("F.npz") +
                               "')); k = int(a['indptr'][7]); n = int(a['shape'][0]); i = a['indices']; v = a['data']; " + change +
                               "; numpy.savez('" + path("D.npz") + "', **a)";
    EXPECT_EQ(std::system(("/usr/bin/python3 -c \"" + script + "\"").c_str()), 0);
  };
  rewritten("pass");
  EXPECT_EQ(solved("room.gltf", "--factors " + path("D.npz")), solved("room.gltf", "--factors " + path("F.npz")));
  for (const char* change : {"i[k], i[k + 1] = int(i[k + 1]), int(i[k])", "i[k + 1] = i[k]", "i[a['indptr'][8] - 1] = n",
                             "i[k] = -1", "v[k] = -1e-6", "v[k] = numpy.nan", "v[k] = 2000", "v[k] = numpy.inf"}) {
    rewritten(change);
    expectRefused("solve " + path("room.gltf") + " --factors " + path("D.npz"), "D.npz: row 7 has an entry outside");
  }
}

TEST_F(KeptFactors, AreComparedWithTheMethodThatMadeThem) {
  const Outcome o =
      farol("compare " + path("room.gltf") + " " + path("F.npz") + " rays:512 --patches 500 --seed 7 --report " + path("r.json"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_LT(json::parse(readText(path("r.json")))["comparison"]["l1_mean"].get<double>(), 1e-6);
}

}  // namespace
}  // namespace farol::test
