#include "model/evaluation/cost_text.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace maneuver::evaluation {
namespace {

// Returns three digits: "850", "24.6 M", "5.08 G".
std::string InThousands(int64_t count) {
  double value = static_cast<double>(count);
  const char* unit = "";
  for (const char* next : {" k", " M", " G", " T"}) {
    if (value < 999.5) break;
    value /= 1000.0;
    unit = next;
  }
  const bool whole = *unit == '\0' || value >= 99.95;
  return absl::StrFormat("%.*f%s", whole ? 0 : value >= 9.995 ? 1 : 2, value, unit);
}

}  // namespace

std::string BackboneCostText(const v1::ModelCost& cost) {
  return absl::StrCat(InThousands(cost.backbone_parameters()), " parameters, ",
                      InThousands(cost.backbone_multiply_adds()), " multiply-adds a target");
}

std::string ModelCostText(const v1::ModelCost& cost) {
  return absl::StrCat(InThousands(cost.parameters()), " parameters; multiply-adds: ",
                      InThousands(cost.backbone_multiply_adds() + cost.vector_multiply_adds() +
                                  cost.predictor_multiply_adds()),
                      " for p(y|s), ", InThousands(cost.distribution_multiply_adds()),
                      " for each action described");
}

}  // namespace maneuver::evaluation
