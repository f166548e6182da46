// The solver on systems small enough for paper: F is given, not computed.
#include "base/error.h"
#include "given_system.h"
#include "solve/gather.h"
#include "solve/system.h"

#include <gtest/gtest.h>
#include <numeric>

namespace farol::test {
namespace {

constexpr SolverKind kSweeping[] = {SolverKind::gaussSeidel, SolverKind::jacobi};
constexpr SolverKind kAll[] = {SolverKind::gaussSeidel, SolverKind::jacobi, SolverKind::conjugateResiduals};

// Two infinite plates: B1 = (E1 + rho1 E2) / (1 - rho1 rho2) (truth case B3).
TEST(Solver, SolvesTwoPlates) {
  const GivenSystem plates({{0, 1}, {1, 0}}, {0.5, 0.8}, {1, 0});
  for (const SolverKind kind : kAll) {
    const Solution s = plates.solve(kind);
    EXPECT_TRUE(s.converged);
    EXPECT_NEAR(s.radiosity[0].r, 1 / 0.6, 1e-9);
    EXPECT_NEAR(s.radiosity[1].r, 0.8 / 0.6, 1e-9);
    EXPECT_EQ(s.radiosity[0].g, 0.0);  // a channel without light stays exactly 0
    EXPECT_NEAR(s.radiosity[0].b, 2 / 0.6, 1e-9);
    EXPECT_NEAR(s.irradiance[0].r, 0.8 / 0.6, 1e-9);
  }
}

// The estimate of the contraction: sqrt(rho1 rho2) = 0.632456 is the Jacobi radius of two plates (failures, 18).
TEST(Solver, EstimatesTheContraction) {
  const GivenSystem cube({{0, .2, .2, .2, .2, .2},
                          {.2, 0, .2, .2, .2, .2},
                          {.2, .2, 0, .2, .2, .2},
                          {.2, .2, .2, 0, .2, .2},
                          {.2, .2, .2, .2, 0, .2},
                          {.2, .2, .2, .2, .2, 0}},
                         std::vector<double>(6, 0.9), {1, 1, 1, 1, 1, 0});
  for (const SolverKind kind : {SolverKind::jacobi, SolverKind::conjugateResiduals})
    EXPECT_NEAR(cube.solve(kind).contraction, 0.9, 0.01);
}

// Gauss-Seidel needs about half the sweeps of Jacobi (failures, 18).
TEST(Solver, GaussSeidelHalvesTheSweeps) {
  const GivenSystem plates({{0, 1}, {1, 0}}, {0.9, 0.9}, {1, 0});
  const Solution jacobi = plates.solve(SolverKind::jacobi), seidel = plates.solve(SolverKind::gaussSeidel);
  EXPECT_NEAR(static_cast<double>(seidel.sweeps) / static_cast<double>(jacobi.sweeps), 0.5, 0.15);
}

// Some sweeps of both methods against the plain loops of a textbook, on a system of several blocks with black patches
// and, in all but the first, short lists among the dense rows: of entries or of hits.
TEST(Solver, SweepsAsTheTextbookDoes) {
  constexpr uint32_t n = 333;
  std::vector<double> rho, emission;
  for (uint32_t i = 0; i < n; ++i) {
    rho.push_back(i % 7 == 0 ? 0 : 0.3 + 0.6 * unitFromBits(mixBits(i)));
    emission.push_back(i % 50 == 0 ? 1 : 0);
  }
  enum class Lists { none, entries, hits };
  for (const Lists lists : {Lists::none, Lists::entries, Lists::hits}) {
    std::vector<std::vector<double>> rows(n, std::vector<double>(n));
    GivenSystem given(rows, rho, emission);
    for (uint32_t i = 0; i < n; ++i) {
      std::vector<uint32_t> ids, hits;
      std::vector<float> values;
      const bool list = lists != Lists::none && i % 5 == 0;
      for (uint32_t j = 0; j < n; ++j) {
        if (list && j % 9 != i % 9) continue;
        ids.push_back(j);
        values.push_back(static_cast<float>(unitFromBits(mixBits(i * n + j)) * (list ? 18.0 : 2.0) / n));
        rows[i][j] = static_cast<double>(values.back());
        hits.insert(hits.begin(), 1 + j % 2, j);
      }
      if (!list) {
        std::copy(values.begin(), values.end(), given.replaced.row(i).begin());
      } else if (lists == Lists::entries) {
        given.replaced.entries(i, ids, values);
      } else {
        const float weight = 1.0f / static_cast<float>(hits.size());
        given.replaced.hits(i, hits, weight);
        for (const uint32_t j : ids)
          rows[i][j] = static_cast<double>(weight) * static_cast<double>(std::count(hits.begin(), hits.end(), j));
      }
      given.replaced.finish(i, {});
    }
    const FormFactorRow first = given.replaced[0];
    ASSERT_EQ(first.dense.empty(), lists != Lists::none);
    ASSERT_EQ(first.values.empty(), lists != Lists::entries);
    given.f = given.replaced;
    constexpr size_t kSweeps = 3;
    for (const SolverKind kind : kSweeping) {
      std::vector<double> b = emission;  // red
      for (size_t sweep = 0; sweep < kSweeps; ++sweep) {
        const std::vector<double> before = b;
        for (uint32_t i = 0; i < n; ++i) {
          double h = 0;
          for (uint32_t j = 0; j < n; ++j) h += rows[i][j] * (kind == SolverKind::jacobi ? before : b)[j];
          b[i] = emission[i] + rho[i] * h;
        }
      }
      const Solution s = given.solve(kind, 1e-14, kSweeps);
      EXPECT_EQ(s.sweeps, kSweeps);
      for (uint32_t i = 0; i < n; ++i)
        EXPECT_NEAR(s.radiosity[i].r, b[i], 1e-13 * (1 + b[i])) << i << ", lists: " << static_cast<int>(lists);
    }
  }
}

// The reported error bounds the true one, also where a small change per sweep is not a small error.
TEST(Solver, StopsWhenTheErrorIsSmallNotTheChange) {
  const GivenSystem plates({{0, 1}, {1, 0}}, {0.999, 0.999}, {1, 0});
  for (const SolverKind kind : kAll) {
    const Solution s = plates.solve(kind, 1e-5);
    const double exact = 0.999 / (1 - 0.999 * 0.999);
    EXPECT_TRUE(s.converged);
    EXPECT_NEAR(s.radiosity[1].r, exact, 1.2e-5 * exact);
  }
}

// A chain of patches along which light goes from one to the next, and out at both ends.
GivenSystem chain(size_t n, double rho) {
  std::vector<double> emission(n);
  std::vector<std::vector<double>> rows(n, std::vector<double>(n));
  emission[0] = 1;
  for (size_t i = 0; i + 1 < n; ++i) rows[i][i + 1] = rows[i + 1][i] = 0.5;
  return {rows, std::vector<double>(n, rho), emission};
}

// Light that fades slowly is little work for conjugate residuals, which see how slowly: by rho cos(pi / (n + 1)).
TEST(Solver, ConjugateResidualsTakeFewSweeps) {
  const GivenSystem given = chain(40, 0.999);
  const Solution few = given.solve(SolverKind::conjugateResiduals), many = given.solve(SolverKind::gaussSeidel);
  EXPECT_LT(10 * few.sweeps, many.sweeps);
  EXPECT_NEAR(few.contraction, 0.999 * std::cos(kPi / 41), 1e-5);
  for (size_t i = 0; i < 40; ++i) {
    EXPECT_EQ(few.radiosity[i].g, 0.0);
    for (const int c : {0, 2}) EXPECT_NEAR(few.radiosity[i][c], many.radiosity[i][c], 1e-9 * many.radiosity[0].b);
  }
}

TEST(Solver, ReportsThatItDidNotConverge) {
  const GivenSystem given = chain(40, 0.999);
  for (const SolverKind kind : kAll) {
    const Solution s = given.solve(kind, 1e-9, 5);
    EXPECT_FALSE(s.converged);
    EXPECT_EQ(s.sweeps, 5u);
    EXPECT_GT(s.error, 1e-9);
    EXPECT_EQ(s.history.size(), 6u);  // the first residual, then one of each sweep
    for (size_t most = 1; most < 60; ++most) EXPECT_LE(given.solve(kind, 1e-17, most).sweeps, most);
  }
}

TEST(Solver, RefusesLightThatIsNeverAbsorbed) {
  const GivenSystem closed({{0, 1}, {1, 0}}, {1, 1}, {1, 0});
  EXPECT_THROW(closed.solve(SolverKind::gaussSeidel), Error);
  // One absorber is enough, and so is an opening.
  EXPECT_TRUE(GivenSystem({{0, 1}, {1, 0}}, {1, 0.5}, {1, 0}).solve(SolverKind::gaussSeidel).converged);
  EXPECT_TRUE(GivenSystem({{0, 0.5}, {0.5, 0}}, {1, 1}, {1, 0}).solve(SolverKind::gaussSeidel).converged);
}

TEST(Solver, RefusesADivergingSystem) {
  // Rows of 1.2 with rho 0.97, which no physical F has: the solution would grow without bound.
  EXPECT_THROW(GivenSystem({{0, 1.2}, {1.2, 0}}, {0.97, 0.97}, {1, 0}).solve(SolverKind::jacobi), Error);
}

// Failure 17: a row sum of 1.0396 with rho 0.97 grows by 0.8 % per sweep, seen after 8 sweeps; the row is named.
TEST(Solver, RefusesASlowlyDivergingSystemEarly) {
  for (const SolverKind kind : kAll) {
    try {
      GivenSystem({{0, 1.0396}, {1.0396, 0}}, {0.97, 0.97}, {1, 0}).solve(kind);
      ADD_FAILURE() << "not refused";
    } catch (const Error& e) {
      const std::string text = e.what();
      const char* when = kind == SolverKind::conjugateResiduals ? "sweeps a sweep multiplies" : "after 8 sweeps a sweep multiplies";
      EXPECT_NE(text.find(when), std::string::npos) << text;
      EXPECT_NE(text.find("the residual by 1.0084"), std::string::npos) << text;
      EXPECT_NE(text.find("reflectance times row sum reaches 1.008412 in row 0"), std::string::npos) << text;
    }
  }
  // One such row among absorbing ones is no harm.
  EXPECT_TRUE(GivenSystem({{0, 1.0396}, {0.5, 0}}, {0.97, 0.97}, {1, 0}).solve(SolverKind::jacobi).converged);
}

// Grey patches in light of one colour are solved in one channel; a little colour on one of them takes three, and changes little.
TEST(Solver, SolvesGreyScenesInOneChannel) {
  for (const Storage storage : {Storage::float32, Storage::bits16}) {
    GivenSystem grey = randomSystem(150, 0.7), tinted = grey;
    for (GivenSystem* given : {&grey, &tinted}) {
      FormFactorMatrix f(150, UINT64_MAX, storage);
      for (uint32_t i = 0; i < 150; ++i) {
        const std::vector<float> row = given->f[i].expanded();
        std::copy(row.begin(), row.end(), f.row(i).begin());
        if (i % 3 == 0) std::fill(f.row(i).begin() + 40, f.row(i).end(), 0.0f);  // a list
        f.finish(i, given->f.shares(i));
      }
      given->f = f;
      for (Patch& p : given->patches.patches) {
        p.reflectance = Rgb(p.reflectance.r);
        p.emission = p.emission.r * Rgb(0.3, 1, 0.7);
      }
    }
    tinted.patches.patches[3].reflectance.g += 1e-9;
    for (const SolverKind kind : kAll) {
      const Solution one = grey.solve(kind), three = tinted.solve(kind);
      EXPECT_EQ(one.channels, 1);
      EXPECT_EQ(three.channels, 3);
      EXPECT_NEAR(one.contraction, three.contraction, 1e-3);
      for (size_t i = 0; i < 150; ++i) {
        for (int c = 0; c < 3; ++c) {
          EXPECT_NEAR(one.radiosity[i][c], three.radiosity[i][c], 1e-8);
          EXPECT_NEAR(one.irradiance[i][c], three.irradiance[i][c], 1e-8);
        }
      }
    }
  }
}

// Patches a thousand times larger than others: only in the weights area / rho, in which rho F is self-adjoint, are eight
// directions as good as all of them.
TEST(Solver, ConjugateResidualsWeighPatches) {
  GivenSystem given = chain(60, 0.99);
  for (uint32_t i = 0; i < 60; ++i) given.patches.patches[i].area = std::pow(10.0, 3 * unitFromBits(mixBits(i)));
  FormFactorMatrix f(60);
  for (uint32_t i = 0; i < 60; ++i) {  // A_i F_ij is half of the smaller area
    const auto row = f.row(i);
    std::fill(row.begin(), row.end(), 0.0f);
    for (const uint32_t j : {i - 1, i + 1}) {
      const double own = given.patches.patches[i].area;
      if (j < 60) row[j] = static_cast<float>(0.5 * std::min(own, given.patches.patches[j].area) / own);
    }
    row[i] = static_cast<float>(1 - std::accumulate(row.begin(), row.end(), 0.0));  // what is left stays
    f.finish(i, {});
  }
  given.f = f;
  const Solution few = given.solve(SolverKind::conjugateResiduals), many = given.solve(SolverKind::gaussSeidel);
  EXPECT_LE(few.sweeps, 100u);
  EXPECT_NEAR(few.contraction, 0.99, 1e-4);
  for (size_t i = 0; i < 60; ++i) EXPECT_NEAR(few.radiosity[i].r, many.radiosity[i].r, 1e-8 * many.radiosity[0].r);
}

// Pairs of patches that see only each other, more than are summed together. As many sweeps as there are eigenvalues, plus and minus
// each of four reflectances, are enough where every row counts in the choice of steps; of the first 2,048 all are alike.
TEST(Solver, ConjugateResidualsLookAtAllRows) {
  constexpr uint32_t n = 5000;
  std::vector<double> rho(n), emission(n);
  for (uint32_t i = 0; i < n; ++i) {
    rho[i] = i < 2048 ? 0.1 : std::array{0.5, 0.8, 0.95}[i / 2 % 3];
    emission[i] = 1 + i % 2;
  }
  GivenSystem given(std::vector<std::vector<double>>(n, std::vector<double>()), rho, emission);
  for (uint32_t i = 0; i < n; ++i) {
    given.f.entries(i, std::vector<uint32_t>{i ^ 1u}, std::vector<float>{1.0f});
    given.f.finish(i, {});
  }
  const Solution solution = given.solve(SolverKind::conjugateResiduals, 1e-8);
  EXPECT_LE(solution.sweeps, 10u);
  EXPECT_NEAR(solution.contraction, 0.95, 1e-5);
  for (uint32_t i = 0; i < n; ++i) {
    const double exact = (emission[i] + rho[i] * emission[i ^ 1u]) / (1 - rho[i] * rho[i]);
    ASSERT_NEAR(solution.radiosity[i].r, exact, 1e-6 * exact) << i;
  }
}

// Rows that are nowhere near reciprocal: no norm is left in which conjugate residuals are sure to get on.
TEST(Solver, SolvesWhatIsNotReciprocal) {
  GivenSystem given = chain(60, 0.99);
  for (uint32_t i = 0; i < 60; ++i) given.patches.patches[i].area = std::pow(10.0, 3 * unitFromBits(mixBits(i)));
  const Solution found = given.solve(SolverKind::conjugateResiduals, 1e-8), known = given.solve(SolverKind::gaussSeidel, 1e-10);
  EXPECT_TRUE(found.converged);
  EXPECT_EQ(found.kind, SolverKind::gaussSeidel);
  EXPECT_LT(found.sweeps, known.sweeps + 100);
  for (size_t i = 0; i < 60; ++i) EXPECT_NEAR(found.radiosity[i].r, known.radiosity[i].r, 1e-7 * known.radiosity[0].r);
}

// A spectral radius of 1.028 is refused by whatever solver; a row that sums to 1.04 among others is not: its chain has one of
// 0.99 x 0.52 / sqrt(0.52 - 0.25) = 0.991.
TEST(Solver, TellsGrowingLightFromOneRowTooLarge) {
  GivenSystem given = chain(60, 0.99);
  const auto lift = [&](uint32_t i, float value) {
    const auto row = given.f.row(i);
    for (const uint32_t j : {i - 1, i + 1}) {
      if (j < 60) row[j] = value;
    }
    given.f.finish(i, {});
  };
  lift(10, 0.52f);
  for (const SolverKind kind : kAll) {
    const Solution s = given.solve(kind, 1e-8);
    EXPECT_TRUE(s.converged);
    EXPECT_NEAR(s.radiosity[10].r, 0.52 * 0.99 * (s.radiosity[9].r + s.radiosity[11].r), 1e-7);
  }
  // Areas that make these rows anything but reciprocal: norms may grow, light does not, and nothing is refused.
  GivenSystem unequal = given;
  for (uint32_t i = 0; i < 60; ++i) unequal.patches.patches[i].area = std::pow(10.0, 3 * unitFromBits(mixBits(i)));
  for (const SolverKind kind : kAll) EXPECT_NO_THROW(unequal.solve(kind, 1e-8, 4000));
  for (uint32_t i = 0; i < 60; ++i) lift(i, 0.52f);
  for (const SolverKind kind : kAll) EXPECT_THROW(given.solve(kind, 1e-8), Error);
}

// Grey patches and two lamps of different colours, if only by a thousandth, are no matter of one channel.
TEST(Solver, KeepsTheColoursOfTwoLamps) {
  GivenSystem given({{0, 0.5, 0.5}, {0.5, 0, 0.5}, {0.5, 0.5, 0}}, {0, 0, 0.5}, {1, 1, 0});
  given.patches.patches[0].emission = Rgb(1, 0, 0.5);
  given.patches.patches[1].emission = Rgb(1, 1e-3, 0.5);
  for (const SolverKind kind : kAll) {
    const Solution s = given.solve(kind);
    EXPECT_EQ(s.channels, 3);
    EXPECT_NEAR(s.radiosity[2].g, 0.5 * 0.5 * 1e-3, 1e-12);
    EXPECT_NEAR(s.irradiance[0].g, 0.5 * (s.radiosity[2].g + 1e-3), 1e-12);
    EXPECT_NEAR(s.irradiance[1].g, 0.5 * s.radiosity[2].g, 1e-12);
  }
}

// Channels that are alike are kept once, and no longer.
TEST(Field, NoticesWhatIsAlike) {
  const GivenSystem given({{0.1, 0.2, 0.3}, {0, 0, 0.5}, {0.5, 0.5, 0}}, {0.5, 0.5, 0.5}, {1, 0, 0});
  const System system(given.f, given.patches, {}, Rgb(0));
  Field b(Channels::Ones(3, 3));
  EXPECT_TRUE(b.alike());
  EXPECT_NEAR(system.gather(0, b)[1], 0.6, 1e-7);
  b.set(2, {1, 2, 3});
  EXPECT_FALSE(b.alike());
  EXPECT_NEAR(system.gather(0, b)[1], 0.9, 1e-7);
  EXPECT_NEAR(system.gather(0, b)[2], 1.2, 1e-7);
  Channels back = Channels::Zero(3, 3);
  back.row(2) = Eigen::RowVector3d(0, -1, -2);
  b.add(back);
  EXPECT_TRUE(b.alike());
}

// In floats sums are good to 1e-7 of what is added up, for all kinds of rows, in three channels and in one, and however small or
// large the values are. Rows are so long that floats alone would not do.
TEST(Field, ReadsFloatsAsWellAsItSays) {
  constexpr uint32_t n = 20003;
  constexpr size_t kRows = kRowsAtOnce - 1;  // groups of eight, of two and one by itself
  for (const Storage storage : {Storage::float32, Storage::bits16}) {
    FormFactorMatrix f(n, UINT64_MAX, storage);
    std::vector<size_t> all(kRows);
    std::iota(all.begin(), all.end(), size_t{0});
    for (uint32_t i = 0; i < kRows; ++i) {
      std::vector<uint32_t> ids;
      for (uint32_t j = 0; j < n; ++j) {
        if (i < 11 || mixBits(i * n + j) % 9 == 0) ids.push_back(j);
      }
      if (i == 11) {
        f.hits(i, ids, 1.0f / n);
      } else {
        std::vector<float> row(n, 0.0f);
        for (const uint32_t j : ids) row[j] = static_cast<float>(unitFromBits(mixBits(i + j)) / n);
        std::copy(row.begin(), row.end(), f.row(i).begin());
      }
      f.finish(i, {});
    }
    ASSERT_TRUE(f[0].ids.size() < n / 3 && !f[11].ids.empty() && !f[12].values.empty()) << "all kinds of rows";
    for (const double size : {1e-60, 1.0, 1e60}) {
      for (const bool alike : {false, true}) {
        Channels values(n, 3);
        for (Eigen::Index i = 0; i < n; ++i) {
          for (Eigen::Index c = 0; c < 3; ++c)
            values(i, c) = size * (unitFromBits(mixBits(static_cast<uint64_t>(3 * i + (alike ? 0 : c)))) - 0.1);
        }
        std::array<Eigen::RowVector3d, kRowsAtOnce> exact, rough;
        gather(f, all, Field(values), exact.data());
        gather(f, all, Field(values, Reading::inFloat), rough.data());
        bool differs = false;
        for (size_t i = 0; i < kRows; ++i) {
          Eigen::RowVector3d sum = Eigen::RowVector3d::Zero(), most = sum;
          f[i].forEach([&](size_t j, double value) {
            sum += value * values.row(static_cast<Eigen::Index>(j));
            most += value * values.row(static_cast<Eigen::Index>(j)).cwiseAbs();
          });
          for (Eigen::Index c = 0; c < 3; ++c) {
            EXPECT_NEAR(exact[i][c], sum[c], 1e-12 * most[c]) << "row " << i;
            EXPECT_NEAR(rough[i][c], sum[c], 1e-7 * most[c]) << "row " << i;
          }
          differs |= exact[i] != rough[i];
        }
        EXPECT_TRUE(differs) << "the floats were not read";
      }
    }
  }
}

// What converged is told after one more sweep: B = E + rho H to the last bit.
TEST(Solver, TellsRadiosityOfItsIrradiance) {
  const GivenSystem given = chain(60, 0.9);
  for (const SolverKind kind : kAll) {
    const Solution s = given.solve(kind, 1e-3);
    ASSERT_TRUE(s.converged);
    for (size_t i = 0; i < 60; ++i) {
      const Patch& p = given.patches.patches[i];
      EXPECT_EQ(s.radiosity[i].r, p.emission.r + p.reflectance.r * s.irradiance[i].r) << i;
    }
  }
}

TEST(Solver, LeavesBlackPatchesAsTheyAre) {
  const GivenSystem s({{0, 1}, {1, 0}}, {0, 0.5}, {3, 0});
  const Solution r = s.solve(SolverKind::gaussSeidel);
  EXPECT_EQ(r.radiosity[0].r, 3.0);
  EXPECT_NEAR(r.irradiance[0].r, 1.5, 1e-12);  // told all the same
}

TEST(Solver, TakesTheSkyFromWhatRowsMiss) {
  GivenSystem s({{0, 0.25}, {0.25, 0}}, {0.5, 0.5}, {0, 0});
  SolveOptions o;
  o.sky = Rgb(8, 0, 0);
  const Solution r = solveRadiosity(s.f, s.patches, {}, s.scene, o, Log(true));
  // H = 0.25 B + 0.75 * 8, B = 0.5 H.
  EXPECT_NEAR(r.irradiance[0].r, 6 / (1 - 0.125), 1e-4);
}

TEST(EnergyBalance, ClosesForAReciprocalSystem) {
  const GivenSystem s({{0, 0.5}, {0.5, 0}}, {0.5, 0.8}, {1, 0});
  const Solution r = s.solve(SolverKind::gaussSeidel, 1e-12);
  EXPECT_LT(energyBalance(s.f, s.patches, r, Rgb(0)).relativeError, 1e-9);
}

// A point source seen from a small patch right below it: H = E A / (pi r^2).
TEST(LocalIllumination, IsLambertsLawBetweenCentres) {
  PatchSet set;
  Patch lamp, floor;
  lamp.centre = {0, 0, 2};
  lamp.normal = {0, 0, -1};
  lamp.area = 0.5;
  lamp.emission = Rgb(10);
  floor.centre = {0, 0, 0};
  floor.normal = {0, 0, 1};
  floor.area = 1;
  floor.reflectance = Rgb(0.3);
  set.patches = {lamp, floor};
  const Solution s = localIllumination(set, {}, Rgb(0));
  EXPECT_NEAR(s.irradiance[1].r, 10 * 0.5 / (kPi * 4), 1e-12);
  EXPECT_NEAR(s.radiosity[1].r, 0.3 * 10 * 0.5 / (kPi * 4), 1e-12);
  EXPECT_EQ(s.irradiance[0].r, 0.0);
}

}  // namespace
}  // namespace farol::test
