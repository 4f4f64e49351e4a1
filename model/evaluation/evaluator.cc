#include "model/evaluation/evaluator.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <atomic>
#include <iterator>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "locks/mutex.h"
#include "model/artifact/model_spec.h"
#include "model/data/recording_groups.h"
#include "model/evaluation/example_sample.h"
#include "model/evaluation/finite_report.h"
#include "model/evaluation/report.h"
#include "model/evaluation/rival_comparison.h"

namespace maneuver::evaluation {
namespace {

constexpr int64_t kReportEvery = 64;  // examples

// Returns whether baselines read the same of a scene as the model and predict the same
// trajectories. The sizes of their networks may differ.
bool SeesTheSame(const v1::ModelSpec& baselines, const v1::ModelSpec& model) {
  using google::protobuf::util::MessageDifferencer;
  return baselines.has_raster() == model.has_raster() &&
         MessageDifferencer::Equals(baselines.raster(), model.raster()) &&
         baselines.target_motion() == model.target_motion() &&
         baselines.has_scene_vectors() == model.has_scene_vectors() &&
         artifact::ReadsLanePaths(baselines) == artifact::ReadsLanePaths(model) &&
         artifact::ReadsAgents(baselines) == artifact::ReadsAgents(model) &&
         baselines.reference() == model.reference() &&
         MessageDifferencer::Equals(baselines.trajectory(), model.trajectory());
}

std::vector<data::Example> EnumerateAll(const EvaluationInput& input, const v1::ModelSpec& spec) {
  std::vector<data::Example> examples;
  for (size_t i = 0; i < input.recordings.size(); ++i) {
    std::vector<data::Example> found =
        data::EnumerateExamples(input.recordings[i], static_cast<int>(i), spec, input.examples);
    std::move(found.begin(), found.end(), std::back_inserter(examples));
  }
  return examples;
}

void AddSample(const MeasuredExamples& all, const EvaluationInput& input,
               v1::EvaluationReport& report) {
  const auto count = static_cast<size_t>(std::max(0, input.sampled_examples));
  for (const size_t i : SampleExamples(all.examples, input.recordings, count)) {
    const data::Example& example = all.examples[i];
    const Measurement& measured = all.measured[i];
    v1::EvaluatedExample& proto = *report.add_sampled_examples();
    proto.set_scenario_id(input.recordings[static_cast<size_t>(example.recording)].scenario_id());
    proto.set_target_id(example.target_id);
    proto.set_time(example.time);
    for (size_t t = 0; t + 1 < example.trajectory.size(); t += 2) {
      proto.mutable_trajectory()->add_x(static_cast<double>(example.trajectory[t]));
      proto.mutable_trajectory()->add_y(static_cast<double>(example.trajectory[t + 1]));
    }
    proto.mutable_probabilities()->Add(measured.probabilities.begin(),
                                       measured.probabilities.end());
    proto.mutable_responsibilities()->Add(measured.responsibilities.begin(),
                                          measured.responsibilities.end());
  }
}

// Measures the examples on the input's threads. Returns false if `progress` cancelled it.
bool MeasureAll(const MeasuringContext& context, const EvaluationInput& input,
                std::span<const data::Example> examples, std::span<Measurement> measured) {
  Mutex mutex;  // guards the calls of progress
  std::atomic<size_t> next = 0;
  std::atomic<int64_t> done = 0;
  std::atomic<bool> stopped = false;
  const auto work = [&] {
    Measurer measurer(context);
    while (!stopped) {
      const size_t begin = next.fetch_add(Measurer::kBatch);
      if (begin >= examples.size()) break;
      const size_t count = std::min<size_t>(Measurer::kBatch, examples.size() - begin);
      measurer.Measure(examples.subspan(begin, count), measured.subspan(begin, count));
      const int64_t before = done.fetch_add(static_cast<int64_t>(count));
      const int64_t after = before + static_cast<int64_t>(count);
      if (input.progress && before / kReportEvery != after / kReportEvery) {
        const MutexLock lock(mutex);
        if (!input.progress(after, static_cast<int64_t>(examples.size()))) stopped = true;
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    for (int i = 1; i < input.threads; ++i) threads.emplace_back(work);
    work();
  }
  return !stopped;
}

}  // namespace

absl::StatusOr<MeasuredExamples> MeasureExamples(const inference::ActionModel& model,
                                                 const EvaluationInput& input) {
  MeasuredExamples all;
  all.examples = EnumerateAll(input, model.spec());
  if (all.examples.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the recordings hold no example: the model predicts ",
        artifact::TargetTypesText(model.spec()),
        ", and none of those has a second of past and a whole horizon of future; use recordings "
        "with such agents, longer ones, or a model with a shorter horizon"));
  }
  if (input.baselines != nullptr && !SeesTheSame(input.baselines->covernet->spec(), model.spec())) {
    return absl::FailedPreconditionError(
        "the baselines in the model's folder are of a model that reads other inputs of a scene, or "
        "has another reference or horizon");
  }
  const MeasuringContext context(model, input.recordings, input.annotations, input.baselines);
  all.measured.resize(all.examples.size());
  all.measured_by_waymo = !context.waymo.measured_times().empty();
  if (!MeasureAll(context, input, all.examples, all.measured)) {
    return absl::CancelledError("the evaluation was stopped");
  }
  return all;
}

absl::StatusOr<v1::EvaluationReport> Evaluate(const inference::ActionModel& model,
                                              const EvaluationInput& input) {
  const absl::StatusOr<MeasuredExamples> all = MeasureExamples(model, input);
  if (!all.ok()) return all.status();
  v1::EvaluationReport report = MakeReport(all->measured, all->measured_by_waymo);
  AddSample(*all, input, report);
  data::RecordingGrouper grouper;
  for (const v1::Scenario& recording : input.recordings) grouper.Add(recording);
  *report.mutable_rivals() = MakeRivalStandings(*all, grouper.Groups());
  *report.mutable_example_settings() = input.examples;
  *report.mutable_trajectory() = model.spec().trajectory();
  *report.mutable_target_types() = model.spec().target_types();
  if (absl::Status status = CheckFinite(report); !status.ok()) return status;
  return report;
}

}  // namespace maneuver::evaluation
