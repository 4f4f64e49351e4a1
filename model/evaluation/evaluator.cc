#include "model/evaluation/evaluator.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <iterator>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/data/recording_groups.h"
#include "model/evaluation/example_sample.h"
#include "model/evaluation/finite_report.h"
#include "model/evaluation/report.h"
#include "model/evaluation/rival_comparison.h"
#include "model/evaluation/waymo_displacement.h"
#include "model/machine/parallel.h"

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
         baselines.inputs_version() == model.inputs_version() &&
         MessageDifferencer::Equals(baselines.trajectory(), model.trajectory());
}

absl::Status CheckBaselines(const inference::ActionModel& model, const EvaluationInput& input) {
  if (input.baselines == nullptr || SeesTheSame(input.baselines->covernet->spec(), model.spec())) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      "the baselines in the model's folder are of a model that reads other inputs of a scene, or "
      "has another reference or horizon");
}

std::vector<data::Example> EnumerateAll(std::span<const v1::Scenario> recordings,
                                        const v1::ModelSpec& spec,
                                        const v1::ExampleSettings& settings) {
  std::vector<data::Example> examples;
  for (size_t i = 0; i < recordings.size(); ++i) {
    std::vector<data::Example> found =
        data::EnumerateExamples(recordings[i], static_cast<int>(i), spec, settings);
    std::move(found.begin(), found.end(), std::back_inserter(examples));
  }
  return examples;
}

// Measures the examples on the input's threads. Returns false if `progress` cancelled it.
//   progress: called with the number of examples done, by the calling thread
bool MeasureAll(const MeasuringContext& context, int worker_count,
                const std::function<bool(int64_t done)>& progress,
                std::span<const data::Example> examples, std::span<Measurement> measured) {
  std::atomic<size_t> next = 0;
  std::atomic<int64_t> done = 0;
  std::atomic<bool> stopped = false;
  const auto work = [&](bool reports) {
    Measurer measurer(context);
    int64_t reported = 0;
    while (!stopped) {
      const size_t begin = next.fetch_add(Measurer::kBatch);
      if (begin >= examples.size()) break;
      const size_t count = std::min<size_t>(Measurer::kBatch, examples.size() - begin);
      measurer.Measure(examples.subspan(begin, count), measured.subspan(begin, count));
      const auto added = static_cast<int64_t>(count);
      const int64_t after = done.fetch_add(added) + added;
      if (reports && after - reported >= kReportEvery) {
        reported = after;
        if (!progress(after)) stopped = true;
      }
    }
  };
  machine::OnThreads(worker_count, [&](int thread) {
    try {
      work(/*reports=*/thread == 0);
    } catch (...) {
      stopped = true;
      throw;
    }
  });
  return !stopped;
}

int64_t RecordingCount(const EvaluationInput& input) {
  return input.blocks != nullptr ? input.blocks->recordings()
                                 : static_cast<int64_t>(input.recordings.size());
}

absl::StatusOr<data::RecordingGroups> FindGroups(const EvaluationInput& input) {
  data::RecordingGrouper grouper;
  const absl::Status status = ForEachBlock(input, [&](std::span<const v1::Scenario> block) {
    for (const v1::Scenario& recording : block) grouper.Add(recording);
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return grouper.Groups();
}

}  // namespace

absl::Status ForEachBlock(const EvaluationInput& input, const data::RecordingBlocks::Visit& visit) {
  return input.blocks != nullptr ? input.blocks->ForEach(visit) : visit(input.recordings);
}

BlockMeasurer::BlockMeasurer(const inference::ActionModel& model, const EvaluationInput& input)
    : model_(model),
      input_(input),
      labels_(input.annotations),
      all_recordings_(RecordingCount(input)) {}

absl::StatusOr<MeasuredExamples> BlockMeasurer::Measure(std::span<const v1::Scenario> block) {
  if (absl::Status status = CheckBaselines(model_, input_); !status.ok()) return status;
  MeasuredExamples all;
  all.examples = EnumerateAll(block, model_.spec(), input_.examples);
  const MeasuringContext context(model_, block, labels_, input_.baselines);
  all.measured.resize(all.examples.size());
  all.measured_by_waymo = !context.waymo.measured_times().empty();
  const int64_t before = examples_;
  recordings_ += static_cast<int64_t>(block.size());
  examples_ += static_cast<int64_t>(all.examples.size());
  const auto progress = [&](int64_t done) {
    // Recordings that have not been read are taken to have as many examples as those that have.
    const double share = static_cast<double>(all_recordings_) /
                         static_cast<double>(std::max<int64_t>(1, recordings_));
    const int64_t total = std::llround(share * static_cast<double>(examples_));
    return !input_.progress || input_.progress(before + done, total);
  };
  if (!MeasureAll(context, input_.threads, progress, all.examples, all.measured)) {
    return absl::CancelledError("the evaluation was stopped");
  }
  return all;
}

absl::Status BlockMeasurer::CheckExamples() const {
  if (examples_ > 0) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      "the recordings hold no example: the model predicts ",
      artifact::TargetTypesText(model_.spec()),
      ", and none of those has a second of past and a whole horizon of future; use recordings "
      "with such agents, longer ones, or a model with a shorter horizon"));
}

absl::StatusOr<v1::EvaluationReport> Evaluate(const inference::ActionModel& model,
                                              const EvaluationInput& input) {
  if (absl::Status status = CheckBaselines(model, input); !status.ok()) return status;
  absl::StatusOr<data::RecordingGroups> groups = FindGroups(input);
  if (!groups.ok()) return groups.status();
  const bool by_waymo =
      !WaymoMeasure(artifact::WaypointTimes(model.spec().trajectory())).measured_times().empty();
  ReportSums sums(by_waymo);
  RivalSums rivals(*std::move(groups), by_waymo);
  ExampleSample sample(static_cast<size_t>(std::max(0, input.sampled_examples)));
  BlockMeasurer measurer(model, input);
  size_t first = 0;  // recording of the block
  const absl::Status read = ForEachBlock(input, [&](std::span<const v1::Scenario> block) {
    const absl::StatusOr<MeasuredExamples> all = measurer.Measure(block);
    if (!all.ok()) return all.status();
    for (size_t i = 0; i < all->examples.size(); ++i) {
      const data::Example& example = all->examples[i];
      const auto recording = static_cast<size_t>(example.recording);
      sums.Add(all->measured[i]);
      rivals.Add(first + recording, all->measured[i]);
      sample.Add(block[recording], example, all->measured[i]);
    }
    first += block.size();
    return absl::OkStatus();
  });
  if (!read.ok()) return read;
  if (absl::Status status = measurer.CheckExamples(); !status.ok()) return status;
  v1::EvaluationReport report = sums.MakeReport();
  sample.Write(report);
  *report.mutable_rivals() = rivals.MakeStandings();
  *report.mutable_example_settings() = input.examples;
  *report.mutable_trajectory() = model.spec().trajectory();
  *report.mutable_target_types() = model.spec().target_types();
  if (absl::Status status = CheckFinite(report); !status.ok()) return status;
  return report;
}

}  // namespace maneuver::evaluation
