#include "model/evaluation/evaluator.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <numeric>
#include <optional>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "model/artifact/model_spec.h"
#include "model/data/example_index.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/clustering.h"
#include "model/evaluation/displacement.h"
#include "model/evaluation/likelihood.h"
#include "model/evaluation/maneuver_labels.h"
#include "model/scene/rasterizer.h"
#include "model/scene/target_frame.h"

namespace maneuver::evaluation {
namespace {

constexpr int kRanked = 6;
constexpr int kBatch = 8;
constexpr int64_t kReportEvery = 64;  // examples

// What was measured on one example.
struct Measured {
  DisplacementErrors first;
  DisplacementErrors best;
  DisplacementErrors constant_velocity;
  double nll = 0.0;
  int cluster = 0;
};

Trajectory ToTrajectory(const std::vector<float>& values) {
  Trajectory trajectory(values.size() / 2, 2);
  for (Eigen::Index i = 0; i < trajectory.size(); ++i) trajectory.data()[i] = values[i];
  return trajectory;
}

// Velocity of the target in its own frame, m/s.
scene::Point2 TargetVelocity(const v1::Scenario& recording, const data::Example& example) {
  const v1::Agent* agent = scene::FindAgent(recording, example.target_id);
  const int index = scene::FindState(*agent, example.time, 1e-3, example.time + 1e-3);
  const v1::AgentState& state = agent->states(index);
  const scene::Pose2 rotation(0.0, 0.0, example.X_WT.heading());
  return rotation.ToLocal({state.velocity_x(), state.velocity_y()});
}

// One thread's share of the work: a session and its scratch.
class Evaluator {
 public:
  Evaluator(const inference::ActionModel& model, std::span<const v1::Scenario> recordings)
      : recordings_(recordings),
        session_(model.NewSession()),
        rasterizer_(model.spec().raster()),
        raster_bytes_(scene::RasterBytes(model.spec().raster())),
        rasters_(kBatch * raster_bytes_),
        encodings_(kBatch),
        all_actions_(model.spec().actions()),
        waypoint_times_(artifact::WaypointTimes(model.spec().trajectory())),
        statistics_(model.spec().actions()) {
    std::iota(all_actions_.begin(), all_actions_.end(), 0);
  }

  void Measure(std::span<const data::Example> examples, std::span<Measured> measured) {
    std::vector<inference::SceneInput> scenes;
    for (size_t i = 0; i < examples.size(); ++i) {
      std::span<uint8_t> raster(rasters_.data() + i * raster_bytes_, raster_bytes_);
      rasterizer_.Rasterize(recordings_[examples[i].recording], examples[i].time,
                            examples[i].target_id, examples[i].X_WT, {}, raster);
      scenes.push_back({raster.data(), examples[i].motion});
    }
    session_->Encode(scenes, std::span(encodings_).first(examples.size()));
    for (size_t i = 0; i < examples.size(); ++i) {
      measured[i] = MeasureOne(examples[i], encodings_[i]);
    }
  }

  const ActionStatistics& statistics() const { return statistics_; }

 private:
  Measured MeasureOne(const data::Example& example, const inference::SceneEncoding& encoding) {
    const Trajectory truth = ToTrajectory(example.trajectory);
    std::vector<int> ranked = all_actions_;
    std::stable_sort(ranked.begin(), ranked.end(), [&](int a, int b) {
      return encoding.probabilities[a] > encoding.probabilities[b];
    });
    const std::vector<inference::ActionDistribution> distributions =
        session_->Describe(encoding, ranked, inference::LatentSource::kPosterior);
    std::vector<double> probabilities;
    for (const int action : ranked) probabilities.push_back(encoding.probabilities[action]);
    std::vector<Trajectory> means;
    for (int i = 0; i < std::min<int>(kRanked, static_cast<int>(ranked.size())); ++i) {
      means.push_back(distributions[i].mean());
    }
    const inference::Classification classification = session_->Classify(encoding, truth);
    statistics_.Add(encoding.probabilities, classification.responsibilities);

    Measured measured;
    measured.first = BestOf(means, 1, truth);
    measured.best = BestOf(means, kRanked, truth);
    const scene::Point2 velocity = TargetVelocity(recordings_[example.recording], example);
    const Trajectory straight = ConstantVelocity(velocity.x, velocity.y, waypoint_times_);
    measured.constant_velocity = BestOf({&straight, 1}, 1, truth);
    measured.nll = MixtureNll(distributions, probabilities, truth);
    Eigen::Index cluster = 0;
    classification.responsibilities.maxCoeff(&cluster);
    measured.cluster = static_cast<int>(cluster);
    return measured;
  }

  std::span<const v1::Scenario> recordings_;
  std::unique_ptr<inference::InferenceSession> session_;
  scene::Rasterizer rasterizer_;
  size_t raster_bytes_;
  std::vector<uint8_t> rasters_;
  std::vector<inference::SceneEncoding> encodings_;
  std::vector<int> all_actions_;
  std::vector<double> waypoint_times_;
  ActionStatistics statistics_;
};

double Mean(const std::vector<Measured>& measured, auto value) {
  double sum = 0.0;
  for (const Measured& one : measured) sum += value(one);
  return sum / static_cast<double>(measured.size());
}

// Adds agreement with the recorded manoeuvres, if there are any.
void AddAgreement(const EvaluationInput& input, const std::vector<data::Example>& examples,
                  const std::vector<Measured>& measured, double horizon,
                  v1::EvaluationReport* report) {
  const ManeuverLabels labels(input.annotations);
  ContingencyTable table;
  for (size_t i = 0; i < examples.size(); ++i) {
    const data::Example& example = examples[i];
    const std::optional<int> label =
        labels.Over(input.recordings[example.recording].scenario_id(), example.target_id,
                    example.time, example.time + horizon);
    if (label) table.Add(measured[i].cluster, *label);
  }
  if (table.total() == 0) return;
  auto& metrics = *report->mutable_metrics();
  metrics["nmi"] = table.NormalizedMutualInformation();
  metrics["purity"] = table.Purity();
  metrics["labelled_examples"] = static_cast<double>(table.total());
}

}  // namespace

absl::StatusOr<v1::EvaluationReport> Evaluate(const inference::ActionModel& model,
                                              const EvaluationInput& input) {
  std::vector<data::Example> examples;
  for (size_t i = 0; i < input.recordings.size(); ++i) {
    std::vector<data::Example> found = data::EnumerateExamples(
        input.recordings[i], static_cast<int>(i), model.spec(), input.examples);
    std::move(found.begin(), found.end(), std::back_inserter(examples));
  }
  if (examples.empty()) {
    return absl::FailedPreconditionError(
        "the recordings hold no example: none has a vehicle with a second of past and a whole "
        "horizon of future; use longer recordings or a model with a shorter horizon");
  }

  std::vector<Measured> measured(examples.size());
  ActionStatistics statistics(model.spec().actions());
  std::mutex mutex;  // guards statistics and the calls of progress
  std::atomic<size_t> next = 0;
  std::atomic<int64_t> done = 0;
  std::atomic<bool> stopped = false;
  const auto work = [&] {
    Evaluator evaluator(model, input.recordings);
    while (!stopped) {
      const size_t begin = next.fetch_add(kBatch);
      if (begin >= examples.size()) break;
      const size_t count = std::min<size_t>(kBatch, examples.size() - begin);
      evaluator.Measure(std::span(examples).subspan(begin, count),
                        std::span(measured).subspan(begin, count));
      const int64_t before = done.fetch_add(static_cast<int64_t>(count));
      const int64_t after = before + static_cast<int64_t>(count);
      if (input.progress && before / kReportEvery != after / kReportEvery) {
        std::lock_guard lock(mutex);
        if (!input.progress(after, static_cast<int64_t>(examples.size()))) stopped = true;
      }
    }
    std::lock_guard lock(mutex);
    statistics.Merge(evaluator.statistics());
  };
  {
    std::vector<std::jthread> threads;
    for (int i = 1; i < input.threads; ++i) threads.emplace_back(work);
    work();
  }
  if (stopped) return absl::CancelledError("the evaluation was stopped");

  v1::EvaluationReport report;
  report.set_examples(static_cast<int64_t>(examples.size()));
  auto& metrics = *report.mutable_metrics();
  metrics["ade_1"] = Mean(measured, [](const Measured& m) { return m.first.min_ade; });
  metrics["fde_1"] = Mean(measured, [](const Measured& m) { return m.first.min_fde; });
  metrics["min_ade_6"] = Mean(measured, [](const Measured& m) { return m.best.min_ade; });
  metrics["min_fde_6"] = Mean(measured, [](const Measured& m) { return m.best.min_fde; });
  metrics["miss_rate_6"] = Mean(measured, [](const Measured& m) { return m.best.missed; });
  metrics["ade_cv"] = Mean(measured, [](const Measured& m) { return m.constant_velocity.min_ade; });
  metrics["fde_cv"] = Mean(measured, [](const Measured& m) { return m.constant_velocity.min_fde; });
  metrics["miss_rate_cv"] =
      Mean(measured, [](const Measured& m) { return m.constant_velocity.missed; });
  metrics["ade_ratio"] = metrics["ade_1"] / metrics["ade_cv"];
  metrics["fde_ratio"] = metrics["fde_1"] / metrics["fde_cv"];
  metrics["nll"] = Mean(measured, [](const Measured& m) { return m.nll; });
  metrics["effective_actions"] = statistics.EffectiveActions();
  metrics["action_perplexity"] = statistics.Perplexity();
  metrics["mutual_information"] = statistics.MutualInformation();
  metrics["calibration_error"] = statistics.ExpectedCalibrationError();
  for (const double usage : statistics.MeanProbability()) report.add_action_usage(usage);
  const std::vector<double> times = artifact::WaypointTimes(model.spec().trajectory());
  AddAgreement(input, examples, measured, times.back(), &report);
  return report;
}

}  // namespace maneuver::evaluation
