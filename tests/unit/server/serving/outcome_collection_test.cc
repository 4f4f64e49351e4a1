#include "server/serving/outcome_collection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "model/files/digest.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::serving::outcome_collection_test {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kBlock = 4096;

// An outcome whose file takes one block.
CollectedOutcome Outcome(int number, double surprise) {
  CollectedOutcome outcome{.recording = {}, .surprise = surprise};
  outcome.recording.set_scenario_id("drive-" + std::to_string(number));
  outcome.recording.set_prediction_time(60.0);
  v1::Agent& agent = *outcome.recording.add_agents();
  agent.set_id(1);
  agent.set_type(v1::AGENT_TYPE_VEHICLE);
  agent.set_length(4.0);
  agent.set_width(2.0);
  for (int i = 0; i < 3; ++i) agent.add_states()->set_time(59.0 + i);
  return outcome;
}

std::string Digest(const CollectedOutcome& outcome) {
  return files::Sha256Hex(outcome.recording.SerializeAsString()).substr(0, 32);
}

class OutcomeCollectionTest : public ::testing::Test {
 protected:
  std::unique_ptr<OutcomeCollection> Open(int64_t blocks = 20) {
    auto opened = OutcomeCollection::Open(folder_ / "outcomes", blocks * kBlock,
                                          monitoring::MetricRegistry::Null());
    EXPECT_TRUE(opened.ok()) << opened.status();
    return *std::move(opened);
  }
  std::set<std::string> Files() const {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_ / "outcomes")) {
      names.insert(entry.path().filename().string());
    }
    return names;
  }
  // The recordings of a dataset that is made of the collection.
  std::multiset<std::string> Recordings(const OutcomeCollection& collection,
                                        OutcomeCollection::Written* written = nullptr) {
    const fs::path dataset = folder_ / ("dataset" + std::to_string(++datasets_));
    auto writer = data::DatasetWriter::Create(dataset, "test");
    auto made = collection.Write(**writer);
    EXPECT_TRUE(made.ok()) << made.status();
    if (written != nullptr) *written = *made;
    EXPECT_TRUE((*writer)->Commit().ok());
    std::multiset<std::string> ids;
    EXPECT_TRUE(data::ForEachScenario(dataset, data::OnDamage::kStop, [&](v1::Scenario&& scenario) {
                  ids.insert(scenario.scenario_id());
                  return true;
                }).ok());
    return ids;
  }

  const TemporaryFolder folder_;
  int datasets_ = 0;
};

TEST_F(OutcomeCollectionTest, KeepsTheMostSurprisingAndThoseWithTheSmallestDigests) {
  const auto collection = Open();
  std::vector<CollectedOutcome> all;
  for (int i = 0; i < 200; ++i) all.push_back(Outcome(i, i % 67 + 0.001 * i));
  std::vector<CollectedOutcome> shuffled = all;
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(3));
  for (const CollectedOutcome& outcome : shuffled) {
    ASSERT_TRUE(collection->Add({outcome}).ok());
    ASSERT_LE(collection->bytes(), 20 * kBlock);
    ASSERT_LE(Files().size(), 20u);
  }
  std::ranges::sort(all, {}, [](const auto& outcome) { return -outcome.surprise; });
  std::multiset<std::string> expected;
  for (int i = 0; i < 10; ++i) expected.insert(all[i].recording.scenario_id());
  std::vector<CollectedOutcome> rest(all.begin() + 10, all.end());
  std::ranges::sort(rest, {}, Digest);
  for (int i = 0; i < 10; ++i) expected.insert(rest[i].recording.scenario_id());
  OutcomeCollection::Written written;
  EXPECT_EQ(Recordings(*collection, &written), expected);
  EXPECT_EQ(written.surprising, 10);
  EXPECT_EQ(written.sampled, 10);
}

TEST_F(OutcomeCollectionTest, OneEventTakesOnePlaceAmongTheSurprising) {
  // Of each event ten overlapping outcomes; the surprising half has ten places.
  std::vector<CollectedOutcome> all;
  for (int event = 0; event < 12; ++event) {
    for (int i = 0; i < 10; ++i) {
      all.push_back(Outcome(10 * event + i, 10.0 * event + i));
      all.back().event = "event" + std::to_string(event);
    }
  }
  std::shuffle(all.begin(), all.end(), std::mt19937(5));
  auto collection = Open();
  for (const CollectedOutcome& outcome : all) ASSERT_TRUE(collection->Add({outcome}).ok());
  const std::set<std::string> files = Files();
  EXPECT_EQ(files.size(), 20u);
  OutcomeCollection::Written written;
  const auto ids = Recordings(*collection, &written);
  EXPECT_EQ(written.surprising, 10);
  for (int event = 2; event < 12; ++event) {
    EXPECT_TRUE(ids.contains("drive-" + std::to_string(10 * event + 9))) << event;
  }
  // Neither a restart nor a report that is repeated changes what is kept.
  collection = Open();
  ASSERT_TRUE(collection->Add(all).ok());
  EXPECT_EQ(Files(), files);
}

TEST_F(OutcomeCollectionTest, ASingleEventFillsTheSample) {
  const auto collection = Open();
  for (int i = 0; i < 50; ++i) {
    CollectedOutcome outcome = Outcome(i, i);
    outcome.event = "a";
    ASSERT_TRUE(collection->Add({outcome}).ok());
    ASSERT_LE(collection->bytes(), 20 * kBlock);
  }
  OutcomeCollection::Written written;
  EXPECT_TRUE(Recordings(*collection, &written).contains("drive-49"));
  EXPECT_EQ(written.surprising, 1);
  EXPECT_EQ(written.sampled, 19);
}

TEST_F(OutcomeCollectionTest, AnEventIsWhatHappensInOneDriveAtOneTime) {
  EXPECT_EQ(EventOf("drive#1", 10.0), EventOf("drive#2", 14.5));
  EXPECT_NE(EventOf("drive", 10.0), EventOf("drive", 15.0));
  EXPECT_NE(EventOf("drive", 10.0), EventOf("other", 10.0));
  EXPECT_EQ(EventOf("", 10.0), "");
}

TEST_F(OutcomeCollectionTest, AnOutcomeThatIsReportedAgainChangesNothing) {
  auto collection = Open();
  std::vector<CollectedOutcome> outcomes;
  for (int i = 0; i < 50; ++i) outcomes.push_back(Outcome(i, i));
  ASSERT_TRUE(collection->Add(outcomes).ok());
  const std::set<std::string> files = Files();
  ASSERT_TRUE(collection->Add(outcomes).ok());
  EXPECT_EQ(Files(), files);
  // Another version finds it less surprising.
  outcomes[49].surprise = 0.0;
  ASSERT_TRUE(collection->Add({outcomes[49]}).ok());
  EXPECT_EQ(Files(), files);
  collection = Open();
  EXPECT_EQ(Files(), files);
  ASSERT_TRUE(collection->Add(outcomes).ok());
  EXPECT_EQ(Files(), files);
}

TEST_F(OutcomeCollectionTest, ASmallerBoundHoldsFromTheNextStart) {
  auto collection = Open(40);
  for (int i = 0; i < 60; ++i) ASSERT_TRUE(collection->Add({Outcome(i, i)}).ok());
  EXPECT_EQ(Files().size(), 40u);
  collection = Open(10);
  EXPECT_EQ(Files().size(), 10u);
  const auto ids = Recordings(*collection);
  for (int i = 55; i < 60; ++i) EXPECT_TRUE(ids.contains("drive-" + std::to_string(i))) << i;
}

TEST_F(OutcomeCollectionTest, AnInterruptedWriteLeavesNothing) {
  auto collection = Open();
  ASSERT_TRUE(collection->Add({Outcome(1, 5.0)}).ok());
  const std::set<std::string> files = Files();
  std::ofstream(folder_ / "outcomes" / (".x" + *files.begin() + ".tmp-8rt2")) << "half";
  collection = Open();
  EXPECT_EQ(Files(), files);
  EXPECT_EQ(Recordings(*collection).size(), 1u);
}

TEST_F(OutcomeCollectionTest, LeavesDamagedFilesOutOfADataset) {
  const auto collection = Open();
  ASSERT_TRUE(collection->Add({Outcome(1, 5.0), Outcome(2, 6.0)}).ok());
  for (const std::string& name : Files()) {
    if (!name.starts_with(Digest(Outcome(1, 5.0)))) continue;
    std::ofstream(folder_ / "outcomes" / name, std::ios::app) << "!";
  }
  EXPECT_EQ(Recordings(*collection), std::multiset<std::string>{"drive-2"});
}

TEST_F(OutcomeCollectionTest, ForgetsWhatADatasetGotAndKeepsWhatCameLater) {
  auto collection = Open();
  ASSERT_TRUE(collection->Add({Outcome(1, 5.0), Outcome(2, 6.0)}).ok());
  OutcomeCollection::Written written;
  Recordings(*collection, &written);
  ASSERT_TRUE(collection->Add({Outcome(3, 1.0)}).ok());
  ASSERT_TRUE(collection->Forget(written).ok());
  EXPECT_EQ(Recordings(*collection), std::multiset<std::string>{"drive-3"});
  collection = Open();
  EXPECT_EQ(Recordings(*collection), std::multiset<std::string>{"drive-3"});
}

TEST_F(OutcomeCollectionTest, LeavesOutWhatIsTooLarge) {
  const auto collection = Open(4);
  CollectedOutcome large = Outcome(1, 9.0);
  for (int i = 0; i < 500; ++i) large.recording.mutable_agents(0)->add_states()->set_time(70.0 + i);
  ASSERT_TRUE(collection->Add({large, Outcome(2, 1.0)}).ok());
  EXPECT_EQ(Recordings(*collection), std::multiset<std::string>{"drive-2"});
}

TEST_F(OutcomeCollectionTest, AFailedWriteIsReportedAndTakesNoRoom) {
  const auto collection = Open();
  fs::remove_all(folder_ / "outcomes");
  EXPECT_FALSE(collection->Add({Outcome(1, 5.0)}).ok());
  EXPECT_TRUE(collection->empty());
  fs::create_directory(folder_ / "outcomes");
  ASSERT_TRUE(collection->Add({Outcome(1, 5.0)}).ok());
  EXPECT_EQ(Files().size(), 1u);
}

}  // namespace
}  // namespace maneuver::serving::outcome_collection_test
