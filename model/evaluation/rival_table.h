// The predictors that a model is compared with, and the metrics of the comparison.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_TABLE_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_TABLE_H_

#include <array>
#include <string>
#include <string_view>

namespace maneuver::evaluation {

// Parts with fewer examples are not compared with rivals.
inline constexpr int kLeastComparedExamples = 50;

// Parts with fewer groups of recordings are undecided. Five groups agree by chance once in sixteen
// times (2 / 2^5), and the bootstrap would call each of these ahead or behind. Six groups agree by
// chance once in 32 times, which a 95 % interval allows.
inline constexpr int kLeastDecidingGroups = 6;

// With fewer groups the intervals are too narrow, because the bootstrap knows only the places it
// has seen. Texts then say so.
inline constexpr int kFewGroups = 10;

// A rival: its name in RivalComparison.rival, and its names for people.
struct Rival {
  std::string_view name;
  std::string_view title;   // "constant velocity"
  std::string_view column;  // head of its column
  bool trained = false;     // trained with the model, by `baselines` of its settings
};

inline constexpr std::array<Rival, 5> kRivals = {
    {{"cv", "constant velocity", "CV", false},
     {"ctra", "CTRA", "CTRA", false},
     {"faded", "the faded roll-out", "FADED", false},
     {"covernet", "CoverNet-like", "COVERNET", true},
     {"multipath", "MultiPath-like", "MULTIPATH", true}}};

// The compared metrics. For all of them, less is better.
inline constexpr std::array<std::string_view, 8> kComparedMetrics = {
    "ade_1", "fde_1", "miss_rate_1", "ade_medoid", "min_ade_6", "min_fde_6", "miss_rate_6", "nll"};

// Returns the rival of this name; null if there is none.
const Rival* FindRival(std::string_view name);

// Returns the name of the rival's metric to compare with the model's `metric`. Empty if the two
// cannot be compared: constant velocity has neither a best of six nor a likelihood.
std::string RivalMetric(const Rival& rival, std::string_view metric);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_TABLE_H_
