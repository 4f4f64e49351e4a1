#include "server/serving/past_answers.h"

#include <cmath>
#include <iterator>
#include <utility>

#include "model/evaluation/baselines.h"
#include "model/evaluation/input_ranges.h"
#include "model/evaluation/strata.h"
#include "model/scene/observation_window.h"
#include "model/scene/target_frame.h"

namespace maneuver::serving {
namespace {

// Of the list, the map and the allocator, for one answer.
constexpr int64_t kOverhead = 512;

int64_t BytesOf(const PastAnswer& answer) {
  const inference::SceneEncoding& encoding = answer.encoding;
  const auto floats = static_cast<int64_t>(encoding.features.size() + encoding.geometry.size());
  const auto doubles =
      static_cast<int64_t>(encoding.probabilities.size() + encoding.reference.size());
  const auto text = static_cast<int64_t>(answer.scenario_id.size() + answer.version.model.size());
  // The key repeats the texts.
  return kOverhead + static_cast<int64_t>(sizeof(PastAnswer)) + 2 * text +
         static_cast<int64_t>(sizeof(float)) * floats +
         static_cast<int64_t>(sizeof(double)) * doubles;
}

}  // namespace

PastAnswer PastAnswerMaker::Make(const Target& target, const inference::SceneEncoding& encoding) {
  const v1::Scenario& scenario = *target.scenario;
  const v1::Agent& agent = *scene::FindAgent(scenario, target.id);
  const double time = scenario.prediction_time();
  const int present = scene::FindState(agent, time, HUGE_VAL, time + scene::kSameTime);
  const v1::AgentState& last = agent.states(present);
  if (counted_ != &scenario) {
    counted_ = &scenario;
    agents_ = evaluation::AgentsAt(scenario, time, scene::WindowOf(spec_).tolerance());
  }
  return {.scenario_id = scenario.scenario_id(),
          .target_id = target.id,
          .prediction_time = time,
          .version = version_,
          .encoding = encoding,
          .X_WT = target.X_WT,
          .type = agent.type(),
          .last = last,
          .speed = evaluation::MotionAt(agent, last.time()).speed(),
          .agents = agents_,
          .map_features = target.map != nullptr
                              ? evaluation::MapFeaturesNear(*target.map, target.X_WT)
                              : evaluation::MapFeaturesNear(
                                    scene::RoadMap::Over(scenario.map_features()), target.X_WT)};
}

PastAnswers::Metrics::Metrics(monitoring::MetricRegistry& registry)
    : answers(registry.AddGauge("maneuver_outcome_kept_answers",
                                "Answers that are kept until their outcomes are reported.")),
      bytes(registry.AddGauge("maneuver_outcome_kept_answer_bytes",
                              "Memory of the answers that are kept.")),
      limit(registry.AddGauge("maneuver_outcome_kept_answer_limit_bytes",
                              "Most memory of the answers that are kept.")),
      dropped(registry.AddCounter("maneuver_outcome_dropped_answers_total",
                                  "Answers that were dropped to make room for newer ones before an "
                                  "outcome was reported.")) {}

PastAnswers::PastAnswers(int64_t max_bytes, monitoring::MetricRegistry& metrics)
    : max_bytes_(max_bytes), metrics_(metrics) {
  metrics_.limit.Set(static_cast<double>(max_bytes));
}

PastAnswers::Key PastAnswers::KeyOf(const PastAnswer& answer) {
  return {answer.scenario_id, answer.target_id, answer.prediction_time, answer.version};
}

void PastAnswers::Keep(PastAnswer answer) {
  if (answer.scenario_id.empty()) return;
  const int64_t bytes = BytesOf(answer);
  auto kept = std::make_shared<const PastAnswer>(std::move(answer));
  Key key = KeyOf(*kept);
  const MutexLock lock(mutex_);
  if (const auto same = by_key_.find(key); same != by_key_.end()) RemoveLocked(same->second);
  while (!by_age_.empty() && bytes_ + bytes > max_bytes_) {
    RemoveLocked(by_age_.begin());
    metrics_.dropped.Increment();
  }
  if (bytes > max_bytes_) {
    metrics_.dropped.Increment();
  } else {
    by_age_.push_back({std::move(kept), bytes, counted_++});
    by_key_.emplace(std::move(key), std::prev(by_age_.end()));
    bytes_ += bytes;
  }
  ShowLocked();
}

std::shared_ptr<const PastAnswer> PastAnswers::Find(
    const std::string& scenario_id, int64_t target_id, double prediction_time,
    const std::optional<security::ModelVersionName>& version) const {
  const MutexLock lock(mutex_);
  if (version) {
    const auto found = by_key_.find({scenario_id, target_id, prediction_time, *version});
    return found == by_key_.end() ? nullptr : found->second->answer;
  }
  const Kept* newest = nullptr;
  for (auto each = by_key_.lower_bound({scenario_id, target_id, prediction_time, {}});
       each != by_key_.end(); ++each) {
    const PastAnswer& answer = *each->second->answer;
    if (answer.scenario_id != scenario_id || answer.target_id != target_id ||
        answer.prediction_time != prediction_time) {
      break;
    }
    if (newest == nullptr || each->second->number > newest->number) newest = &*each->second;
  }
  return newest == nullptr ? nullptr : newest->answer;
}

bool PastAnswers::Remove(const PastAnswer& answer) {
  const MutexLock lock(mutex_);
  const auto found = by_key_.find(KeyOf(answer));
  if (found == by_key_.end() || found->second->answer.get() != &answer) return false;
  RemoveLocked(found->second);
  ShowLocked();
  return true;
}

void PastAnswers::RemoveLocked(Age::iterator kept) {
  bytes_ -= kept->bytes;
  by_key_.erase(KeyOf(*kept->answer));
  by_age_.erase(kept);
}

void PastAnswers::ShowLocked() {
  metrics_.answers.Set(static_cast<double>(by_age_.size()));
  metrics_.bytes.Set(static_cast<double>(bytes_));
}

}  // namespace maneuver::serving
