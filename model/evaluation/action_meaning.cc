#include "model/evaluation/action_meaning.h"

#include <algorithm>
#include <string>

#include "model/evaluation/class_information.h"
#include "model/evaluation/clustering.h"
#include "model/evaluation/kinematic_classes.h"
#include "model/evaluation/relative_classes.h"

namespace maneuver::evaluation {
namespace {

// Agreement of the actions with one set of classes.
struct Agreement {
  ContingencyTable all;
  ClassInformation given_speed;

  void Add(int speed, int action, int label) {
    all.Add(action, label);
    given_speed.Add(speed, action, label);
  }
};

int SpeedStratum(const Measurement& measured) {
  static const Stratification& by_speed =
      *std::ranges::find(Stratifications(), "speed", &Stratification::dimension);
  return by_speed.stratum(measured.keys);
}

// Returns the class of what changes: a vehicle that goes on standing keeps its speed of zero.
RelativeClass ChangeOfMotion(RelativeClass relative_class) {
  return relative_class == RelativeClass::kStands ? RelativeClass::kKeepsSpeed : relative_class;
}

void AddMetrics(const Agreement& agreement, const std::string& suffix,
                v1::EvaluationReport& report) {
  auto& metrics = *report.mutable_metrics();
  metrics["nmi" + suffix] = agreement.all.NormalizedMutualInformation();
  metrics["purity" + suffix] = agreement.all.Purity();
  metrics["class_information" + suffix] = agreement.given_speed.ExplainedShare();
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

void AddMeaning(std::span<const Measurement> measured, v1::EvaluationReport& report) {
  Agreement kinematic;
  Agreement relative;
  ContingencyTable motions;
  ContingencyTable maneuvers;
  for (const Measurement& each : measured) {
    const int speed = SpeedStratum(each);
    kinematic.Add(speed, each.action, static_cast<int>(each.keys.kinematic_class));
    relative.Add(speed, each.action, static_cast<int>(each.relative_class));
    motions.Add(each.action, static_cast<int>(ChangeOfMotion(each.relative_class)));
    if (each.maneuver) maneuvers.Add(each.action, *each.maneuver);
  }
  AddMetrics(kinematic, "_kinematic", report);
  AddMetrics(relative, "_relative", report);
  AddUses(kinematic.all, relative.all, report);
  auto& metrics = *report.mutable_metrics();
  metrics["named_share_relative"] = relative.all.ShareInClustersOfPurity(kNamedPurity);
  metrics["named_share_motion"] = motions.ShareInClustersOfPurity(kNamedPurity);
  if (maneuvers.total() == 0) return;
  metrics["nmi"] = maneuvers.NormalizedMutualInformation();
  metrics["purity"] = maneuvers.Purity();
  metrics["labelled_examples"] = static_cast<double>(maneuvers.total());
}

}  // namespace maneuver::evaluation
