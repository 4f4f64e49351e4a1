#include "model/evaluation/waymo_displacement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "model/scene/target_frame.h"

namespace maneuver::evaluation {
namespace {

constexpr double kStep = 0.5;  // seconds

struct Requirement {
  double time;  // seconds
  WaymoThresholds thresholds;
};
constexpr std::array<Requirement, 3> kRequirements = {
    {{3.0, {1.0, 2.0}}, {5.0, {1.8, 3.6}}, {8.0, {3.0, 6.0}}}};

}  // namespace

double WaymoSpeedScale(double initial_speed) {
  constexpr double kSlow = 1.4;
  constexpr double kFast = 11.0;
  return 0.5 + 0.5 * std::clamp((initial_speed - kSlow) / (kFast - kSlow), 0.0, 1.0);
}

WaymoThresholds ThresholdsAt(double time, double initial_speed) {
  const auto* requirement = std::find_if(
      kRequirements.begin(), kRequirements.end(),
      [time](const Requirement& each) { return std::abs(each.time - time) < scene::kSameTime; });
  const double scale = WaymoSpeedScale(initial_speed);
  return {scale * requirement->thresholds.lateral, scale * requirement->thresholds.longitudinal};
}

WaymoMeasure::WaymoMeasure(std::vector<double> waypoint_times)
    : waypoint_times_(std::move(waypoint_times)) {
  for (const Requirement& requirement : kRequirements) {
    if (requirement.time > waypoint_times_.back() + scene::kSameTime) break;
    measured_times_.push_back(requirement.time);
    const auto steps = static_cast<size_t>(std::lround(requirement.time / kStep));
    while (steps_.size() < steps) {
      steps_.push_back(Locate(kStep * static_cast<double>(steps_.size() + 1)));
    }
    measured_.push_back(steps - 1);
  }
}

WaymoMeasure::Place WaymoMeasure::Locate(double time) const {
  const auto after =
      std::lower_bound(waypoint_times_.begin(), waypoint_times_.end(), time - scene::kSameTime);
  const int index = static_cast<int>(after - waypoint_times_.begin());
  const double start = index == 0 ? 0.0 : waypoint_times_[static_cast<size_t>(index) - 1];
  return {index - 1, std::min(1.0, (time - start) / (*after - start))};
}

Eigen::RowVector2d WaymoMeasure::At(const Trajectory& trajectory, const Place& place) {
  const Eigen::RowVector2d end = trajectory.row(place.before + 1);
  if (place.before < 0) return place.share * end;
  const Eigen::RowVector2d start = trajectory.row(place.before);
  return start + place.share * (end - start);
}

WaymoErrors WaymoMeasure::BestOf(std::span<const Trajectory> ranked, int k, const Trajectory& truth,
                                 std::span<const double> truth_headings,
                                 double initial_speed) const {
  const size_t count = measured_.size();
  std::vector<double> min_ade(count, HUGE_VAL);
  std::vector<double> min_fde(count, HUGE_VAL);
  std::vector<bool> hit(count, false);
  for (const Trajectory& predicted : ranked.first(std::min<size_t>(k, ranked.size()))) {
    double sum = 0.0;
    size_t step = 0;
    for (size_t i = 0; i < count; ++i) {
      Eigen::RowVector2d error(0.0, 0.0);  // target frame, metres
      for (; step <= measured_[i]; ++step) {
        error = At(predicted, steps_[step]) - At(truth, steps_[step]);
        sum += error.norm();
      }
      min_ade[i] = std::min(min_ade[i], sum / static_cast<double>(step));
      min_fde[i] = std::min(min_fde[i], error.norm());
      const double cosine = std::cos(truth_headings[i]);
      const double sine = std::sin(truth_headings[i]);
      const double longitudinal = std::abs(cosine * error.x() + sine * error.y());
      const double lateral = std::abs(-sine * error.x() + cosine * error.y());
      const WaymoThresholds allowed = ThresholdsAt(measured_times_[i], initial_speed);
      if (longitudinal <= allowed.longitudinal && lateral <= allowed.lateral) hit[i] = true;
    }
  }
  WaymoErrors errors;
  for (size_t i = 0; i < count; ++i) {
    const double share = 1.0 / static_cast<double>(count);
    errors.min_ade += share * min_ade[i];
    errors.min_fde += share * min_fde[i];
    errors.miss_rate += share * (hit[i] ? 0.0 : 1.0);
  }
  return errors;
}

}  // namespace maneuver::evaluation
