#include "tests/bench/stage_times.h"

namespace maneuver::bench {

Series StageTimes::Rest() const {
  return Sum({Of(Stage::kParse), Of(Stage::kValidate), Of(Stage::kAnswer), Of(Stage::kSerialize)});
}

Series StageTimes::AllStages() const { return Sum({stages.begin(), stages.end()}); }

void AddStages(const Pipelines& pipelines, std::vector<std::function<void()>>* things) {
  for (const auto& owned : pipelines) {
    Pipeline* pipeline = owned.get();
    // Not measured: whatever ran before, such as a yardstick, leaves the caches unlike those of a
    // busy worker.
    things->push_back([=] { pipeline->RunAll(); });
    for (int stage = 0; stage < kStages; ++stage) {
      things->push_back([=] { pipeline->Run(static_cast<Stage>(stage)); });
    }
    things->push_back([=] { pipeline->RunScenarioEncoders(); });
    things->push_back([=] { pipeline->RunDecoder(); });
    things->push_back([=] { pipeline->RunAll(); });
  }
}

StageTimes TakeStages(const Pipelines& pipelines, std::span<const Series>* series) {
  StageTimes times;
  double targets = 0.0;
  for (const auto& pipeline : pipelines) targets += pipeline->targets();
  constexpr size_t kUnmeasured = 1;
  constexpr size_t kThings = kUnmeasured + kStages + 3;
  const auto mean = [&](size_t measured) {
    const size_t thing = kUnmeasured + measured;
    Series sum(series->front().size(), 0.0);
    for (size_t p = 0; p < pipelines.size(); ++p) {
      const Series& one = (*series)[p * kThings + thing];
      for (size_t i = 0; i < sum.size(); ++i) sum[i] += one[i] / targets;
    }
    return sum;
  };
  for (size_t stage = 0; stage < kStages; ++stage) times.stages[stage] = mean(stage);
  times.scenario_encoders = mean(kStages);
  times.decoder = mean(kStages + 1);
  times.together = mean(kStages + 2);
  *series = series->subspan(pipelines.size() * kThings);
  return times;
}

}  // namespace maneuver::bench
