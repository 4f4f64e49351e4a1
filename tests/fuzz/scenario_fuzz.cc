// A scene and its answer, in process: refused by field path, or answered soundly, with the same bits
// alone, in a batch, and with its map registered.

#include <google/protobuf/text_format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/inference/action_model.h"
#include "model/scene/observation_window.h"
#include "model/scene/target_frame.h"
#include "server/rpc/prediction_answers.h"
#include "server/rpc/prediction_plan.h"
#include "server/serving/answer_check.h"
#include "server/serving/joint_answer.h"
#include "tests/fuzz/harness.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::fuzz {
namespace {

using google::protobuf::RepeatedField;

// Small networks with every part at work: raster, history, lane paths, agents, geometry.
constexpr char kEverything[] = R"pb(
  raster {
    height: 32
    width: 32
    meters_per_pixel: 2
    target_position: 0.3
    history_frames: 2
    frame_interval { nanos: 500000000 }
  }
  backbone {
    convolutions { channels: 5 stride: 2 }
    convolutions { channels: 9 stride: 2 }
    features: 14
  }
  trajectory {
    waypoints: 11
    waypoint_interval { nanos: 300000000 }
  }
  actions: 5
  latent_dimensions: 3
  action_predictor { hidden: 13 }
  trajectory_encoder { hidden: 21 }
  decoder { hidden: [ 18, 19 ] }
  scenario_encoder { hidden: 17 }
  decoder_stddev: 0.8
  target_motion: true
  reference: TRAJECTORY_REFERENCE_FADING_MOTION
  scene_vectors {
    history_width: 7
    path_width: 15
    attention_heads: 3
    features: 23
    agent_width: 14
    agent_heads: 2
  }
  action_geometry { pair_width: 10 attention_heads: 5 features: 11 }
  mean_residual: true
  scene_covariance { hidden: [ 6, 7 ] }
)pb";

// Beyond this many targets nothing new happens.
constexpr size_t kMostTargets = 4;
constexpr int kCombinations = 5;

const inference::ActionModel& Model() {
  static const auto& model = *new std::shared_ptr<const inference::ActionModel>([] {
    v1::ModelSpec spec;
    Expect(google::protobuf::TextFormat::ParseFromString(kEverything, &spec), "the spec parses");
    auto made = inference::ActionModel::FromStored(inference::RandomModel(spec, 5),
                                                   {.precision = inference::Precision::kF32});
    Expect(made.ok(), made.status().ToString());
    return *std::move(made);
  }());
  return *model;
}

template <typename Vector>
bool SameBits(const Vector& a, const Vector& b) {
  if (a.size() != b.size()) return false;
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    if (a.data()[i] != b.data()[i] || std::signbit(a.data()[i]) != std::signbit(b.data()[i]))
      return false;
  }
  return true;
}

void ExpectSameEncoding(const inference::SceneEncoding& a, const inference::SceneEncoding& b,
                        const char* what) {
  Expect(SameBits(a.features, b.features) && SameBits(a.probabilities, b.probabilities) &&
             SameBits(a.geometry, b.geometry) && SameBits(a.reference, b.reference) &&
             std::bit_cast<uint64_t>(a.speed) == std::bit_cast<uint64_t>(b.speed),
         what);
}

void ExpectDistribution(const RepeatedField<double>& probabilities, const char* what) {
  double sum = 0.0;
  for (const double p : probabilities) {
    Expect(p >= 0.0 && p <= 1.0 + 1e-9, what);
    sum += p;
  }
  Expect(std::abs(sum - 1.0) <= 1e-5, what);
}

void ExpectFinite(const RepeatedField<double>& values, const char* what) {
  for (const double value : values) Expect(std::isfinite(value), what);
}

// As it leaves the server, in the world's frame. By itself, not by CheckAnswer.
void ExpectSound(const v1::TargetPrediction& target) {
  ExpectDistribution(target.probabilities(), "p(y|s) is a distribution");
  for (const v1::ActionDistribution& action : target.distributions()) {
    ExpectFinite(action.latent_mean(), "the latent mean is finite");
    ExpectFinite(action.latent_stddev(), "the latent deviation is finite");
    ExpectFinite(action.mean_trajectory().x(), "the mean is finite");
    ExpectFinite(action.mean_trajectory().y(), "the mean is finite");
    for (const auto& sigma : action.sigma_trajectories()) {
      ExpectFinite(sigma.x(), "sigma points are finite");
      ExpectFinite(sigma.y(), "sigma points are finite");
    }
    const v1::WaypointMoments& moments = action.moments();
    ExpectFinite(moments.mean_x(), "the moments are finite");
    ExpectFinite(moments.mean_y(), "the moments are finite");
    for (int t = 0; t < moments.covariance_xx_size(); ++t) {
      const double xx = moments.covariance_xx(t);
      const double xy = moments.covariance_xy(t);
      const double yy = moments.covariance_yy(t);
      Expect(std::isfinite(xx) && std::isfinite(xy) && std::isfinite(yy), "covariances are finite");
      // The smaller eigenvalue, within rounding of the larger one.
      const double half = 0.5 * (xx + yy);
      const double radius = std::hypot(0.5 * (xx - yy), xy);
      Expect(half - radius >= -1e-5 * (half + radius), "covariances are positive semi-definite");
    }
  }
  double weights = 0.0;
  for (const auto& each : target.representatives()) weights += each.weight();
  Expect(std::abs(weights - 1.0) <= 1e-5, "weights of representatives sum to 1");
}

// The combinations of a scenario of at most kMostJointTargets targets.
void ExpectJoint(const v1::Scenario& scenario, const v1::ScenarioPrediction& item) {
  const v1::JointPrediction& joint = item.joint();
  std::vector<const v1::TargetPrediction*> targets;
  for (const auto& target : item.targets()) {
    if (!target.has_error()) targets.push_back(&target);
  }
  Expect(joint.target_ids_size() == static_cast<int>(targets.size()), "targets are combined");
  for (size_t i = 0; i < targets.size(); ++i) {
    Expect(joint.target_ids(static_cast<int>(i)) == targets[i]->target_id(), "in their order");
  }
  double weights = 0.0;
  double last = 1.0;  // above ln 1, within rounding
  for (const v1::JointCombination& each : joint.combinations()) {
    Expect(each.action_ids_size() == joint.target_ids_size(), "one action for each target");
    Expect(std::isfinite(each.log_probability()) && each.log_probability() <= last,
           "the most probable first");
    last = each.log_probability();
    weights += each.weight();
    std::vector<const v1::Agent*> agents;
    std::vector<const v1::Trajectory*> means;
    for (size_t i = 0; i < targets.size(); ++i) {
      const int action = each.action_ids(static_cast<int>(i));
      for (const auto& described : targets[i]->distributions()) {
        if (described.action_id() == action) means.push_back(&described.mean_trajectory());
      }
      Expect(means.size() == i + 1, "combined actions are described");
      agents.push_back(scene::FindAgent(scenario, targets[i]->target_id()));
    }
    // By itself: the discs within the rectangles, of targets that are surely apart now.
    for (size_t i = 0; i < targets.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        const auto now = [&](const v1::Agent& agent) {
          return *scene::TargetPose(agent, scenario.prediction_time(),
                                    scene::WindowOf(Model().spec()).tolerance());
        };
        const double apart = std::hypot(now(*agents[i]).x() - now(*agents[j]).x(),
                                        now(*agents[i]).y() - now(*agents[j]).y());
        const auto sum = [&](auto size) { return size(*agents[i]) + size(*agents[j]); };
        const double sides =
            sum([](const v1::Agent& agent) { return agent.length() + agent.width(); });
        const double shorter =
            sum([](const v1::Agent& agent) { return std::min(agent.length(), agent.width()); });
        if (!(apart > sides) || apart > 1e6) continue;
        for (int t = 0; t < means[i]->x_size(); ++t) {
          const double distance =
              std::hypot(means[i]->x(t) - means[j]->x(t), means[i]->y(t) - means[j]->y(t));
          Expect(distance >= 0.5 * shorter - 1e-3, "combined targets do not collide");
        }
      }
    }
  }
  Expect(joint.combinations().empty() || std::abs(weights - 1.0) <= 1e-5,
         "weights of combinations sum to 1");
}

std::vector<inference::SceneEncoding> Encode(const std::vector<scene::SceneInputs>& inputs,
                                             inference::InferenceSession& session) {
  std::vector<inference::SceneInputsView> views;
  views.reserve(inputs.size());
  for (const auto& each : inputs) views.push_back(inference::ViewOf(each));
  std::vector<inference::SceneEncoding> encodings(inputs.size());
  session.Encode(views, encodings);
  return encodings;
}

std::vector<scene::SceneInputs> Read(const std::vector<serving::Target>& targets,
                                     scene::SceneReader& reader) {
  std::vector<scene::SceneInputs> inputs;
  for (const serving::Target& target : targets) {
    inputs.push_back(reader.NewInputs());
    serving::ReadScene(target, reader, &inputs.back());
  }
  return inputs;
}

void AnswerPlan(const rpc::Scenarios& scenarios, bool classify) {
  static auto& session = *Model().NewSession().release();
  static auto& reader = *new scene::SceneReader(Model().spec());
  rpc::PredictionPlan plan = rpc::PlanPrediction(scenarios, Model().spec(), {}, classify);
  const rpc::PlannedScenario& planned = plan.scenarios[0];
  if (!planned.status.ok()) {
    Expect(planned.status.code() == absl::StatusCode::kInvalidArgument, planned.status.ToString());
    return;
  }
  if (plan.targets.empty()) return;

  const auto inputs = Read(plan.targets, reader);
  const auto encodings = Encode(inputs, session);
  const scene::RoadMap registered(scenarios[0].map_features());
  std::vector<serving::TargetAnswer> answers(plan.targets.size());
  const double interval = 0.3;
  for (size_t i = 0; i < plan.targets.size(); ++i) {
    // The inputs of the batch were written into new memory; here they are read again.
    serving::Target target = plan.targets[i];
    if (i < kMostTargets) {
      target.map = &registered;
      const auto alone = Encode(Read({target}, reader), session);
      ExpectSameEncoding(alone[0], encodings[i],
                         "same bits alone, in a batch and with a registered map");
      target.map = nullptr;
      ExpectSameEncoding(Encode(Read({target}, reader), session)[0], encodings[i],
                         "same bits without an index of the map");
    }
    answers[i].encoding = encodings[i];
    if (classify) {
      answers[i].classification = session.Classify(encodings[i], target.trajectory);
    } else {
      const serving::DescribeActions all{.selection = serving::TopK{.k = Model().spec().actions()},
                                         .representatives = 3,
                                         .combinations = kCombinations};
      serving::DescribeTarget(all, encodings[i], interval, session, &answers[i]);
    }
    const absl::Status sound = serving::CheckAnswer(answers[i]);
    Expect(sound.ok(), sound.ToString());
  }

  if (classify) {
    google::protobuf::RepeatedPtrField<v1::ScenarioClassification> items;
    rpc::WriteClassifications(scenarios, plan, answers, &items);
    for (const auto& target : items[0].targets()) {
      if (target.has_error()) continue;
      ExpectDistribution(target.responsibilities(), "q(y|x,s) is a distribution");
      Expect(std::isfinite(target.log_likelihood_bound()), "the bound is finite");
    }
    return;
  }
  const bool combine = plan.targets.size() <= inference::kMostJointTargets;
  std::vector<serving::JointAnswer> joint;
  if (combine) {
    joint.push_back(serving::CombineTargets({.combinations = kCombinations}, plan.targets,
                                            {0, plan.targets.size()}, interval, session, answers));
  }
  google::protobuf::RepeatedPtrField<v1::ScenarioPrediction> items;
  rpc::WritePredictions(scenarios, plan, answers, {}, &items, joint);
  if (combine) ExpectJoint(scenarios[0], items[0]);
  for (const auto& target : items[0].targets()) {
    if (!target.has_error()) ExpectSound(target);
  }
}

}  // namespace

void Scenario(std::string_view bytes) {
  rpc::Scenarios scenarios;
  if (!ParseMessage(bytes, scenarios.Add())) return;
  AnswerPlan(scenarios, false);
  AnswerPlan(scenarios, true);
}

}  // namespace maneuver::fuzz
