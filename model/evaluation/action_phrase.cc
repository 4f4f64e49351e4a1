#include "model/evaluation/action_phrase.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/evaluation/kinematic_classes.h"
#include "model/evaluation/relative_classes.h"
#include "model/inference/action_model.h"

namespace maneuver::evaluation {
namespace {

using inference::Trajectory;
using PlanePoint = Eigen::RowVector2d;  // metres

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kPhraseHorizon = 5.0;  // seconds: relative figures are stated over it

std::string Side(double to_the_left) { return to_the_left > 0.0 ? "left" : "right"; }

// A point of the path; before the first waypoint the origin, where the target is now.
PlanePoint At(const Trajectory& mean, Eigen::Index t) {
  return t < 0 ? PlanePoint(0.0, 0.0) : PlanePoint(mean.row(t));
}

double LengthOf(const Trajectory& mean) {
  double length = 0.0;
  for (Eigen::Index t = 0; t < mean.rows(); ++t) length += (At(mean, t) - At(mean, t - 1)).norm();
  return length;
}

// How many waypoints `seconds` are, at least one and at most all.
Eigen::Index Waypoints(const ActionEvidence& evidence, double seconds) {
  return std::clamp<Eigen::Index>(std::lround(seconds / evidence.waypoint_interval), 1,
                                  evidence.mean.rows());
}

double Horizon(const ActionEvidence& evidence) {
  return static_cast<double>(evidence.mean.rows()) * evidence.waypoint_interval;
}

bool IsOfPedestrians(const ActionEvidence& evidence) {
  return evidence.type == v1::AGENT_TYPE_PEDESTRIAN;
}

std::string AsideWords(const ActionEvidence& evidence, const std::string& side) {
  return absl::StrCat(IsOfPedestrians(evidence) ? "step aside " : "lane change ", side);
}

// Share of the examples that are of this kinematic or relative class, as far as it is known: 0
// unless it is the most frequent one.
double ShareOf(const v1::ActionUse& use, KinematicClass kinematic) {
  const bool told = use.examples() >= kTellingExamples && use.kinematic_class() == Name(kinematic);
  return told ? use.class_share() : 0.0;
}
double ShareOf(const v1::ActionUse& use, RelativeClass relative) {
  const bool told = use.examples() >= kTellingExamples && use.relative_class() == Name(relative);
  return told ? use.relative_class_share() : 0.0;
}

// Courses of the steps of a path, cut to at least a metre so that a slow end does not turn.
struct CoursePoint {
  double along;   // distance travelled at the middle of the step, metres
  double course;  // radians
};
std::vector<CoursePoint> Courses(const Trajectory& mean) {
  constexpr double kStep = 1.0;  // metres
  std::vector<CoursePoint> courses;
  PlanePoint from(0.0, 0.0);
  double along = 0.0;
  for (Eigen::Index t = 0; t < mean.rows(); ++t) {
    const PlanePoint step = At(mean, t) - from;
    const double length = step.norm();
    if (length < kStep) continue;
    courses.push_back({along + length / 2.0, std::atan2(step.y(), step.x())});
    along += length;
    from = At(mean, t);
  }
  return courses;
}

// Radius of the arc that most of a turn by `heading_change` radians is driven on, metres: the way
// between 15 % and 85 % of it. What comes before and after the arc does not count.
double TurnRadius(const Trajectory& mean, double heading_change) {
  const std::vector<CoursePoint> courses = Courses(mean);
  const auto reaches = [&](double share) {
    return std::ranges::find_if(
        courses, [&](const CoursePoint& point) { return point.course / heading_change >= share; });
  };
  const auto begin = reaches(0.15);
  const auto end = reaches(0.85);
  if (begin < end && end != courses.end()) {
    const double turned = std::abs(end->course - begin->course);
    if (turned > 0.0) return (end->along - begin->along) / turned;
  }
  return LengthOf(mean) / std::abs(heading_change);
}

ActionPhrase WithDistance(std::string words, double metres) {
  return {.words = std::move(words), .before = ", ", .number = metres, .after = " m"};
}

// What depends on who moves.
struct PlaceLimits {
  double standing_distance = 2.0;  // metres
  double lane_change_shift = 2.0;  // metres
  double drift_shift = 1.0;        // metres
  double tight_radius = 12.0;      // metres
  double wide_radius = 35.0;       // metres
  double standing_speed = 1.5;     // m/s: begins below it
  double stopped_speed = 1.0;      // m/s: ends below it
  double creeping_speed = 2.0;     // m/s: ends below it
  double speed_change = 1.5;       // m/s
};
PlaceLimits LimitsOf(const ActionEvidence& evidence) {
  PlaceLimits limits;
  if (!IsOfPedestrians(evidence)) return limits;
  for (double PlaceLimits::*limit :
       {&PlaceLimits::standing_distance, &PlaceLimits::lane_change_shift, &PlaceLimits::drift_shift,
        &PlaceLimits::tight_radius, &PlaceLimits::wide_radius, &PlaceLimits::standing_speed,
        &PlaceLimits::stopped_speed, &PlaceLimits::creeping_speed, &PlaceLimits::speed_change}) {
    limits.*limit /= 2.0;
  }
  return limits;
}

// Words for where a path bends or shifts to; empty if it does neither.
std::string PlaceAside(const ActionEvidence& evidence, const PlaceLimits& limits) {
  constexpr double kBearing = 12.0 * kDegree;
  constexpr double kParallel = 15.0 * kDegree;
  constexpr double kNearlyParallel = 20.0 * kDegree;
  constexpr double kUTurn = 120.0 * kDegree;
  const Trajectory& mean = evidence.mean;
  const double h = FinalHeadingChange(mean);
  const std::string side = Side(h);
  if (std::abs(h) >= kUTurn) return absl::StrCat("U-turn ", side);
  const bool turns = ShareOf(evidence.use, h > 0.0 ? KinematicClass::kLeftTurn
                                                   : KinematicClass::kRightTurn) >= kTellingShare;
  if (std::abs(h) >= kTurnHeadingChange || (turns && std::abs(h) >= kBearing)) {
    const double radius = TurnRadius(mean, h);
    return absl::StrCat(side, " turn",
                        radius < limits.tight_radius  ? ", tight"
                        : radius > limits.wide_radius ? ", wide"
                                                      : "");
  }
  const double shift = SidewaysShift(mean, h);
  // A mean that trembles at its end seems shifted, but ends on the other side or nowhere.
  const double end = mean(mean.rows() - 1, 1);
  const double clear_shift = std::min(std::copysign(shift, shift * end), std::abs(end));
  const bool changes_lane =
      ShareOf(evidence.use, shift > 0.0 ? KinematicClass::kLaneChangeLeft
                                        : KinematicClass::kLaneChangeRight) >= 0.5;
  if ((std::abs(h) < kParallel && clear_shift >= limits.lane_change_shift) ||
      (changes_lane && std::abs(h) < kNearlyParallel && std::abs(shift) >= limits.drift_shift)) {
    return AsideWords(evidence, Side(shift));
  }
  if (std::abs(h) >= kBearing) return absl::StrCat("bear ", side);
  return clear_shift >= limits.drift_shift ? absl::StrCat("drift ", Side(end)) : "";
}

// Words for how fast a straight path is driven.
ActionPhrase PlaceAhead(const ActionEvidence& evidence, const PlaceLimits& limits) {
  const Trajectory& mean = evidence.mean;
  const Eigen::Index half_second = Waypoints(evidence, 0.5);
  const double seconds = static_cast<double>(half_second) * evidence.waypoint_interval;
  const Eigen::Index last = mean.rows() - 1;
  const double first_speed = At(mean, half_second - 1).norm() / seconds;
  const double last_speed = (At(mean, last) - At(mean, last - half_second)).norm() / seconds;
  const double way = LengthOf(mean);
  if (first_speed >= limits.standing_speed && last_speed < limits.stopped_speed) {
    return {.words = "stop",
            .before = " within ",
            .number = mean.rowwise().norm().maxCoeff(),
            .after = " m",
            .always_number = true};
  }
  if (first_speed < limits.standing_speed) {
    return WithDistance(last_speed < limits.creeping_speed ? "creep forward" : "start off", way);
  }
  const double change = last_speed - first_speed;
  if (std::abs(change) > std::max(limits.speed_change, 0.2 * first_speed)) {
    return {.words = change > 0.0 ? "speed up" : "slow down",
            .before = " to ",
            .number = last_speed,
            .after = " m/s"};
  }
  return {
      .words = "keep straight", .before = ", ", .number = way / Horizon(evidence), .after = " m/s"};
}

// The figures of a relative action, made comparable over horizons and over who moves.
struct Deviation {
  double sideways;    // e_y(T), to the left, metres
  double speed_gain;  // at the end, m/s
  double scaled_sideways;
  double scaled_gain;
  double scaled_path_gain;  // of the speed along the path
  double scaled_course;     // over the last second, off straight on, radians
};
Deviation DeviationOf(const ActionEvidence& evidence) {
  constexpr double kPedestrianScale = 0.25;
  constexpr double kWalkingSpeed = 1.4;  // m/s
  const double scale = IsOfPedestrians(evidence) ? kPedestrianScale : 1.0;
  const double stretch = kPhraseHorizon / Horizon(evidence);
  Trajectory mean = evidence.mean;
  const Eigen::Index last = mean.rows() - 1;
  const Eigen::Index second = Waypoints(evidence, 1.0);
  const double gain = (At(mean, last) - At(mean, last - second)).x() /
                          (static_cast<double>(second) * evidence.waypoint_interval) -
                      inference::kActionSetSpeed;
  // From here on the path at the speed that is usual for who moves.
  const double speed = IsOfPedestrians(evidence) ? kWalkingSpeed : inference::kActionSetSpeed;
  for (Eigen::Index t = 0; t < mean.rows(); ++t) {
    mean(t, 0) += (speed - inference::kActionSetSpeed) * static_cast<double>(t + 1) *
                  evidence.waypoint_interval;
  }
  const PlanePoint end = At(mean, last) - At(mean, last - second);
  const double path_gain = 2.0 * (LengthOf(mean) / Horizon(evidence) - speed);
  return {.sideways = mean(last, 1),
          .speed_gain = gain,
          .scaled_sideways = std::abs(mean(last, 1)) * stretch * stretch / scale,
          .scaled_gain = gain * stretch / scale,
          .scaled_path_gain = path_gain * stretch / scale,
          .scaled_course = std::abs(std::atan2(end.y(), end.x())) * stretch};
}

bool Turns(const ActionEvidence& evidence, const Deviation& deviation) {
  constexpr double kLeastOfATurn = 4.5;  // metres
  constexpr double kSurelyATurn = 9.5;   // metres
  const double share = ShareOf(evidence.use, deviation.sideways > 0.0 ? RelativeClass::kTurnsLeft
                                                                      : RelativeClass::kTurnsRight);
  if (share >= kTellingShare && deviation.scaled_sideways >= kLeastOfATurn) return true;
  return deviation.scaled_sideways >= kSurelyATurn &&
         (share > 0.0 || evidence.use.examples() < kTellingExamples);
}

bool ChangesLane(const ActionEvidence& evidence, const Deviation& deviation) {
  constexpr double kTwoLanes = 7.5;  // metres
  return deviation.scaled_sideways <= kTwoLanes &&
         ShareOf(evidence.use, deviation.sideways > 0.0 ? RelativeClass::kLaneChangeLeft
                                                        : RelativeClass::kLaneChangeRight) >= 0.5;
}

std::string RelativeAside(const ActionEvidence& evidence, const Deviation& deviation) {
  constexpr double kBearing = 4.5;  // metres
  constexpr double kWideBelow = 15.0 * kDegree;
  constexpr double kTightFrom = 40.0 * kDegree;
  const std::string side = Side(deviation.sideways);
  if (Turns(evidence, deviation)) {
    return absl::StrCat(side, " turn",
                        deviation.scaled_course >= kTightFrom  ? ", tight"
                        : deviation.scaled_course < kWideBelow ? ", wide"
                                                               : "");
  }
  if (ChangesLane(evidence, deviation)) return AsideWords(evidence, side);
  return absl::StrCat(deviation.scaled_sideways >= kBearing ? "bear " : "drift ", side);
}

const char* Pace(double scaled_path_gain) {
  return scaled_path_gain <= -4.0   ? ", braking"
         : scaled_path_gain <= -1.5 ? ", slowing"
         : scaled_path_gain >= 1.5  ? ", speeding up"
                                    : "";
}

const char* RelativeAhead(double scaled_gain, bool walks) {
  const double size = std::abs(scaled_gain);
  if (size < 0.25) return "keep speed";
  if (scaled_gain > 0.0) {
    return size < 1.5 ? "speed up gently" : size < 3.5 ? "speed up" : "speed up hard";
  }
  if (size < 1.5) return "slow down gently";
  if (size < 3.5) return "slow down";
  if (walks) return "slow down hard";
  return size < 5.0 ? "brake" : "brake hard";
}

}  // namespace

std::string ActionPhrase::WithNumber(int decimals) const {
  const std::string figure = with_sign ? absl::StrFormat("%+.*f", decimals, number)
                                       : absl::StrFormat("%.*f", decimals, number);
  return absl::StrCat(words, before, figure, after);
}

ActionPhrase PlacePhrase(const ActionEvidence& evidence) {
  const PlaceLimits limits = LimitsOf(evidence);
  const Trajectory& mean = evidence.mean;
  const double way = LengthOf(mean);
  if (mean.rowwise().norm().maxCoeff() < limits.standing_distance) {
    return WithDistance("stand still", way);
  }
  if (SetsOffBackwards(mean)) return WithDistance("reverse", way);
  std::string aside = PlaceAside(evidence, limits);
  return aside.empty() ? PlaceAhead(evidence, limits)
                       : WithDistance(std::move(aside), std::abs(mean(mean.rows() - 1, 1)));
}

ActionPhrase RelativePhrase(const ActionEvidence& evidence) {
  constexpr double kAside = 1.2;  // metres
  const Deviation deviation = DeviationOf(evidence);
  if (deviation.scaled_sideways >= kAside) {
    return WithDistance(
        absl::StrCat(RelativeAside(evidence, deviation), Pace(deviation.scaled_path_gain)),
        std::abs(deviation.sideways));
  }
  return {.words = RelativeAhead(deviation.scaled_gain, IsOfPedestrians(evidence)),
          .before = ", ",
          .number = deviation.speed_gain,
          .after = " m/s",
          .with_sign = true};
}

}  // namespace maneuver::evaluation
