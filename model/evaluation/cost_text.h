// Prints the cost of a model for people.

#ifndef MANEUVER_MODEL_EVALUATION_COST_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_COST_TEXT_H_

#include <string>

#include "maneuver/v1/model.pb.h"

namespace maneuver::evaluation {

// Returns "24.6 M parameters, 5.08 G multiply-adds a target", for example.
std::string BackboneCostText(const v1::ModelCost& cost);

// Returns "45.9 M parameters; multiply-adds: 5.08 G for p(y|s), 4.41 M for each action described".
std::string ModelCostText(const v1::ModelCost& cost);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_COST_TEXT_H_
