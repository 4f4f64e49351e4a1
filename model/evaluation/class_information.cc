#include "model/evaluation/class_information.h"

namespace maneuver::evaluation {

double ClassInformation::ExplainedShare() const {
  constexpr double kRounding = 1e-9;  // nats
  double explained = 0.0;             // sums over the examples, nats
  double explicable = 0.0;
  double examples = 0.0;
  for (const auto& [_, table] : tables_) {
    const auto weight = static_cast<double>(table.total());
    const double by_chance = table.ExpectedMutualInformation();
    explained += weight * (table.MutualInformation() - by_chance);
    explicable += weight * (table.LabelEntropy() - by_chance);
    examples += weight;
  }
  return explicable <= kRounding * examples ? 0.0 : explained / explicable;
}

}  // namespace maneuver::evaluation
