#include "server/serving/outcome_recording.h"

#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/data/recording_split.h"
#include "model/files/digest.h"
#include "model/scene/observation_window.h"
#include "model/scene/target_frame.h"

namespace maneuver::serving {
namespace {

using scene::kSameTime;

constexpr size_t kIdDigits = 16;           // hexadecimal digits
constexpr size_t kLongestDriveName = 100;  // bytes; longer ones leave no room for the digest

using States = google::protobuf::RepeatedPtrField<v1::AgentState>;

// Appends the states from `from` to `to`, and one at or after `to` if the last one is before it.
void AppendStates(const States& states, double from, double to, bool reach, double shift,
                  v1::Agent& agent) {
  for (const v1::AgentState& state : states) {
    if (state.time() < from - kSameTime) continue;
    const bool after = state.time() > to + kSameTime;
    if (after && !reach) break;
    v1::AgentState& copy = *agent.add_states();
    copy = state;
    copy.set_time(state.time() + shift);
    if (state.time() > to - kSameTime) break;
  }
}

// Appends the readings from the one that counts at `from` to `to`.
void AppendReadings(const v1::TrafficSignal& signal, double from, double to, double shift,
                    v1::TrafficSignal& kept) {
  int first = 0;
  for (int i = 0; i < signal.readings_size(); ++i) {
    if (signal.readings(i).time() <= from) first = i;
  }
  for (int i = first; i < signal.readings_size() && signal.readings(i).time() <= to + kSameTime;
       ++i) {
    v1::TrafficSignalReading& copy = *kept.add_readings();
    copy = signal.readings(i);
    copy.set_time(copy.time() + shift);
  }
}

}  // namespace

v1::Scenario OutcomeRecording(const v1::Outcome& outcome, const std::set<int64_t>& targets,
                              const v1::ModelSpec& spec) {
  const v1::Scenario& scene = outcome.scenario();
  const scene::ObservationWindow window = scene::WindowOf(spec);
  const double now = scene.prediction_time();
  const double shift = kOutcomeTime - now;
  const double begin = now - window.past - window.tolerance();
  const double horizon = artifact::WaypointTimes(spec.trajectory()).back();

  v1::Scenario recording;
  *recording.mutable_map_features() = scene.map_features();
  recording.set_prediction_time(kOutcomeTime);
  for (const v1::Agent& agent : scene.agents()) {
    v1::Agent kept = agent;
    kept.clear_states();
    AppendStates(agent.states(), begin, now, /*reach=*/false, shift, kept);
    if (!kept.states().empty()) *recording.add_agents() = std::move(kept);
  }
  for (const v1::TargetOutcome& target : outcome.targets()) {
    if (!targets.contains(target.target_id())) continue;
    recording.add_target_ids(target.target_id());
    for (v1::Agent& agent : *recording.mutable_agents()) {
      if (agent.id() != target.target_id()) continue;
      AppendStates(target.states(), now, now + horizon, /*reach=*/true, shift, agent);
    }
  }
  for (const v1::TrafficSignal& signal : scene.traffic_signals()) {
    v1::TrafficSignal kept = signal;
    kept.clear_readings();
    AppendReadings(signal, begin, now, shift, kept);
    *recording.add_traffic_signals() = std::move(kept);
  }
  const std::string digest =
      files::Sha256Hex(absl::StrCat(scene.scenario_id(), " ", now, recording.SerializeAsString()));
  std::string drive(data::WithoutPart(scene.scenario_id()));
  if (drive.empty() || drive.size() > kLongestDriveName) drive = "outcome";
  recording.set_scenario_id(data::PartId(drive, std::string_view(digest).substr(0, kIdDigits)));
  return recording;
}

}  // namespace maneuver::serving
