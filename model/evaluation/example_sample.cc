#include "model/evaluation/example_sample.h"

#include <cmath>
#include <iterator>

#include "model/data/stable_hash.h"

namespace maneuver::evaluation {
namespace {

constexpr uint64_t kSeed = 0x53616D706C65;  // keeps these draws apart from other hashes

uint64_t HashOf(const v1::Scenario& recording, const data::Example& example) {
  uint64_t hash = data::StableHash(recording.scenario_id());
  hash = data::MixHash(hash, static_cast<uint64_t>(example.target_id));
  hash = data::MixHash(hash, static_cast<uint64_t>(std::llround(1e3 * example.time)));
  return data::MixHash(hash, kSeed);
}

v1::EvaluatedExample Describe(const v1::Scenario& recording, const data::Example& example,
                              const Measurement& measured) {
  v1::EvaluatedExample proto;
  proto.set_scenario_id(recording.scenario_id());
  proto.set_target_id(example.target_id);
  proto.set_time(example.time);
  for (size_t t = 0; t + 1 < example.trajectory.size(); t += 2) {
    proto.mutable_trajectory()->add_x(static_cast<double>(example.trajectory[t]));
    proto.mutable_trajectory()->add_y(static_cast<double>(example.trajectory[t + 1]));
  }
  proto.mutable_probabilities()->Add(measured.probabilities.begin(), measured.probabilities.end());
  proto.mutable_responsibilities()->Add(measured.responsibilities.begin(),
                                        measured.responsibilities.end());
  return proto;
}

}  // namespace

void ExampleSample::Add(const v1::Scenario& recording, const data::Example& example,
                        const Measurement& measured) {
  if (count_ == 0) return;
  const std::pair place(HashOf(recording, example), seen_++);
  if (kept_.size() == count_) {
    const auto last = std::prev(kept_.end());
    if (last->first < place) return;
    kept_.erase(last);
  }
  kept_.emplace(place, Describe(recording, example, measured));
}

void ExampleSample::Write(v1::EvaluationReport& report) const {
  std::map<int64_t, const v1::EvaluatedExample*> in_order;
  for (const auto& [place, example] : kept_) in_order[place.second] = &example;
  for (const auto& [_, example] : in_order) *report.add_sampled_examples() = *example;
}

}  // namespace maneuver::evaluation
