#include "model/data/nuscenes/arcline_path.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/quoted_text.h"

namespace maneuver::data {
namespace {

using scene::Pose2;

constexpr double kSamePoint = 0.01;  // metres

// Returns the pose `distance` metres along a segment that begins at `start`.
Pose2 Along(const Pose2& start, double curvature, double distance) {
  const double half = 0.5 * curvature * distance;
  const double sinc = half == 0.0 ? 1.0 : std::sin(half) / half;
  const double mean = start.heading() + half;
  return {start.x() + distance * sinc * std::cos(mean),
          start.y() + distance * sinc * std::sin(mean), start.heading() + 2.0 * half};
}

}  // namespace

Pose2 ArclinePath::PoseAt(double distance) const {
  Pose2 pose = start;
  for (size_t i = 0; i < lengths.size(); ++i) {
    const double within = std::clamp(distance, 0.0, lengths[i]);
    pose = Along(pose, curvatures[i], within);
    distance -= within;
  }
  return pose;
}

absl::StatusOr<std::array<double, 3>> CurvaturesOf(std::string_view shape, double radius) {
  constexpr std::array<std::string_view, 6> kShapes = {"LSL", "LSR", "RSL", "RSR", "LRL", "RLR"};
  if (std::find(kShapes.begin(), kShapes.end(), shape) == kShapes.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("shape ", QuotedText(shape), " must be LSL, LSR, RSL, RSR, LRL or RLR"));
  }
  if (!(radius > 0.0)) return absl::InvalidArgumentError("radius must be positive");
  std::array<double, 3> curvatures{};
  for (size_t i = 0; i < curvatures.size(); ++i) {
    if (shape[i] != 'S') curvatures[i] = (shape[i] == 'L' ? 1.0 : -1.0) / radius;
  }
  return curvatures;
}

void AppendPoints(const ArclinePath& path, double resolution, std::vector<scene::Point2>* points) {
  const int pieces = std::max(1, static_cast<int>(std::ceil(path.length() / resolution)));
  for (int i = 0; i <= pieces; ++i) {
    const Pose2 pose = path.PoseAt(path.length() * i / pieces);
    if (i == 0 && !points->empty() &&
        std::hypot(points->back().x - pose.x(), points->back().y - pose.y()) <= kSamePoint) {
      continue;
    }
    points->push_back({pose.x(), pose.y()});
  }
}

}  // namespace maneuver::data
