#include "model/learning/epoch_windows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

namespace maneuver::learning::epoch_windows_test {
namespace {

// 40 recordings of 5 to 14 examples and 100 bytes, the first ten of folder 0.
std::vector<UnreadRecording> Recordings() {
  std::vector<UnreadRecording> recordings;
  for (int i = 0; i < 40; ++i) {
    recordings.push_back({i < 10 ? 0 : 1, static_cast<size_t>(i), 5 + i % 10, 100});
  }
  return recordings;
}

int64_t Examples(const EpochWindow& window, const std::vector<UnreadRecording>& recordings) {
  int64_t examples = 0;
  for (const size_t i : window.recordings) examples += recordings[i].examples;
  return examples;
}

std::vector<size_t> Order(const std::vector<EpochWindow>& windows) {
  std::vector<size_t> order;
  for (const EpochWindow& window : windows) {
    order.insert(order.end(), window.recordings.begin(), window.recordings.end());
  }
  return order;
}

TEST(PlanWindowsTest, HasExactlyTheStepsOfTheEpochAndStaysWithinItsBytes) {
  const std::vector<UnreadRecording> recordings = Recordings();
  for (const int64_t steps : {1, 7, 47, 200}) {
    int64_t next = 0;
    for (const EpochWindow& window : PlanWindows(recordings, {}, {steps, 8, 500}, 1, 0)) {
      EXPECT_EQ(window.first_step, next);
      EXPECT_GE(window.steps, 1);
      EXPECT_LE(window.steps * 8, Examples(window, recordings));
      EXPECT_LE(window.recordings.size(), 5u);  // of 100 bytes each
      next += window.steps;
    }
    EXPECT_EQ(next, steps);
  }
}

TEST(PlanWindowsTest, TakesEachRecordingOnceBeforeAnyOfThemAgain) {
  const std::vector<size_t> order = Order(PlanWindows(Recordings(), {}, {120, 8, 500}, 1, 0));
  ASSERT_GT(order.size(), 80u);
  for (const size_t turn : {0, 40}) {
    const auto begin = order.begin() + static_cast<std::ptrdiff_t>(turn);
    EXPECT_EQ(std::set<size_t>(begin, begin + 40).size(), 40u);
  }
  EXPECT_FALSE(std::equal(order.begin(), order.begin() + 40, order.begin() + 40));
}

TEST(PlanWindowsTest, DependsOnSeedAndEpochAlone) {
  const auto plan = [](uint64_t seed, int epoch) {
    return Order(PlanWindows(Recordings(), {}, {30, 8, 500}, seed, epoch));
  };
  EXPECT_EQ(plan(1, 3), plan(1, 3));
  EXPECT_NE(plan(1, 3), plan(1, 4));
  EXPECT_NE(plan(1, 3), plan(2, 3));
  EXPECT_NE(plan(1, 2), plan(2, 1));
}

TEST(PlanWindowsTest, TakesTheExamplesOfEachFolderByItsWeight) {
  const std::vector<UnreadRecording> recordings = Recordings();
  const std::vector<double> weights = {3.0, 1.0};
  std::map<int, int64_t> taken;
  for (const EpochWindow& window : PlanWindows(recordings, weights, {300, 8, 900}, 1, 0)) {
    for (const size_t i : window.recordings) taken[recordings[i].folder] += recordings[i].examples;
    // Every window is a mixture.
    if (window.recordings.size() < 8) continue;
    EXPECT_GT(std::ranges::count_if(window.recordings, [](size_t i) { return i < 10; }), 3);
    EXPECT_GT(std::ranges::count_if(window.recordings, [](size_t i) { return i >= 10; }), 0);
  }
  EXPECT_NEAR(static_cast<double>(taken[0]) / static_cast<double>(taken[1]), 3.0, 0.1);
}

TEST(PlanWindowsTest, AWindowHasABatchHoweverLargeItsRecordingsAre) {
  const auto windows = PlanWindows(Recordings(), {}, {20, 32, 1}, 1, 0);
  for (const EpochWindow& window : windows) {
    EXPECT_GE(Examples(window, Recordings()), 32);
    EXPECT_LE(Examples(window, Recordings()), 32 + 14);
  }
}

}  // namespace
}  // namespace maneuver::learning::epoch_windows_test
