// What actions mean: how well they agree with classes of trajectories that training never used.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_MEANING_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_MEANING_H_

#include <string>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/class_information.h"
#include "model/evaluation/clustering.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// An action gets a name if at least this share of its examples is of one relative class.
inline constexpr double kNamedPurity = 0.7;

// The agreement of actions (argmax q(y|x,s)) with recorded manoeuvres, kinematic classes and
// relative classes. Counts, so its memory does not grow with the examples.
class ActionMeaning {
 public:
  void Add(const Measurement& measured);
  // Adds the examples of another agreement with the same actions.
  void Add(const ActionMeaning& other);

  // Sets the agreement under the names of evaluator.h, and the classes in `action_uses`.
  //   report: must have one element of action_uses for each action.
  void Write(v1::EvaluationReport& report) const;

 private:
  // Agreement with one set of classes.
  struct Agreement {
    ContingencyTable all;
    ClassInformation given_speed;

    void Add(int speed, int action, int label) {
      all.Add(action, label);
      given_speed.Add(speed, action, label);
    }
    void Add(const Agreement& other) {
      all.Add(other.all);
      given_speed.Add(other.given_speed);
    }
    void Write(const std::string& suffix, v1::EvaluationReport& report) const;
  };

  Agreement kinematic_;
  Agreement relative_;
  ContingencyTable motions_;  // relative classes, *stands* counted as *keeps speed*
  ContingencyTable maneuvers_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_MEANING_H_
