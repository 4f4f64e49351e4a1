#include "model/data/town/maneuvers.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace maneuver::data::town {
namespace {

constexpr double kStandstill = 0.6;  // metres per second
constexpr double kCreeping = 6.0;    // metres per second
constexpr double kCruising = 17.0;
constexpr double kCurveWindow = 2.0;   // seconds before and after
constexpr double kCurveAngle = 0.25;   // radians within twice that
constexpr double kShortest = 0.8;      // seconds; shorter intervals are merged
constexpr double kLongestStop = 4.5;   // seconds
constexpr double kLongestStart = 4.0;  // seconds

// Marks the frames in which the vehicle slows down for a standstill, and those in which it picks up
// speed after one.
void MarkStopsAndStarts(const Track& track, std::vector<bool>& stop, std::vector<bool>& start) {
  const std::vector<TrackPoint>& points = track.points;
  const int n = static_cast<int>(points.size());
  for (int i = 1; i < n; ++i) {
    const bool stands = points[i].speed < kStandstill;
    const bool stood = points[i - 1].speed < kStandstill;
    if (stands && !stood) {
      double fastest = points[i].speed;
      for (int k = i - 1; k >= 0 && points[i].time - points[k].time < kLongestStop; --k) {
        // A small hesitation does not end it; speeding up does.
        if (points[k].speed < fastest - 0.3) break;
        fastest = std::max(fastest, points[k].speed);
        stop[k] = true;
      }
    }
    if (!stands && stood) {
      double fastest = points[i].speed;
      for (int k = i; k < n && points[k].time - points[i].time < kLongestStart; ++k) {
        if (points[k].speed < fastest - 0.3) break;
        fastest = std::max(fastest, points[k].speed);
        start[k] = true;
      }
    }
  }
}

// The change of heading and the speed around a moment.
struct Around {
  double turned = 0.0;  // radians
  double speed = 0.0;   // metres per second, mean
};

Around LookAround(const Track& track, int at) {
  const std::vector<TrackPoint>& points = track.points;
  const int n = static_cast<int>(points.size());
  int first = at;
  int last = at;
  while (first > 0 && points[at].time - points[first - 1].time <= kCurveWindow) --first;
  while (last + 1 < n && points[last + 1].time - points[at].time <= kCurveWindow) ++last;
  const double seconds = std::max(1e-9, points[last].time - points[first].time);
  return {points[last].heading - points[first].heading,
          (points[last].travelled - points[first].travelled) / seconds};
}

Maneuver At(const Track& track, int i, bool stops, bool starts) {
  const TrackPoint& point = track.points[i];
  if (point.speed < kStandstill) return Maneuver::kStanding;
  const RouteEvent* active = nullptr;
  for (const RouteEvent& event : track.events) {
    if (point.travelled >= event.lead && point.travelled <= event.to) active = &event;
  }
  const bool sideways = active != nullptr && (active->maneuver == Maneuver::kLaneChangeLeft ||
                                              active->maneuver == Maneuver::kLaneChangeRight);
  if (stops && sideways) return Maneuver::kStop;
  if (active != nullptr && point.travelled >= active->from) return active->maneuver;
  if (stops) return Maneuver::kStop;
  if (active != nullptr) return active->maneuver;
  if (starts) return Maneuver::kStart;
  const Around around = LookAround(track, i);
  if (around.turned > kCurveAngle) return Maneuver::kFollowCurveLeft;
  if (around.turned < -kCurveAngle) return Maneuver::kFollowCurveRight;
  if (around.speed < kCreeping) return Maneuver::kCreep;
  return around.speed > kCruising ? Maneuver::kCruise : Maneuver::kKeepLane;
}

}  // namespace

std::string_view ManeuverName(Maneuver maneuver) {
  static constexpr std::array<std::string_view, kManeuverCount> kNames = {"keep_lane",
                                                                          "creep",
                                                                          "cruise",
                                                                          "follow_curve_left",
                                                                          "follow_curve_right",
                                                                          "turn_left",
                                                                          "turn_right",
                                                                          "u_turn",
                                                                          "roundabout",
                                                                          "lane_change_left",
                                                                          "lane_change_right",
                                                                          "merge",
                                                                          "park_out",
                                                                          "stop",
                                                                          "standing",
                                                                          "start"};
  return kNames[static_cast<size_t>(maneuver)];
}

std::vector<ManeuverInterval> RecordManeuvers(const Track& track) {
  const int n = static_cast<int>(track.points.size());
  std::vector<bool> stop(n, false);
  std::vector<bool> start(n, false);
  MarkStopsAndStarts(track, stop, start);
  std::vector<ManeuverInterval> intervals;
  for (int i = 0; i < n; ++i) {
    const Maneuver now = At(track, i, stop[i], start[i]);
    const double time = track.points[i].time;
    if (intervals.empty() || intervals.back().maneuver != now) {
      if (!intervals.empty()) intervals.back().end = time;
      intervals.push_back({now, time, time});
    }
    intervals.back().end = time;
  }
  std::vector<ManeuverInterval> kept;
  for (const ManeuverInterval& interval : intervals) {
    const bool brief = interval.end - interval.start < kShortest;
    if (!kept.empty() && (brief || kept.back().maneuver == interval.maneuver)) {
      kept.back().end = interval.end;
    } else {
      kept.push_back(interval);
    }
  }
  // A short first interval is merged into the next one.
  if (kept.size() > 1 && kept[0].end - kept[0].start < kShortest) {
    kept[1].start = kept[0].start;
    kept.erase(kept.begin());
  }
  return kept;
}

}  // namespace maneuver::data::town
