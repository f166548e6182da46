// Failures of the solve: open scenes, reflectance 1 and above, rows above 1, slow convergence, drift of energy, empty scenes.
#include "base/error.h"
#include "failure_table.h"
#include "given_system.h"
#include "known_radiosity.h"
#include "program.h"
#include "test_scene.h"

#include <Eigen/Dense>
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using ::testing::HasSubstr;

// B or H of one channel per patch, from the program.
std::vector<double> column(const std::vector<TestSurface>& surfaces, const std::string& options, size_t which, Outcome& outcome) {
  const TemporaryFolder folder;
  writeText(folder.path("s.gltf"), gltfOf(surfaces).dump());
  outcome = farol("solve " + folder.path("s.gltf") + " --patches-csv " + folder.path("p.csv") + " --report " +
                  folder.path("r.json") + " " + options);
  std::vector<double> values;
  if (!std::filesystem::exists(folder.path("p.csv"))) return values;
  const auto lines = readCsv(folder.path("p.csv"));
  for (size_t k = 1; k < lines.size(); ++k) values.push_back(std::stod(lines[k].at(which)));
  return values;
}
constexpr size_t kRadiosity = 15;  // column of red

std::vector<std::vector<double>> cubeRows(double facing = 0.19982489569838738, double side = 0.2000437760754) {
  std::vector<std::vector<double>> rows(6, std::vector<double>(6, side));
  for (size_t i = 0; i < 6; ++i) {
    rows[i][i] = 0;
    rows[i][i ^ 1] = facing;
  }
  return rows;
}

Eigen::MatrixXd matrixOf(const std::vector<std::vector<double>>& rows) {
  Eigen::MatrixXd m(rows.size(), rows.size());
  for (size_t i = 0; i < rows.size(); ++i) {
    for (size_t j = 0; j < rows.size(); ++j) m(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = rows[i][j];
  }
  return m;
}

// Failure 11. Two facing plates: rows that are normalised without what they miss multiply the light.
TEST(OpenScenes, KeepWhatLeaves) {
  constexpr double kF = 0.19982489569838738;
  const double naive = (1 + 0.5 * 0) / (1 - 0.5 * 0.8);  // F = 1 between the two
  EXPECT_NEAR(naive, 1.666667, 1e-6);
  const std::vector<TestSurface> plates = {{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0.5), Rgb(1)},
                                           {"2", {{{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}}, Rgb(0.8)}};
  Outcome o;
  const auto b = column(plates, "--patch-size 1 --method rays --rays 65536 --emitters matrix", kRadiosity, o);
  ASSERT_EQ(b.size(), 2u) << o.err;
  EXPECT_NEAR(b[0], 1 / (1 - 0.4 * kF * kF), 2e-3);
  EXPECT_NEAR(b[1], 0.162455, 2e-3);
  EXPECT_THAT(o.out, HasSubstr("to the open"));
  tabulate(11, "two facing plates in the open", fmt::format("B1 = {:.4f} (rows normalised)", naive),
           fmt::format("B1 = {:.4f} (1.0162 is exact)", b[0]), "share to the open");
}

// Failure 12. Nothing absorbs: there is no steady state. An absorber anywhere makes one.
TEST(ReflectanceOne, IsRefusedOnlyWhereNothingAbsorbs) {
  const Eigen::MatrixXd f = matrixOf(cubeRows());
  Eigen::VectorXd b = Eigen::VectorXd::Ones(6), e = Eigen::VectorXd::Zero(6);
  e[0] = 1;
  constexpr int kSweeps = 1000;
  for (int k = 0; k < kSweeps; ++k) b = e + f * b;  // rows sum to 1: the mean grows by the mean emission every sweep
  EXPECT_NEAR(b.mean(), 1 + kSweeps / 6.0, 1);
  auto cube = closedBox({1, 1, 1}, Rgb(1));
  cube[0].emission = Rgb(1);
  Outcome o;
  column(cube, "--patches 100", kRadiosity, o);
  EXPECT_EQ(o.exitCode, 1);
  EXPECT_THAT(o.err, HasSubstr("no steady state"));
  cube[5].reflectance = Rgb(0.5);
  const auto known = column(cube, "--patch-size 1 --method rays --rays 65536 --emitters matrix", kRadiosity, o);
  ASSERT_EQ(known.size(), 6u) << o.err;
  const double exact[] = {2.666606, 1.833151, 1.833303, 1.833303, 1.833455, 1.0};
  for (size_t k = 0; k < 6; ++k) EXPECT_NEAR(known[k], exact[k], 0.01 * exact[k]) << k;
  tabulate(12, "a lit cube of reflectance 1; with one face of 0.5",
           fmt::format("B grows without end: {:.0f} after 1000 sweeps", b.mean()),
           fmt::format("refused; B = {:.3f} (2.667 is exact)", known[0]), "error naming surface and channel");
}

// Failure 13. Reflectance 1.02: a direct solve gives a plausible size with the wrong sign.
TEST(ReflectanceAboveOne, IsRefusedByMaterialAndChannel) {
  const Eigen::MatrixXd f = matrixOf(cubeRows());
  const Eigen::VectorXd b = (Eigen::MatrixXd::Identity(6, 6) - 1.02 * f).partialPivLu().solve(Eigen::VectorXd::Ones(6));
  EXPECT_NEAR(b[0], -50, 1.5);
  auto cube = closedBox({1, 1, 1}, Rgb(0.5));
  cube[2].reflectance = Rgb(0.5, 0.5, 1.02);
  Outcome o;
  column(cube, "--patches 100", kRadiosity, o);
  EXPECT_EQ(o.exitCode, 1);
  EXPECT_THAT(o.err, HasSubstr("material 'paint of y0': diffuse channel b is 1.02"));
  cube[2].reflectance = Rgb(0.6);
  cube[2].mirror = Rgb(0.5);
  column(cube, "--patches 100", kRadiosity, o);
  EXPECT_EQ(o.exitCode, 1) << "more than 1 together";
  cube[2].mirror = Rgb(0);
  cube[2].emission = Rgb(-1, 0, 0);
  column(cube, "--patches 100", kRadiosity, o);
  EXPECT_EQ(o.exitCode, 1) << "negative emission";
  tabulate(13, "reflectance 1.02", fmt::format("B = {:.0f} (direct solve)", b[0]), "refused", "error naming material and channel");
}

// Failure 17. Exact walls and the ceiling by its centre: the row sums to 1.0396, and sweeps diverge for rho 0.97.
TEST(RowsAboveOne, AreRefusedAndNotIterated) {
  const auto rows = cubeRows(0.239456, 0.2000437760754);
  const double radius = 0.97 * matrixOf(rows).eigenvalues().cwiseAbs().maxCoeff();
  EXPECT_NEAR(radius, 1.008443, 1e-4);
  const GivenSystem given(rows, std::vector<double>(6, 0.97), {1, 0, 0, 0, 0, 0});
  try {
    given.solve(SolverKind::jacobi);
    ADD_FAILURE() << "not refused";
  } catch (const Error& e) {
    EXPECT_THAT(std::string(e.what()), HasSubstr("1.008442 in row 0"));
  }
  // Rows of the program come from one partition of the hemisphere each.
  auto cube = closedBox({1, 1, 1}, Rgb(0.97));
  cube[0].emission = Rgb(1);
  double worst = 0;
  for (const char* method : {"rays", "raster", "raster --near-field off"}) {
    const TemporaryFolder folder;
    writeText(folder.path("s.gltf"), gltfOf(cube).dump());
    const Outcome o = farol("solve " + folder.path("s.gltf") + " --patches 150 --emitters matrix --report " +
                            folder.path("r.json") + " --method " + method);
    ASSERT_EQ(o.exitCode, 0) << o.err;
    worst = std::max(worst, nlohmann::json::parse(readText(folder.path("r.json")))["row_sums"]["max"].get<double>());
  }
  EXPECT_LT(worst, 1 + 1e-5);
  tabulate(17, "rows from two sources, sum 1.0396, rho 0.97", fmt::format("spectral radius {:.4f}: diverges", radius),
           fmt::format("refused; own rows sum to {:.6f} at most", worst), "error with the row's number; slow-light near 1");
}

// Failure 18. A small change per sweep is not a small error: at rho 0.99 a stop at 1e-6 leaves 1e-4.
TEST(SlowConvergence, StopsByABoundOfTheError) {
  const Eigen::MatrixXd f = matrixOf(cubeRows());
  Eigen::VectorXd b = Eigen::VectorXd::Zero(6), e = Eigen::VectorXd::Zero(6);
  e[0] = 1;
  b = e;
  const Eigen::VectorXd exact = (Eigen::MatrixXd::Identity(6, 6) - 0.99 * f).partialPivLu().solve(e);
  for (double change = 1; change > 1e-6 * exact.maxCoeff();) {
    const Eigen::VectorXd next = e + 0.99 * f * b;
    change = (next - b).cwiseAbs().maxCoeff();
    b = next;
  }
  const double naive = (b - exact).cwiseAbs().maxCoeff() / exact.maxCoeff();
  EXPECT_GT(naive, 5e-5);
  double worst = 0;
  for (const SolverKind kind : {SolverKind::jacobi, SolverKind::gaussSeidel}) {
    const GivenSystem given(cubeRows(), std::vector<double>(6, 0.99), {1, 0, 0, 0, 0, 0});
    const Solution s = given.solve(kind, 1e-6);
    for (Eigen::Index i = 0; i < 6; ++i)
      worst = std::max(worst, std::abs(s.radiosity[static_cast<size_t>(i)].r - exact[i]) / exact.maxCoeff());
  }
  EXPECT_LT(worst, 5e-6) << "float32 entries of F alone leave 3e-8 / (1 - 0.99)";
  tabulate(18, "cube of reflectance 0.99, stop at 1e-6", fmt::format("error {:.1g}", naive), fmt::format("error {:.1g}", worst),
           "slow-light from 0.98 on; sweeps, residual, contraction");
}

// Failure 19. One hemicube per face of a box 1 x 2 x 3 sums to 1 in every row and loses half of the energy.
TEST(EnergyDrift, IsSmallAndTold) {
  const TemporaryFolder folder;
  auto box = closedBox({1, 2, 3}, Rgb(0.9));
  box[5].emission = Rgb(1);
  writeText(folder.path("s.gltf"), gltfOf(box).dump());
  const auto balance = [&](const std::string& options, Outcome& o) {
    o = farol("solve " + folder.path("s.gltf") + " --emitters matrix --report " + folder.path("r.json") + " " + options);
    EXPECT_EQ(o.exitCode, 0) << o.err;
    const auto energy = nlohmann::json::parse(readText(folder.path("r.json")))["energy"];
    return energy["absorbed"][0].get<double>() / energy["emitted"][0].get<double>();
  };
  Outcome naive, usual, few;
  const double lost = balance("--patch-size 3 --method raster --resolution 512 --near-field off", naive);
  EXPECT_NEAR(lost, 0.588, 0.02);
  EXPECT_THAT(naive.err, HasSubstr("[energy-drift]"));
  const double kept = balance("--method rays", usual), oneEach = balance("--patch-size 3 --method rays --rays 65536", few);
  EXPECT_NEAR(kept, 1, 0.005);
  EXPECT_NEAR(oneEach, 1, 0.005);
  EXPECT_EQ(usual.err.find("energy-drift"), std::string::npos) << usual.err;
  tabulate(19, "box 1 x 2 x 3, absorbed over emitted power", fmt::format("{:.3f} (one hemicube per face)", lost),
           fmt::format("{:.4f}", kept), "energy-drift");
}

// Repair restores both at once: A_i F_ij = A_j F_ji and the rows' sums, and brings F nearer to the exact one.
TEST(EnergyDrift, IsRepairedWithoutLosingClosure) {
  const TemporaryFolder folder;
  auto box = closedBox({1, 2, 3}, Rgb(0.9));
  box[5].emission = Rgb(1);
  writeText(folder.path("s.gltf"), gltfOf(box).dump());
  const auto rows = [&](const std::string& options) {
    const Outcome o = farol("factors " + folder.path("s.gltf") + " -o " + folder.path("f.csv") + " --report " +
                            folder.path("r.json") + " " + options);
    EXPECT_EQ(o.exitCode, 0) << o.err;
    std::vector<double> f;
    const auto lines = readCsv(folder.path("f.csv"));
    for (size_t i = 1; i < lines.size(); ++i) {
      for (size_t k = 2; k + 2 < lines[i].size(); ++k) f.push_back(std::stod(lines[i][k]));
    }
    return f;
  };
  const auto distance = [](const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (size_t k = 0; k < a.size(); ++k) sum += std::abs(a[k] - b.at(k));
    return sum;
  };
  const auto exact = rows("--method exact --patches 200");
  for (const char* method : {"raster --patch-size 3 --resolution 512 --near-field off", "raster --patches 60 --near-field off",
                             "rays --patches 60 --rays 64"}) {
    const auto naive = rows(std::string("--method ") + method), repaired = rows(std::string("--repair --method ") + method);
    EXPECT_LT(distance(repaired, exact), distance(naive, exact)) << method;
    const auto r = nlohmann::json::parse(readText(folder.path("r.json")));
    EXPECT_LT(r["reciprocity_error"].get<double>(), 1e-6) << method;
    EXPECT_NEAR(r["row_sums"]["max"].get<double>(), 1, 1e-5) << method;
    EXPECT_GE(r["entries"]["min"].get<double>(), 0);
    EXPECT_GT(r["repair"]["mean_l1_change"].get<double>(), 0);
    fmt::print("{}: L1 distance to exact factors {:.4f}, repaired {:.4f}\n", method, distance(naive, exact),
               distance(repaired, exact));
  }
  const auto balance = [&](const std::string& options) {
    const Outcome o = farol("solve " + folder.path("s.gltf") +
                            " --emitters matrix --patch-size 3 --method raster --resolution 512 --near-field off --report " +
                            folder.path("r.json") + " " + options);
    EXPECT_EQ(o.exitCode, 0) << o.err;
    return nlohmann::json::parse(readText(folder.path("r.json")))["energy"]["relative_error"].get<double>();
  };
  EXPECT_GT(balance(""), 0.3);
  EXPECT_LT(balance("--repair"), 1e-4);
  auto mirror = box;
  mirror[0].reflectance = Rgb(0);
  mirror[0].mirror = Rgb(0.5);
  writeText(folder.path("m.gltf"), gltfOf(mirror).dump());
  const Outcome refused = farol("solve " + folder.path("m.gltf") + " --repair --patches 60");
  EXPECT_EQ(refused.exitCode, 1);
  EXPECT_THAT(refused.err, HasSubstr("--repair is for scenes without"));
}

// Failure 25. Nothing to see, nothing that emits, one patch, black surfaces, one channel.
TEST(EmptyScenes, HaveOrderlyAnswers) {
  const std::vector<Vec3> square = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  Outcome o;
  auto b = column({{"dark", {square}}}, "--patch-size 2", kRadiosity, o);
  EXPECT_EQ(o.exitCode, 0) << o.err;
  EXPECT_EQ(b, std::vector<double>{0});
  EXPECT_THAT(o.err, HasSubstr("[no-light]"));
  b = column({{"lamp", {square}, Rgb(0.5), Rgb(3)}}, "--patch-size 2", kRadiosity, o);
  EXPECT_EQ(b, std::vector<double>{3}) << "one flat patch sees nothing of itself";
  auto box = closedBox({1, 1, 1}, Rgb(0));
  box[0].emission = Rgb(2, 0, 0);
  b = column(box, "--patch-size 1", kRadiosity, o);
  EXPECT_EQ(b, (std::vector<double>{2, 0, 0, 0, 0, 0})) << "black: B = E";
  box = closedBox({1, 1, 1}, Rgb(0.5));
  box[0].emission = Rgb(2, 0, 0);
  for (const double green : column(box, "--patches 50", kRadiosity + 1, o)) EXPECT_EQ(green, 0);
  // A lamp outside a closed room.
  box = closedBox({1, 1, 1}, Rgb(0.5));
  box.push_back({"sun", {{{5, 0, 0}, {5, 1, 0}, {5, 1, 1}, {5, 0, 1}}}, Rgb(0), Rgb(100)});
  b = column(box, "--patches 300 --method rays", kRadiosity, o);
  for (size_t k = 0; k + 1 < b.size(); ++k) {
    if (b[k] != 100) {
      EXPECT_EQ(b[k], 0) << "patch " << k;
    }
  }
  tabulate(25, "no emitter, one patch, black room, one channel, a lamp outside", "0/0 in relative measures", "exact zeros",
           "no-light; an empty scene is refused");
}

}  // namespace
}  // namespace farol::test
