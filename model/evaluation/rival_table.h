// The predictors that a model is compared with, and by what.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_TABLE_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_TABLE_H_

#include <array>
#include <string>
#include <string_view>

namespace maneuver::evaluation {

// A part of fewer examples is not compared with rivals.
inline constexpr int kLeastComparedExamples = 50;

// A part of fewer groups of recordings is undecided. Five groups agree by chance alone once in
// sixteen times (2 / 2^5), and the bootstrap would call each of these times ahead or behind. For
// six groups it is once in 32, which an interval of 95 % allows.
inline constexpr int kLeastDecidingGroups = 6;

// Of fewer groups the intervals are too narrow: the bootstrap knows no more places than it has
// seen.
inline constexpr int kFewGroups = 10;

// The name in RivalComparison.rival, and the same for people.
struct Rival {
  std::string_view name;
  std::string_view title;   // "constant velocity"
  std::string_view column;  // heads a column
  bool trained = false;     // with the model, by `baselines` of its settings
};

inline constexpr std::array<Rival, 5> kRivals = {
    {{"cv", "constant velocity", "CV", false},
     {"ctra", "CTRA", "CTRA", false},
     {"faded", "the faded roll-out", "FADED", false},
     {"covernet", "CoverNet-like", "COVERNET", true},
     {"multipath", "MultiPath-like", "MULTIPATH", true}}};

// The metrics that are compared. Of all of these, less is better.
inline constexpr std::array<std::string_view, 8> kComparedMetrics = {
    "ade_1", "fde_1", "miss_rate_1", "ade_medoid", "min_ade_6", "min_fde_6", "miss_rate_6", "nll"};

// Returns the rival of this name; null if there is none.
const Rival* FindRival(std::string_view name);

// Returns the name of the rival's metric to hold against `metric` of the model; empty if the two
// cannot be compared: constant velocity has no best of six, nor a likelihood.
std::string RivalMetric(const Rival& rival, std::string_view metric);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_TABLE_H_
