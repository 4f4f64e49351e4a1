#include "model/evaluation/action_meaning.h"

#include <algorithm>
#include <string>

#include "model/evaluation/kinematic_classes.h"
#include "model/evaluation/relative_classes.h"

namespace maneuver::evaluation {
namespace {

int SpeedStratum(const Measurement& measured) {
  static const Stratification& by_speed =
      *std::ranges::find(Stratifications(), "speed", &Stratification::dimension);
  return by_speed.stratum(measured.keys);
}

// Returns the class of what changes: a vehicle that goes on standing keeps its speed of zero.
RelativeClass ChangeOfMotion(RelativeClass relative_class) {
  return relative_class == RelativeClass::kStands ? RelativeClass::kKeepsSpeed : relative_class;
}

void AddUses(const ContingencyTable& kinematic, const ContingencyTable& relative,
             v1::EvaluationReport& report) {
  for (const auto& [action, majority] : kinematic.Majorities()) {
    v1::ActionUse& use = *report.mutable_action_uses(action);
    use.set_examples(majority.total);
    use.set_kinematic_class(std::string(Name(static_cast<KinematicClass>(majority.label))));
    use.set_class_share(majority.Purity());
  }
  for (const auto& [action, majority] : relative.Majorities()) {
    v1::ActionUse& use = *report.mutable_action_uses(action);
    use.set_relative_class(std::string(Name(static_cast<RelativeClass>(majority.label))));
    use.set_relative_class_share(majority.Purity());
  }
}

}  // namespace

void ActionMeaning::Agreement::Write(const std::string& suffix,
                                     v1::EvaluationReport& report) const {
  auto& metrics = *report.mutable_metrics();
  metrics["nmi" + suffix] = all.NormalizedMutualInformation();
  metrics["purity" + suffix] = all.Purity();
  metrics["class_information" + suffix] = given_speed.ExplainedShare();
}

void ActionMeaning::Add(const Measurement& measured) {
  const int speed = SpeedStratum(measured);
  kinematic_.Add(speed, measured.action, static_cast<int>(measured.keys.kinematic_class));
  relative_.Add(speed, measured.action, static_cast<int>(measured.relative_class));
  motions_.Add(measured.action, static_cast<int>(ChangeOfMotion(measured.relative_class)));
  if (measured.maneuver) maneuvers_.Add(measured.action, *measured.maneuver);
}

void ActionMeaning::Add(const ActionMeaning& other) {
  kinematic_.Add(other.kinematic_);
  relative_.Add(other.relative_);
  motions_.Add(other.motions_);
  maneuvers_.Add(other.maneuvers_);
}

void ActionMeaning::Write(v1::EvaluationReport& report) const {
  kinematic_.Write("_kinematic", report);
  relative_.Write("_relative", report);
  AddUses(kinematic_.all, relative_.all, report);
  auto& metrics = *report.mutable_metrics();
  metrics["named_share_relative"] = relative_.all.ShareInClustersOfPurity(kNamedPurity);
  metrics["named_share_motion"] = motions_.ShareInClustersOfPurity(kNamedPurity);
  if (maneuvers_.total() == 0) return;
  metrics["nmi"] = maneuvers_.NormalizedMutualInformation();
  metrics["purity"] = maneuvers_.Purity();
  metrics["labelled_examples"] = static_cast<double>(maneuvers_.total());
}

}  // namespace maneuver::evaluation
