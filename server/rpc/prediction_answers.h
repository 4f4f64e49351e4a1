// Writes the answer to a prediction request: converts what the workers computed to messages, in the
// frame that the caller asked for.

#ifndef MANEUVER_SERVER_RPC_PREDICTION_ANSWERS_H_
#define MANEUVER_SERVER_RPC_PREDICTION_ANSWERS_H_

#include <span>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"
#include "server/rpc/prediction_plan.h"
#include "server/serving/prediction_call.h"

namespace maneuver::rpc {

// The parts that an answer contains, and its frame.
struct AnswerStyle {
  bool probabilities = true;
  bool sigma_trajectories = true;
  v1::Frame frame = v1::FRAME_WORLD;
};

// Append an item for each scenario, with errors where there is no answer.
//   answers: one for each of plan.targets, in the same order
//   joint: one for each scenario with planned targets, in their order; empty: not asked for
void WritePredictions(const Scenarios& scenarios, const PredictionPlan& plan,
                      const std::vector<serving::TargetAnswer>& answers, const AnswerStyle& style,
                      google::protobuf::RepeatedPtrField<v1::ScenarioPrediction>* predictions,
                      std::span<const serving::JointAnswer> joint = {});
void WriteClassifications(
    const Scenarios& scenarios, const PredictionPlan& plan,
    const std::vector<serving::TargetAnswer>& answers,
    google::protobuf::RepeatedPtrField<v1::ScenarioClassification>* classifications);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_ANSWERS_H_
