#include "model/data/recording_groups.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

namespace maneuver::data::recording_groups_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Returns a recording with a straight lane of `points` points, `length` metres along +x from (x,
// y).
v1::Scenario WithLane(const std::string& id, double x, double y = 0.0, double length = 50.0,
                      int points = 26) {
  v1::Scenario recording;
  recording.set_scenario_id(id);
  v1::MapFeature& lane = *recording.add_map_features();
  lane.set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (int i = 0; i < points; ++i) {
    lane.add_x(x + length * i / (points - 1));
    lane.add_y(y);
  }
  return recording;
}

// Returns a recording of one agent that moves along +x, one position every 0.1 s from `time` on.
v1::Scenario WithAgent(const std::string& id, int64_t agent_id, double x, double speed,
                       double time = 0.0) {
  v1::Scenario recording;
  recording.set_scenario_id(id);
  v1::Agent& agent = *recording.add_agents();
  agent.set_id(agent_id);
  for (int i = 0; i < 50; ++i) {
    v1::AgentState& state = *agent.add_states();
    state.set_time(time + 0.1 * i);
    state.set_x(x + 0.1 * i * speed);
  }
  return recording;
}

std::vector<int> GroupsOf(const std::vector<v1::Scenario>& recordings) {
  RecordingGrouper grouper;
  for (const v1::Scenario& recording : recordings) grouper.Add(recording);
  return grouper.Groups().groups;
}

TEST(RecordingGroupsTest, GroupsPartsOfOneRecording) {
  EXPECT_THAT(GroupsOf({WithLane("a#1", 0), WithLane("b", 1000), WithLane("a#2", 2000),
                        WithLane("a", 3000), WithLane("ab", 4000)}),
              ElementsAre(0, 1, 0, 0, 2));
}

TEST(RecordingGroupsTest, GroupsRecordingsOfOnePlaceWhoseMapsDifferByDecimetres) {
  for (double shift = -0.9; shift < 1.0; shift += 0.1) {
    EXPECT_THAT(GroupsOf({WithLane("a", 7.0), WithLane("b", 7.0 + shift, -shift)}),
                ElementsAre(0, 0))
        << shift;
  }
  EXPECT_THAT(GroupsOf({WithLane("a", 7.0), WithLane("b", 9.5)}), ElementsAre(0, 1));
}

// There are 20 places with 40 long lanes each, which give 640 hashes a place. The grouper keeps at
// most 256 hashes, about ten a place.
TEST(RecordingGroupsTest, FindsLargeOverlapsWithAFewOfTheHashes) {
  RecordingGrouper grouper(256);
  std::vector<int> places;
  for (int pass = 0; pass < 3; ++pass) {
    for (int place = 0; place < 20; ++place) {
      v1::Scenario recording;
      recording.set_scenario_id(std::to_string(pass) + "-" + std::to_string(place));
      for (int lane = 0; lane < 40; ++lane) {
        *recording.add_map_features() = WithLane("", 1000.0 * place, 10.0 * lane).map_features(0);
      }
      grouper.Add(recording);
      places.push_back(place);
    }
  }
  EXPECT_EQ(grouper.Groups().groups, places);
}

// A hundred recordings, of which each two neighbours share one lane: 16 hashes, of some 1,600.
TEST(RecordingGroupsTest, FurtherPassesFindTheLinksByAllHashes) {
  std::vector<v1::Scenario> chain;
  for (int i = 0; i < 100; ++i) {
    chain.push_back(WithLane(std::to_string(i), 1000.0 * i));
    // Every tenth one shares no lane with the one before it.
    const double shared = i % 10 == 0 ? 1000.0 * i + 500.0 : 1000.0 * (i - 1);
    *chain.back().add_map_features() = WithLane("", shared).map_features(0);
  }
  const std::vector<int> expected = GroupsOf(chain);
  EXPECT_THAT(expected, testing::Contains(9));
  RecordingGrouper grouper(32);
  int passes = 0;
  do {
    for (const v1::Scenario& recording : chain) grouper.Add(recording);
    if (passes == 0) {
      EXPECT_NE(grouper.Groups().groups, expected);
    }
    ++passes;
  } while (grouper.NextPass());
  EXPECT_GE(passes, 32);
  EXPECT_EQ(grouper.Groups().groups, expected);
  EXPECT_EQ(grouper.Groups().ids.size(), chain.size());
}

TEST(RecordingGroupsTest, ShortOrMerelyTouchingLanesDoNotGroupRecordings) {
  EXPECT_THAT(GroupsOf({WithLane("a", 0, 0, 15.0), WithLane("b", 0, 0, 15.0)}), ElementsAre(0, 1));
  EXPECT_THAT(GroupsOf({WithLane("a", 0, 0, 50.0), WithLane("b", 0, 0, 60.0)}), ElementsAre(0, 1));
  EXPECT_THAT(GroupsOf({WithLane("a", 0, 0, 50.0, 26), WithLane("b", 0, 0, 50.0, 27)}),
              ElementsAre(0, 1));
  v1::Scenario line = WithLane("b", 0);
  line.mutable_map_features(0)->set_type(v1::MAP_FEATURE_TYPE_ROAD_LINE);
  EXPECT_THAT(GroupsOf({WithLane("a", 0), line}), ElementsAre(0, 1));
}

TEST(RecordingGroupsTest, GroupsWindowsOfOneDriveWhateverTheirClocks) {
  // The second recording begins 1 s later, on a different clock, with the same positions.
  EXPECT_THAT(GroupsOf({WithAgent("a", 7, 0.0, 10.0), WithAgent("b", 7, 10.0, 10.0, 100.0)}),
              ElementsAre(0, 0));
  // Another agent, other positions, and an agent that stands.
  EXPECT_THAT(GroupsOf({WithAgent("a", 7, 0.0, 10.0), WithAgent("b", 8, 0.0, 10.0)}),
              ElementsAre(0, 1));
  EXPECT_THAT(GroupsOf({WithAgent("a", 7, 0.0, 10.0), WithAgent("b", 7, 0.5, 10.0)}),
              ElementsAre(0, 1));
  EXPECT_THAT(GroupsOf({WithAgent("a", 7, 0.0, 0.0), WithAgent("b", 7, 0.0, 0.0)}),
              ElementsAre(0, 1));
}

TEST(RecordingGroupsTest, GroupsRecordingsThatAChainOfLinksJoins) {
  v1::Scenario both = WithLane("c", 1000);
  *both.add_map_features() = WithLane("", 0).map_features(0);
  EXPECT_THAT(GroupsOf({WithLane("a", 0), WithLane("b", 1000), WithLane("d", 5000), both}),
              ElementsAre(0, 0, 1, 0));
}

TEST(RecordingGroupsTest, GroupsBigMapsByTheirLongestFeatures) {
  v1::Scenario first = WithLane("a", 0, 0, 500.0);
  v1::Scenario second = WithLane("b", 0, 0, 500.0);
  for (int i = 0; i < 1000; ++i) {
    *first.add_map_features() = WithLane("", 0, 10.0 * i + 10.0).map_features(0);
    *second.add_map_features() = WithLane("", 0, -10.0 * i - 10.0).map_features(0);
  }
  EXPECT_THAT(GroupsOf({first, second}), ElementsAre(0, 0));
}

// Sixty recordings: one group of ten, five of two, forty of one.
std::vector<v1::Scenario> SixtyRecordings() {
  std::vector<v1::Scenario> recordings;
  for (int i = 0; i < 60; ++i) {
    const int place = i < 10 ? 0 : i < 20 ? i / 2 : i;
    recordings.push_back(WithLane("r" + std::to_string(i), 100.0 * place));
  }
  return recordings;
}

std::map<std::string, int> FoldsOf(const std::vector<v1::Scenario>& recordings, uint64_t seed) {
  RecordingGrouper grouper;
  for (const v1::Scenario& recording : recordings) grouper.Add(recording);
  const RecordingGroups groups = grouper.Groups();
  const auto folds = AssignFolds(groups, 5, seed);
  std::map<std::string, int> result;
  for (size_t i = 0; i < groups.ids.size(); ++i) result[groups.ids[i]] = folds->at(i);
  return result;
}

TEST(AssignFoldsTest, FoldsHaveWholeGroupsAndEqualNumbersOfRecordings) {
  RecordingGrouper grouper;
  for (const v1::Scenario& recording : SixtyRecordings()) grouper.Add(recording);
  const RecordingGroups groups = grouper.Groups();
  EXPECT_EQ(groups.count, 46);
  EXPECT_EQ(groups.LargestGroup(), 10);
  const auto folds = AssignFolds(groups, 5, 1);
  ASSERT_TRUE(folds.ok()) << folds.status();
  std::vector<int> sizes(5);
  std::map<int, int> fold_of_group;
  for (size_t i = 0; i < folds->size(); ++i) {
    ++sizes[folds->at(i)];
    EXPECT_EQ(fold_of_group.try_emplace(groups.groups[i], folds->at(i)).first->second,
              folds->at(i));
  }
  EXPECT_THAT(sizes, testing::Each(12));
}

TEST(AssignFoldsTest, FoldsDoNotDependOnTheOrderOfTheRecordings) {
  std::vector<v1::Scenario> recordings = SixtyRecordings();
  const auto folds = FoldsOf(recordings, 1);
  std::reverse(recordings.begin(), recordings.end());
  EXPECT_EQ(FoldsOf(recordings, 1), folds);
  std::rotate(recordings.begin(), recordings.begin() + 17, recordings.end());
  EXPECT_EQ(FoldsOf(recordings, 1), folds);
  EXPECT_NE(FoldsOf(recordings, 2), folds);
}

TEST(AssignFoldsTest, RefusesFewerGroupsThanFolds) {
  RecordingGrouper grouper;
  for (int i = 0; i < 8; ++i) grouper.Add(WithLane(std::to_string(i), 100.0 * (i % 2)));
  const absl::Status status = AssignFolds(grouper.Groups(), 3, 1).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("8 recordings make 2 groups"));
  EXPECT_EQ(AssignFolds(grouper.Groups(), 1, 1).status().code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace maneuver::data::recording_groups_test
