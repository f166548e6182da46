#include "chart/chart.h"

#include "chart/schedule.h"

#include <cmath>
#include <gtest/gtest.h>

namespace farol::test {
namespace {

ChartPoint point(const char* series, double seconds, double error, double noise = 0) {
  ChartPoint p;
  p.series = series;
  p.seconds = seconds;
  p.error = error;
  p.noise = noise;
  return p;
}

TEST(Chart, FrontIsWhatNothingBeats) {
  std::vector<ChartPoint> points = {point("a", 1, 0.1),         point("b", 2, 0.2),   point("a", 2, 0.05),
                                    point("b", 3, 0.05),        point("b", 0.5, 0.3), point("a", 9, 0.001, 0.01),
                                    point("b", 10, 0.002, 0.01)};
  markFront(points);
  const bool expected[] = {true, false, true, false, true, true, false};  // the last: no better than the reference can tell
  for (size_t k = 0; k < points.size(); ++k) EXPECT_EQ(points[k].onFront, expected[k]) << k;
}

// Two methods of one kind that takes a hundred times what is guessed, and one of another that takes what is guessed: after the
// first of the slow kind the other comes before it, as long as it is cheaper. Half a second of a setting does not sample, and five
// of the slow kind.
TEST(Schedule, MeasuresTheCheapestFirst) {
  Schedule schedule;
  schedule.add(0, 1.0, {1, 2, 4, 100});
  schedule.add(1, 0.5, {1, 10});
  schedule.add(1, 0.6, {1, 10});
  const double seconds[3][4] = {{1, 1.5, 2.5, 50.5}, {50, 455}, {60, 555}};
  std::vector<std::pair<size_t, size_t>> order;
  while (const auto next = schedule.next()) {
    const double took = seconds[next->queue][next->setting], fixed = next->queue == 0 ? 0.5 : 5;
    const bool guessed = order.empty();
    EXPECT_NEAR(next->seconds, guessed ? 0.5 : took, 1e-9) << next->queue << " " << next->setting;
    order.emplace_back(next->queue, next->setting);
    schedule.took(took, took - fixed);
  }
  EXPECT_EQ(order, (std::vector<std::pair<size_t, size_t>>{{1, 0}, {0, 0}, {0, 1}, {0, 2}, {0, 3}, {2, 0}, {1, 1}, {2, 1}}));
}

TEST(Chart, LawsAreFittedWhereRowsAreSampled) {
  std::vector<ChartPoint> points;
  for (const double s : {0.01, 0.1, 1.0, 4.0, 16.0, 64.0}) {
    ChartPoint p = point("rays", 1, 0.1);
    p.samplesPerPatch = s;
    p.rowError = s < 1 ? 2 : 0.4 * std::pow(s, -0.6);
    points.push_back(p);
  }
  points.push_back(point("closed forms", 1, 0.1));
  const std::vector<ErrorLaw> laws = fitLaws(points);
  ASSERT_EQ(laws.size(), 1u);
  EXPECT_EQ(laws[0].points, 4u);
  EXPECT_NEAR(laws[0].constant, 0.4, 1e-9);
  EXPECT_NEAR(laws[0].exponent, 0.6, 1e-9);
}

}  // namespace
}  // namespace farol::test
