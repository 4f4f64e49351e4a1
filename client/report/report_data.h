// The content of a report, gathered from a server.

#ifndef MANEUVER_CLIENT_REPORT_REPORT_DATA_H_
#define MANEUVER_CLIENT_REPORT_REPORT_DATA_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/report/learning_curves.h"
#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/model_service.pb.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::report {

// One example: a target at a time, what it did, and what the model predicted for it.
struct Scene {
  std::shared_ptr<const v1::Scenario> recording;
  int64_t target_id = 0;
  double time = 0.0;                     // the prediction time, on the recording's clock, seconds
  scene::Pose2 X_WT;                     // of the target at that time
  double speed = 0.0;                    // of the target at that time, m/s
  v1::Trajectory truth;                  // what it did, target frame, metres [T]
  std::string kinematic_class;           // of the truth: "left_turn"
  v1::TargetPrediction prediction;       // target frame
  std::vector<double> responsibilities;  // q(y|x,s) [K]
  double ade_1 = 0.0;                    // error of the most probable action's mean, metres
  double min_ade_6 = 0.0;                // smallest error among the six most probable ones, metres
  double surprise = 0.0;                 // -ln p(y|s) of the action that it was, nats
  std::vector<std::string> groups;       // why it was chosen: "worst", "best", ...
};

// Why a part of the report is empty, and the command that fills it.
struct Missing {
  std::string reason;
  std::string command;  // empty: none does
};

struct ReportData {
  std::string title;                        // "town/3"
  std::string made;                         // when the report was made, for people
  std::string program;                      // "maneuver 0.1.0"
  std::optional<v1::ModelVersion> version;  // the version that the report is about
  std::vector<v1::ActionSet> action_sets;   // at several speeds, or one for all speeds
  std::optional<v1::EvaluationReport> evaluation;
  std::vector<v1::EvaluationReport> others;  // other versions on the same examples
  std::vector<LearningPhase> learning;       // curves of the training
  std::optional<v1::Job> job;                // the job that trains the version, or trained it
  std::string scenes_from;                   // datasets/NAME that the scenes are from
  std::vector<Scene> scenes;                 // in the order in which they are shown
  // By part: actions, evaluation, learning, scenes, settings.
  std::map<std::string, Missing> missing;
};

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_REPORT_DATA_H_
