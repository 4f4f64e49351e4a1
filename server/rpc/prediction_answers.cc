#include "server/rpc/prediction_answers.h"

#include "absl/strings/str_cat.h"
#include "maneuver/v1/status.pb.h"
#include "model/kernels/points.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

using serving::TargetAnswer;

void WriteVector(const Eigen::VectorXd& values, google::protobuf::RepeatedField<double>* field) {
  field->Assign(values.data(), values.data() + values.size());
}

// Room for `count` more values.
double* Append(int count, google::protobuf::RepeatedField<double>* field) {
  field->Reserve(field->size() + count);
  return field->AddNAlreadyReserved(count);
}

// Puts positions and covariances of the target's frame into the frame of the answer.
class FrameChange {
 public:
  // X_AT: pose of the target in the answer's frame A.
  explicit FrameChange(const scene::Pose2& X_AT) : X_AT_(X_AT) {}

  void Write(const Eigen::Ref<const inference::Trajectory>& trajectory,
             v1::Trajectory* proto) const {
    Write(trajectory, proto->mutable_x(), proto->mutable_y());
  }

  void Write(const Eigen::Ref<const inference::Trajectory>& trajectory,
             google::protobuf::RepeatedField<double>* x,
             google::protobuf::RepeatedField<double>* y) const {
    const int waypoints = static_cast<int>(trajectory.rows());
    double* const x_A = Append(waypoints, x);
    double* const y_A = Append(waypoints, y);
    if (trajectory.outerStride() == 2) {
      kernels::MovePoints(
          {.x = X_AT_.x(), .y = X_AT_.y(), .cosine = X_AT_.cosine(), .sine = X_AT_.sine()},
          trajectory.data(), static_cast<size_t>(waypoints), x_A, y_A);
      return;
    }
    for (int t = 0; t < waypoints; ++t) {
      const scene::Point2 p_A = X_AT_ * scene::Point2{trajectory(t, 0), trajectory(t, 1)};
      x_A[t] = p_A.x;
      y_A[t] = p_A.y;
    }
  }

  // R [xx xy; xy yy] R^T, with R the rotation of X_AT.
  void WriteCovariances(
      const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>& covariances,
      v1::WaypointMoments* proto) const {
    const double c = X_AT_.cosine();
    const double s = X_AT_.sine();
    const int waypoints = static_cast<int>(covariances.rows());
    double* const xx_A = Append(waypoints, proto->mutable_covariance_xx());
    double* const xy_A = Append(waypoints, proto->mutable_covariance_xy());
    double* const yy_A = Append(waypoints, proto->mutable_covariance_yy());
    for (int t = 0; t < waypoints; ++t) {
      const double xx = covariances(t, 0);
      const double xy = covariances(t, 1);
      const double yy = covariances(t, 2);
      xx_A[t] = c * c * xx - 2.0 * c * s * xy + s * s * yy;
      xy_A[t] = c * s * (xx - yy) + (c * c - s * s) * xy;
      yy_A[t] = s * s * xx + 2.0 * c * s * xy + c * c * yy;
    }
  }

 private:
  const scene::Pose2 X_AT_;
};

void WriteDistribution(const inference::ActionDistribution& action, double probability,
                       const FrameChange& frame, bool sigma_trajectories,
                       v1::ActionDistribution* proto) {
  proto->set_action_id(action.action);
  proto->set_probability(probability);
  WriteVector(action.latent_mean, proto->mutable_latent_mean());
  WriteVector(action.latent_stddev, proto->mutable_latent_stddev());
  frame.Write(action.mean(), proto->mutable_mean_trajectory());
  if (sigma_trajectories) {
    for (size_t p = 0; p < action.sigma.size(); ++p) {
      frame.Write(action.sigma[p], proto->add_sigma_trajectories());
    }
  }
  v1::WaypointMoments* moments = proto->mutable_moments();
  frame.Write(action.moment_mean, moments->mutable_mean_x(), moments->mutable_mean_y());
  frame.WriteCovariances(action.moment_covariance, moments);
}

// Walks over the plan: writes errors and warnings, and calls `write` for each target with an answer.
template <typename ScenarioProto, typename WriteTarget>
void WriteItems(const Scenarios& scenarios, const PredictionPlan& plan,
                const std::vector<TargetAnswer>& answers,
                google::protobuf::RepeatedPtrField<ScenarioProto>* items,
                const WriteTarget& write) {
  for (int s = 0; s < scenarios.size(); ++s) {
    const PlannedScenario& planned = plan.scenarios[static_cast<size_t>(s)];
    ScenarioProto* item = items->Add();
    item->set_scenario_index(s);
    // A longer one is not valid, and could take any memory.
    if (const std::string& id = scenarios[s].scenario_id(); id.size() <= kMostScenarioIdBytes) {
      item->set_scenario_id(id);
    }
    if (!planned.status.ok()) {
      *item->mutable_error() = errors::ToProto(planned.status);
      continue;
    }
    for (const scene::FieldViolation& warning : planned.warnings) {
      v1::SceneWarning* proto = item->add_warnings();
      proto->set_field(absl::StrCat("scenarios[", s, "].", warning.field));
      proto->set_description(warning.description);
    }
    for (const PlannedTarget& target : planned.targets) {
      auto* proto = item->add_targets();
      proto->set_target_id(target.id);
      if (!target.status.ok()) {
        *proto->mutable_error() = errors::ToProto(target.status);
      } else if (const TargetAnswer& answer = answers[target.index]; !answer.status.ok()) {
        v1::Status* error = proto->mutable_error();
        *error = errors::ToProto(answer.status);
        error->set_message(absl::StrCat("scenarios[", s, "].target_ids[", item->targets_size() - 1,
                                        "]: ", error->message()));
      } else {
        write(plan.targets[target.index], answer, proto);
      }
    }
  }
}

void WriteJoint(const PredictionPlan& plan, const serving::JointAnswer& answer,
                v1::JointPrediction* proto) {
  for (const size_t i : answer.targets) proto->add_target_ids(plan.targets[i].id);
  for (const inference::JointCombination& each : answer.found.combinations) {
    v1::JointCombination* combination = proto->add_combinations();
    combination->mutable_action_ids()->Assign(each.actions.begin(), each.actions.end());
    combination->set_log_probability(each.log_probability);
    combination->set_weight(each.weight);
  }
  proto->set_truncated(answer.found.truncated);
}

}  // namespace

void WritePredictions(const Scenarios& scenarios, const PredictionPlan& plan,
                      const std::vector<TargetAnswer>& answers, const AnswerStyle& style,
                      google::protobuf::RepeatedPtrField<v1::ScenarioPrediction>* predictions,
                      std::span<const serving::JointAnswer> joint) {
  const int first = predictions->size();
  WriteItems(
      scenarios, plan, answers, predictions,
      [&](const serving::Target& target, const TargetAnswer& answer, v1::TargetPrediction* proto) {
        if (style.probabilities) {
          WriteVector(answer.encoding.probabilities, proto->mutable_probabilities());
        }
        const bool in_target_frame = style.frame == v1::FRAME_TARGET;
        const FrameChange frame(in_target_frame ? scene::Pose2() : target.X_WT);
        for (const inference::ActionDistribution& action : answer.distributions) {
          WriteDistribution(action, answer.encoding.probabilities[action.action], frame,
                            style.sigma_trajectories, proto->add_distributions());
        }
        for (const inference::Representative& each : answer.representatives) {
          v1::Representative* representative = proto->add_representatives();
          representative->set_action_id(each.action);
          representative->set_weight(each.weight);
        }
      });
  for (const serving::JointAnswer& answer : joint) {
    if (answer.targets.empty()) continue;
    const v1::Scenario* scenario = plan.targets[answer.targets.front()].scenario;
    int s = 0;
    while (&scenarios[s] != scenario) ++s;
    WriteJoint(plan, answer, predictions->Mutable(first + s)->mutable_joint());
  }
}

void WriteClassifications(
    const Scenarios& scenarios, const PredictionPlan& plan,
    const std::vector<TargetAnswer>& answers,
    google::protobuf::RepeatedPtrField<v1::ScenarioClassification>* classifications) {
  WriteItems(
      scenarios, plan, answers, classifications,
      [](const serving::Target&, const TargetAnswer& answer, v1::TargetClassification* proto) {
        WriteVector(answer.classification->responsibilities, proto->mutable_responsibilities());
        WriteVector(answer.encoding.probabilities, proto->mutable_probabilities());
        proto->set_log_likelihood_bound(answer.classification->log_likelihood_bound);
      });
}

}  // namespace maneuver::rpc
