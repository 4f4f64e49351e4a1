#include "model/evaluation/measurement.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "model/artifact/model_spec.h"
#include "model/evaluation/input_ranges.h"
#include "model/inference/representatives.h"
#include "model/scene/target_frame.h"

namespace maneuver::evaluation {

struct ExampleTruth {
  const v1::Agent& agent;        // the target
  Motion motion;                 // at the prediction time
  Trajectory trajectory;         // target frame, metres
  std::vector<double> headings;  // at the times that Waymo measures, target frame, radians
};

namespace {

using inference::ActionDistribution;

Trajectory ToTrajectory(const std::vector<float>& values) {
  Trajectory trajectory(values.size() / 2, 2);
  for (Eigen::Index i = 0; i < trajectory.size(); ++i) trajectory.data()[i] = values[i];
  return trajectory;
}

// Returns whether the decoded generic distributions depend on the scene. p(z|y) itself does not.
bool GenericDependsOnScene(const v1::ModelSpec& spec) {
  return artifact::HasReference(spec) || spec.has_scene_covariance();
}

std::vector<ActionDistribution> DescribeGeneric(const inference::ActionModel& model,
                                                std::span<const int> actions) {
  if (GenericDependsOnScene(model.spec())) return {};
  return model.NewSession()->Describe({}, actions, inference::LatentSource::kPrior);
}

std::vector<int> AllActions(Eigen::Index count) {
  std::vector<int> actions(static_cast<size_t>(count));
  std::iota(actions.begin(), actions.end(), 0);
  return actions;
}

// Returns the course between the waypoints on either side of a time, target frame, radians. It is 0
// if the target stays where it is.
//   trajectory: [T, 2] target frame, metres;  waypoint_times: [T] seconds
//   time: seconds after the prediction time, at most the last waypoint's
double CourseAt(const Trajectory& trajectory, std::span<const double> waypoint_times, double time) {
  const auto after = std::ranges::lower_bound(waypoint_times, time - scene::kSameTime);
  const Eigen::Index row = after - waypoint_times.begin();
  Eigen::RowVector2d step = trajectory.row(row);
  if (row > 0) step -= trajectory.row(row - 1);
  return std::atan2(step.y(), step.x());
}

ExampleTruth TruthOf(const data::Example& example, const MeasuringContext& context) {
  const v1::Scenario& recording = context.recordings[static_cast<size_t>(example.recording)];
  const v1::Agent& agent = *scene::FindAgent(recording, example.target_id);
  ExampleTruth truth{agent, MotionAt(agent, example.time), ToTrajectory(example.trajectory), {}};
  for (const double time : context.waymo.measured_times()) {
    const int index =
        scene::FindState(agent, example.time + time, context.window.max_gap(), HUGE_VAL);
    // Between two waypoints the track may have a gap.
    truth.headings.push_back(index >= 0 ? agent.states(index).heading() - example.X_WT.heading()
                                        : CourseAt(truth.trajectory, context.waypoint_times, time));
  }
  return truth;
}

WaymoErrors WaymoErrorsOf(std::span<const Trajectory> ranked, int k, const ExampleTruth& truth,
                          const MeasuringContext& context) {
  if (context.waymo.measured_times().empty()) return {};
  return context.waymo.BestOf(ranked, k, truth.trajectory, truth.headings, truth.motion.speed());
}

BaselineErrors BaselineErrorsOf(const Trajectory& predicted, const ExampleTruth& truth,
                                const MeasuringContext& context) {
  return {ErrorsOf(predicted, truth.trajectory), WaymoErrorsOf({&predicted, 1}, 1, truth, context)};
}

// Returns all actions, most probable first.
std::vector<int> Ranked(const Eigen::VectorXd& probabilities) {
  std::vector<int> ranked = AllActions(probabilities.size());
  std::stable_sort(ranked.begin(), ranked.end(),
                   [&](int a, int b) { return probabilities[a] > probabilities[b]; });
  return ranked;
}

// The mean trajectories of the most probable actions, most probable first.
struct RankedMeans {
  std::vector<Trajectory> trajectories;
  std::vector<double> probabilities;
};

//   distributions: of the actions 0 .. K-1;  ranked: the actions, most probable first
RankedMeans MeansOf(std::span<const ActionDistribution> distributions,
                    const Eigen::VectorXd& probabilities, std::span<const int> ranked) {
  RankedMeans means;
  for (const int action : ranked.first(std::min<size_t>(kRanks.back(), ranked.size()))) {
    means.trajectories.push_back(distributions[static_cast<size_t>(action)].mean());
    means.probabilities.push_back(probabilities[action]);
  }
  return means;
}

// Returns the mean trajectories of the representatives in the order of choice, with their weights.
//   distributions: of the actions 0 .. K-1
RankedMeans CoverOf(std::span<const ActionDistribution> distributions,
                    const Eigen::VectorXd& probabilities, double waypoint_interval) {
  const std::vector<int> candidates = inference::RepresentativeCandidates(probabilities);
  inference::TrajectorySet::Rows rows(static_cast<Eigen::Index>(candidates.size()),
                                      distributions.front().mean().size());
  for (size_t n = 0; n < candidates.size(); ++n) {
    const auto mean = distributions[static_cast<size_t>(candidates[n])].mean();
    rows.row(static_cast<Eigen::Index>(n)) =
        Eigen::Map<const Eigen::RowVectorXd>(mean.data(), mean.size());
  }
  RankedMeans cover;
  for (const inference::Representative& each : inference::ChooseRepresentatives(
           probabilities, candidates, inference::TrajectorySet(std::move(rows)), waypoint_interval,
           kRanks.back())) {
    cover.trajectories.push_back(distributions[static_cast<size_t>(each.action)].mean());
    cover.probabilities.push_back(each.weight);
  }
  return cover;
}

SourceMeasurement MeasureSource(std::span<const ActionDistribution> distributions,
                                const RankedMeans& means, const Eigen::VectorXd& probabilities,
                                int action, const Trajectory& truth) {
  SourceMeasurement measured;
  for (size_t i = 0; i < kRanks.size(); ++i) {
    measured.displacement[i] = BestOf(means.trajectories, means.probabilities, kRanks[i], truth);
  }
  const ActionDistribution& own = distributions[static_cast<size_t>(action)];
  measured.nll = MixtureNllOf(
      distributions, {probabilities.data(), static_cast<size_t>(probabilities.size())}, truth);
  measured.action_nll = GaussianNll(own, truth);
  measured.envelope = EnvelopeOf(own, truth);
  return measured;
}

}  // namespace

std::vector<ActionDistribution> MeasureAnswer(const inference::SceneEncoding& encoding,
                                              const Trajectory& truth,
                                              inference::InferenceSession& session,
                                              Measurement* measured) {
  measured->probabilities = encoding.probabilities;
  measured->responsibilities = session.Classify(encoding, truth).responsibilities;
  measured->responsibilities.maxCoeff(&measured->action);
  std::vector<ActionDistribution> posterior = session.Describe(
      encoding, AllActions(encoding.probabilities.size()), inference::LatentSource::kPosterior);
  const RankedMeans means =
      MeansOf(posterior, encoding.probabilities, Ranked(encoding.probabilities));
  measured->posterior =
      MeasureSource(posterior, means, encoding.probabilities, measured->action, truth);
  return posterior;
}

MeasuringContext::MeasuringContext(const inference::ActionModel& measured_model,
                                   std::span<const v1::Scenario> measured_recordings,
                                   const ManeuverLabels& measured_labels,
                                   const inference::AnchorBaselines* measured_baselines)
    : model(measured_model),
      recordings(measured_recordings),
      labels(measured_labels),
      all_actions(AllActions(model.spec().actions())),
      generic(DescribeGeneric(model, all_actions)),
      waypoint_times(artifact::WaypointTimes(model.spec().trajectory())),
      waymo(waypoint_times),
      window(scene::WindowOf(model.spec())),
      baselines(measured_baselines) {
  for (const v1::Scenario& recording : recordings) {
    maps.push_back(scene::RoadMap::Over(recording.map_features()));
  }
}

Measurer::Measurer(const MeasuringContext& context)
    : context_(context),
      session_(context.model.NewSession()),
      reader_(context.model.spec()),
      inputs_(kBatch, reader_.NewInputs()),
      encodings_(kBatch) {
  if (context.baselines == nullptr) return;
  covernet_ = context.baselines->covernet->NewSession();
  multipath_ = context.baselines->multipath->NewSession();
}

void Measurer::Measure(std::span<const data::Example> examples, std::span<Measurement> measured) {
  std::vector<inference::SceneInputsView> scenes;
  for (size_t i = 0; i < examples.size(); ++i) {
    const auto recording = static_cast<size_t>(examples[i].recording);
    reader_.Read(context_.recordings[recording], context_.maps[recording], examples[i].time,
                 examples[i].target_id, examples[i].X_WT, &inputs_[i]);
    scenes.push_back(inference::ViewOf(inputs_[i]));
  }
  session_->Encode(scenes, std::span(encodings_).first(examples.size()));
  std::vector<ExampleTruth> truths;
  for (size_t i = 0; i < examples.size(); ++i) {
    truths.push_back(TruthOf(examples[i], context_));
    measured[i] = MeasureOne(examples[i], truths[i], encodings_[i]);
  }
  if (context_.baselines == nullptr) return;
  MeasureAnchors(scenes, truths, *context_.baselines->covernet, *covernet_, &Measurement::covernet,
                 measured);
  MeasureAnchors(scenes, truths, *context_.baselines->multipath, *multipath_,
                 &Measurement::multipath, measured);
}

void Measurer::MeasureAnchors(std::span<const inference::SceneInputsView> scenes,
                              std::span<const ExampleTruth> truths,
                              const inference::AnchorModel& model,
                              inference::InferenceSession& session,
                              std::optional<AnchorMeasurement> Measurement::*field,
                              std::span<Measurement> measured) {
  session.Encode(scenes, std::span(encodings_).first(scenes.size()));
  for (size_t i = 0; i < scenes.size(); ++i) {
    const ExampleTruth& truth = truths[i];
    const Eigen::VectorXd& probabilities = encodings_[i].probabilities;
    const std::vector<ActionDistribution> distributions =
        model.Describe(encodings_[i], &anchor_scratch_);
    const RankedMeans means = MeansOf(distributions, probabilities, Ranked(probabilities));
    AnchorMeasurement& anchors = (measured[i].*field).emplace();
    anchors.probabilities = probabilities;
    anchors.nearest = model.Nearest(encodings_[i], truth.trajectory);
    for (size_t rank = 0; rank < kRanks.size(); ++rank) {
      anchors.displacement[rank] =
          BestOf(means.trajectories, means.probabilities, kRanks[rank], truth.trajectory);
      anchors.waymo[rank] = WaymoErrorsOf(means.trajectories, kRanks[rank], truth, context_);
    }
    anchors.nll = MixtureNllOf(distributions,
                               {probabilities.data(), static_cast<size_t>(probabilities.size())},
                               truth.trajectory);
  }
}

Measurement Measurer::MeasureOne(const data::Example& example, const ExampleTruth& truth,
                                 const inference::SceneEncoding& encoding) {
  const v1::Scenario& recording = context_.recordings[static_cast<size_t>(example.recording)];
  const v1::Agent& agent = truth.agent;
  const Motion& motion = truth.motion;

  Measurement measured;
  const std::vector<ActionDistribution> posterior =
      MeasureAnswer(encoding, truth.trajectory, *session_, &measured);
  const std::vector<int> ranked = Ranked(encoding.probabilities);
  const RankedMeans means = MeansOf(posterior, encoding.probabilities, ranked);
  measured.prior = MeasurePrior(encoding, ranked, measured.action, truth.trajectory);
  const RankedMeans cover = CoverOf(posterior, encoding.probabilities,
                                    artifact::WaypointInterval(context_.model.spec().trajectory()));
  for (size_t i = 0; i < kRanks.size(); ++i) {
    measured.waymo[i] = WaymoErrorsOf(means.trajectories, kRanks[i], truth, context_);
    measured.cover[i] =
        BestOf(cover.trajectories, cover.probabilities, kRanks[i], truth.trajectory);
  }
  measured.constant_velocity =
      BaselineErrorsOf(ConstantVelocity(motion, context_.waypoint_times), truth, context_);
  measured.constant_turn = BaselineErrorsOf(
      ConstantTurnRateAndAcceleration(motion, context_.waypoint_times), truth, context_);
  measured.faded = BaselineErrorsOf(
      FadedRollOut(agent, example.time, example.X_WT, context_.waypoint_times), truth, context_);

  measured.maneuver = context_.labels.Over(recording.scenario_id(), example.target_id, example.time,
                                           example.time + context_.waypoint_times.back());
  measured.keys = {
      AgentsAt(recording, example.time, context_.window.tolerance()),
      motion.speed(),
      FinalHeadingChange(truth.trajectory),
      Classify(truth.trajectory, context_.waypoint_times, agent.type()),
      agent.type(),
      MapFeaturesNear(context_.maps[static_cast<size_t>(example.recording)], example.X_WT)};
  measured.relative_class =
      ClassifyRelative(truth.trajectory, context_.waypoint_times, motion.speed(), agent.type());
  return measured;
}

SourceMeasurement Measurer::MeasurePrior(const inference::SceneEncoding& encoding,
                                         std::span<const int> ranked, int action,
                                         const Trajectory& truth) {
  const auto measure = [&](std::span<const ActionDistribution> generic) {
    return MeasureSource(generic, MeansOf(generic, encoding.probabilities, ranked),
                         encoding.probabilities, action, truth);
  };
  if (!context_.generic.empty()) return measure(context_.generic);
  return measure(
      session_->Describe(encoding, context_.all_actions, inference::LatentSource::kPrior));
}

}  // namespace maneuver::evaluation
