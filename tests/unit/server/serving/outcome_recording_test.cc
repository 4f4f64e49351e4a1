#include "server/serving/outcome_recording.h"

#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "model/artifact/training_presets.h"
#include "model/data/example_index.h"
#include "model/data/town/synthetic_town.h"
#include "model/scene/scenario_validation.h"
#include "model/scene/target_frame.h"

namespace maneuver::serving::outcome_recording_test {
namespace {

v1::TrainingSettings Settings() {
  v1::TrainingSettings settings;
  settings.mutable_examples()->mutable_stride()->set_nanos(500'000'000);
  settings = artifact::ResolveTrainingSettings(settings);
  settings.mutable_examples()->set_keep_standing(1.0);
  return settings;
}

// What a planner reports: everything up to the prediction time, and all that followed.
v1::Outcome OutcomeOf(const v1::Scenario& recording, const data::Example& example, double shift) {
  v1::Outcome outcome;
  v1::Scenario& scene = *outcome.mutable_scenario();
  scene = recording;
  scene.set_prediction_time(example.time + shift);
  v1::TargetOutcome& target = *outcome.add_targets();
  target.set_target_id(example.target_id);
  for (v1::Agent& agent : *scene.mutable_agents()) {
    for (v1::AgentState& state : *agent.mutable_states()) {
      const bool later = state.time() > example.time + scene::kSameTime;
      state.set_time(state.time() + shift);
      if (later && agent.id() == example.target_id) *target.add_states() = state;
    }
  }
  return outcome;
}

TEST(OutcomeRecordingTest, GivesTheExampleThatWasScoredAndNoOther) {
  const v1::TrainingSettings settings = Settings();
  const v1::ModelSpec& spec = settings.model();
  const v1::Scenario recording = data::town::GenerateRecording({.seed = 9}, 3).scenario;
  const auto examples = data::EnumerateExamples(recording, 0, spec, settings.examples());
  ASSERT_GT(examples.size(), 20u);
  std::set<std::string> ids;
  // A clock that counts from another time, so that no time is on the grid of the stride.
  for (const double shift : {0.0, 1234.567}) {
    for (size_t i = 0; i < examples.size(); i += 7) {
      const v1::Scenario made =
          OutcomeRecording(OutcomeOf(recording, examples[i], shift), {examples[i].target_id}, spec);
      EXPECT_TRUE(scene::ValidateScenario(made, {}).empty());
      const auto again = data::EnumerateExamples(made, 0, spec, settings.examples());
      ASSERT_EQ(again.size(), 1u) << i;
      EXPECT_EQ(again[0].target_id, examples[i].target_id);
      EXPECT_NEAR(again[0].time, kOutcomeTime, 1e-9);
      ASSERT_EQ(again[0].trajectory.size(), examples[i].trajectory.size());
      for (size_t k = 0; k < again[0].trajectory.size(); ++k) {
        EXPECT_NEAR(again[0].trajectory[k], examples[i].trajectory[k], 1e-4);
      }
      for (size_t k = 0; k < again[0].reference.size(); ++k) {
        EXPECT_NEAR(again[0].reference[k], examples[i].reference[k], 1e-3);
      }
      EXPECT_EQ(made.map_features_size(), recording.map_features_size());
      EXPECT_TRUE(ids.insert(made.scenario_id()).second);
      EXPECT_EQ(made.scenario_id().substr(0, 9), "town-9-3#");
    }
  }
}

TEST(OutcomeRecordingTest, HoldsNoFutureOfAgentsThatWereNotScored) {
  const v1::TrainingSettings settings = Settings();
  const v1::Scenario recording = data::town::GenerateRecording({.seed = 9}, 3).scenario;
  const auto examples =
      data::EnumerateExamples(recording, 0, settings.model(), settings.examples());
  const v1::Outcome outcome = OutcomeOf(recording, examples[0], 0.0);
  const v1::Scenario made = OutcomeRecording(outcome, {}, settings.model());
  for (const v1::Agent& agent : made.agents()) {
    EXPECT_LE(agent.states().rbegin()->time(), kOutcomeTime + 1e-6);
    EXPECT_GE(agent.states(0).time(), kOutcomeTime - 1.2);
  }
  for (const v1::TrafficSignal& signal : made.traffic_signals()) {
    for (int i = 1; i < signal.readings_size(); ++i) {
      EXPECT_LE(signal.readings(i).time(), kOutcomeTime + 1e-6);
    }
  }
}

TEST(OutcomeRecordingTest, AnIdThatIsMissingOrTooLongIsReplaced) {
  const v1::TrainingSettings settings = Settings();
  const v1::Scenario recording = data::town::GenerateRecording({.seed = 9}, 3).scenario;
  const auto examples =
      data::EnumerateExamples(recording, 0, settings.model(), settings.examples());
  v1::Outcome outcome = OutcomeOf(recording, examples[0], 0.0);
  for (const std::string& id : {std::string(), std::string(128, 'x')}) {
    outcome.mutable_scenario()->set_scenario_id(id);
    const v1::Scenario made = OutcomeRecording(outcome, {examples[0].target_id}, settings.model());
    EXPECT_EQ(made.scenario_id().substr(0, 8), "outcome#");
    EXPECT_TRUE(scene::ValidateScenario(made, {}).empty());
  }
}

}  // namespace
}  // namespace maneuver::serving::outcome_recording_test
