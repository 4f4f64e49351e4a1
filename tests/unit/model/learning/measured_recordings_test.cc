#include "model/learning/measured_recordings.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <string>
#include <vector>

namespace maneuver::learning::measured_recordings_test {
namespace {

// As many recordings of one dataset after those of the other, with 30 examples each.
ExampleSet TwoDatasets(int recordings_of_each) {
  ExampleSet set;
  for (int i = 0; i < 2 * recordings_of_each; ++i) {
    const std::string dataset = i < recordings_of_each ? "city-" : "highway-";
    set.recordings.emplace_back().set_scenario_id(dataset + std::to_string(i));
    for (int k = 0; k < 30; ++k) set.examples.emplace_back().recording = i;
  }
  return set;
}

TEST(ChooseRecordingsTest, TakesSomeOfEachDataset) {
  const MeasuredRecordings chosen = ChooseRecordings(TwoDatasets(200), 1200);
  EXPECT_EQ(chosen.examples, 1200);
  ASSERT_EQ(chosen.indices.size(), 40u);
  EXPECT_TRUE(std::ranges::is_sorted(chosen.indices));
  // Of 40 that are drawn by chance, 20 give or take 3 are of the first dataset.
  EXPECT_NEAR(
      static_cast<double>(std::ranges::count_if(chosen.indices, [](size_t i) { return i < 200; })),
      20.0, 10.0);
}

TEST(ChooseRecordingsTest, TakesAllIfTheyAreFew) {
  const MeasuredRecordings chosen = ChooseRecordings(TwoDatasets(5), 1200);
  std::vector<size_t> all(10);
  std::iota(all.begin(), all.end(), size_t{0});
  EXPECT_EQ(chosen.indices, all);
  EXPECT_EQ(chosen.examples, 300);
}

TEST(ChooseRecordingsTest, DoesNotDependOnTheOrder) {
  const ExampleSet set = TwoDatasets(200);
  ExampleSet reversed = set;
  std::ranges::reverse(reversed.recordings);
  std::vector<size_t> mirrored = ChooseRecordings(reversed, 1200).indices;
  for (size_t& index : mirrored) index = set.recordings.size() - 1 - index;
  std::ranges::reverse(mirrored);
  EXPECT_EQ(ChooseRecordings(set, 1200).indices, mirrored);
}

}  // namespace
}  // namespace maneuver::learning::measured_recordings_test
