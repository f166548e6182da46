// Faults of the machine: memory, disk, signals, kills, two runs at once. Whatever happens, nothing half-written stands under
// the name that was asked for.
#include "base/machine.h"
#include "program.h"
#include "test_scene.h"

#include <cstdlib>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>
#include <random>
#include <unistd.h>

namespace farol::test {
namespace {

using ::testing::HasSubstr;

const std::string kCornell = FAROL_SCENES "/cornell_box/cornell_box.gltf";

// Runs farol in the background, kills it after a while, and waits for it.
int killedAfter(const std::string& arguments, double seconds, const std::string& signal) {
  const std::string command = fmt::format("{} {} > /dev/null 2>&1 & pid=$!; sleep {:.3f}; kill -{} $pid 2> /dev/null; wait $pid",
                                          FAROL_PROGRAM, arguments, seconds, signal);
  return WEXITSTATUS(std::system(fmt::format("sh -c '{}' 2> /dev/null", command).c_str()));
}

TEST(MachineFailures, KilledRunsLeaveNothingHalfWritten) {
  const TemporaryFolder folder;
  const std::string f = folder.path("F.npz"), csv = folder.path("p.csv"), glb = folder.path("lit.glb");
  const std::string factors = "factors " + kCornell + " --patches 1500 --rays 1024 -o " + f;
  const std::string solve = "solve " + kCornell + " --patches 1500 --rays 1024 -o " + glb + " --patches-csv " + csv;
  const Stopwatch watch;
  ASSERT_EQ(farol(factors).exitCode, 0);
  const double factorSeconds = watch.seconds();
  ASSERT_EQ(farol(solve).exitCode, 0);
  const double solveSeconds = watch.seconds() - factorSeconds;
  const size_t lineCount = readCsv(csv).size();
  std::filesystem::remove(f);
  std::mt19937 random(11);
  std::uniform_real_distribution<double> moment(0, 1.1);  // of the time that a whole run takes
  int killed = 0, finished = 0;
  constexpr int kKills = 20;
  for (int k = 0; k < kKills; ++k) {
    killed += killedAfter(k % 2 == 0 ? factors : solve, moment(random) * (k % 2 == 0 ? factorSeconds : solveSeconds), "KILL") == 137
                  ? 1
                  : 0;
    if (std::filesystem::exists(f)) {
      ++finished;
      const Outcome o = farol("solve " + kCornell + " --factors " + f);
      EXPECT_EQ(o.exitCode, 0) << "kill " << k << ": " << o.err;
      std::filesystem::remove(f);
    }
    if (std::filesystem::exists(csv)) {
      const auto lines = readCsv(csv);
      EXPECT_EQ(lines.size(), lineCount) << "kill " << k;
      EXPECT_EQ(lines.back().size(), lines.front().size());
      std::filesystem::remove(csv);
    }
    if (std::filesystem::exists(glb)) {
      const std::string bytes = readText(glb);
      uint32_t length = 0;
      std::copy_n(bytes.data() + 8, 4, reinterpret_cast<char*>(&length));
      EXPECT_EQ(length, bytes.size()) << "kill " << k;
      std::filesystem::remove(glb);
    }
  }
  EXPECT_GT(killed, kKills / 4) << "most are over before they are killed";
  for (const std::string& command : {factors, solve}) EXPECT_EQ(farol(command).exitCode, 0) << "the next run";
  fmt::print("{} of {} runs were killed before their end, {} had written F\n", killed, kKills, finished);
}

// Half a minute of shadow rays, and of light through glass, of which a signal leaves a second.
TEST(MachineFailures, SignalsEndDirectLight) {
  for (const char* settings : {"cornell_box/cornell_box.gltf --patches 200000 --shadow-rays 8192",
                               "mirrors_and_glass/glass_block.gltf --patches 24000 --shadow-rays 2048"}) {
    const Stopwatch watch;
    EXPECT_EQ(killedAfter(fmt::format("solve {}/{} --method rays --rays 64", FAROL_SCENES, settings), 4, "INT"), 130);
    EXPECT_LT(watch.seconds(), 12) << settings;
  }
}

TEST(MachineFailures, SignalsLeaveKeptFactorsAsTheyWere) {
  const TemporaryFolder folder;
  const std::string f = folder.path("F.npz"), factors = "factors " + kCornell + " --patches 500 --rays 256 -o " + f;
  ASSERT_EQ(farol(factors).exitCode, 0);
  const std::string before = readText(f);
  for (const auto& [signal, code] : {std::pair("INT", 130), std::pair("TERM", 143)}) {
    EXPECT_EQ(killedAfter("factors " + kCornell + " --patches 8000 --rays 65536 -o " + f, 0.7, signal), code);
    EXPECT_EQ(folder.files(), std::vector<std::string>{"F.npz"});
    EXPECT_EQ(readText(f), before);
    EXPECT_EQ(killedAfter("chart " + kCornell + " --patches 400 --time 10 -o " + folder.path("chart.svg"), 5, signal), code);
    for (const std::string& name : folder.files()) {
      EXPECT_THAT(name, ::testing::Not(HasSubstr(".tmp")));
      if (name != "F.npz") std::filesystem::remove(folder.path(name));  // what was measured is drawn
    }
  }
}

TEST(MachineFailures, TwoRunsIntoOneFileGiveOneOfThem) {
  const TemporaryFolder folder;
  const std::string f = folder.path("F.npz"),
                    command = fmt::format("{} factors {} --patches 500 --rays 256 --quiet -o {}", FAROL_PROGRAM, kCornell, f);
  EXPECT_EQ(std::system(fmt::format("sh -c '{} & {}; first=$?; wait $! && exit $first'", command, command).c_str()), 0);
  EXPECT_EQ(folder.files(), std::vector<std::string>{"F.npz"});
  EXPECT_EQ(farol("solve " + kCornell + " --factors " + f).exitCode, 0);
}

TEST(MachineFailures, TooLittleMemoryIsASentence) {
  const TemporaryFolder folder;
  const std::string error = folder.path("err");
  const int status = std::system(
      fmt::format("sh -c 'ulimit -v 700000; {} factors {} --patches 30000 --rays 8192 -o {} --threads 1 > /dev/null 2> {}'",
                  FAROL_PROGRAM, kCornell, folder.path("F.npz"), error)
          .c_str());
  EXPECT_EQ(WEXITSTATUS(status), 1);
  EXPECT_THAT(readText(error), HasSubstr("error: "));
  EXPECT_THAT(readText(error), HasSubstr("memory"));
  EXPECT_EQ(folder.files(), std::vector<std::string>{"err"});
}

// Orders a fault of the Vulkan device (gpu.h).
Outcome withFault(const std::string& fault, const std::string& arguments) {
  setenv("FAROL_DEVICE_FAULT", fault.c_str(), 1);
  const Outcome o = farol(arguments);
  unsetenv("FAROL_DEVICE_FAULT");
  return o;
}

TEST(MachineFailures, TooLittleDeviceMemoryMakesSmallerBatches) {
  const TemporaryFolder folder;
  const auto arguments = [&](const std::string& name) {
    return "factors " + kCornell + " --patches 400 --method raster --resolution 64 -o " + folder.path(name + ".npz") +
           " --report " + folder.path(name + ".json");
  };
  ASSERT_EQ(farol(arguments("free")).exitCode, 0);
  const Outcome o = withFault("memory:1000000", arguments("tight"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  const auto batchOf = [&](const std::string& name) {
    return nlohmann::json::parse(readText(folder.path(name + ".json"))).at("batch").at("hemicubes").get<int>();
  };
  EXPECT_LT(batchOf("tight"), batchOf("free") / 2);
  EXPECT_EQ(readText(folder.path("tight.npz")), readText(folder.path("free.npz"))) << "rows do not depend on batches";

  const Outcome none = withFault("memory:20000", arguments("none"));
  EXPECT_EQ(none.exitCode, 1);
  EXPECT_THAT(none.err, HasSubstr("out of device memory"));
  EXPECT_THAT(none.err, HasSubstr("no room for one hemicube of resolution 64"));
  EXPECT_FALSE(std::filesystem::exists(folder.path("none.npz")));
}

TEST(MachineFailures, LostDeviceIsASentence) {
  const TemporaryFolder folder;
  for (const char* fault : {"lost:0", "lost:2", "lost:12"}) {
    const Outcome o = withFault(fault, "factors " + kCornell + " --patches 400 --method raster -o " + folder.path("F.npz"));
    EXPECT_EQ(o.exitCode, 1) << fault;
    EXPECT_THAT(o.err, HasSubstr("device lost"));
    EXPECT_THAT(o.err, HasSubstr("--method rays"));
    EXPECT_EQ(folder.files(), std::vector<std::string>{}) << fault;
  }
}

// A solve has its state on the host: what the device leaves undone, the CPU does.
TEST(MachineFailures, SolveOnAFailingDeviceEndsOnTheCpu) {
  const TemporaryFolder folder;
  const std::string solve = "solve " + kCornell + " --patches 400 --method rays --solve-on gpu";
  const auto radiosityOf = [&](const std::string& fault) {
    const std::string csv = folder.path("p.csv"), report = folder.path("r.json");
    const Outcome o = withFault(fault, solve + " --patches-csv " + csv + " --report " + report);
    EXPECT_EQ(o.exitCode, 0) << fault << ": " << o.err;
    const bool failed = o.err.find("[device-failed]") != std::string::npos;
    EXPECT_EQ(failed, fault != "none") << fault << ": " << o.err;
    EXPECT_EQ(nlohmann::json::parse(readText(report)).at("solve").at("on").get<std::string>() == "CPU", failed) << fault;
    std::vector<double> b;
    const auto lines = readCsv(csv);
    const auto column = std::find(lines[0].begin(), lines[0].end(), "B_r") - lines[0].begin();
    for (size_t i = 1; i < lines.size(); ++i) b.push_back(std::stod(lines[i].at(static_cast<size_t>(column))));
    return b;
  };
  const std::vector<double> free = radiosityOf("none");
  for (const char* fault : {"memory:100000", "lost:1", "lost:5"}) {
    const std::vector<double> b = radiosityOf(fault);
    ASSERT_EQ(b.size(), free.size());
    for (size_t i = 0; i < b.size(); ++i) EXPECT_NEAR(b[i], free[i], 1e-4 * free[i] + 1e-9) << fault;
  }
}

TEST(MachineFailures, FullDiskIsASentence) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  for (const char* output : {"--patches-csv", "--report"}) {
    const Outcome o = farol("solve " + kCornell + " --patches 50 " + output + " /dev/full");
    EXPECT_EQ(o.exitCode, 1) << output;
    EXPECT_THAT(o.err, HasSubstr("cannot write /dev/full"));
  }
  const TemporaryFolder folder;
  const std::string kept = folder.path("F.npz");
  std::filesystem::create_symlink("/dev/full", kept);
  const Outcome o = farol("factors " + kCornell + " --patches 50 --rays 16 -o " + kept);
  EXPECT_EQ(o.exitCode, 1);
  EXPECT_THAT(o.err, HasSubstr("cannot write " + kept + ": "));
  EXPECT_THAT(o.err, HasSubstr("No space left on device"));
}

TEST(MachineFailures, ReadOnlyFolderIsASentenceBeforeAnyWork) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  const TemporaryFolder folder;
  std::filesystem::permissions(folder.path(""), std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  const Outcome o = farol("factors " + kCornell + " --patches 50 -o " + folder.path("F.npz"));
  std::filesystem::permissions(folder.path(""), std::filesystem::perms::owner_all);
  EXPECT_EQ(o.exitCode, 1);
  EXPECT_THAT(o.err, HasSubstr("read-only"));
}

}  // namespace
}  // namespace farol::test
