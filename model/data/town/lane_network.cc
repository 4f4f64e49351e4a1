#include "model/data/town/lane_network.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace maneuver::data::town {
namespace {

struct Box {
  double x_min = std::numeric_limits<double>::max();
  double x_max = std::numeric_limits<double>::lowest();
  double y_min = std::numeric_limits<double>::max();
  double y_max = std::numeric_limits<double>::lowest();
};

Box BoxOf(const Path& path) {
  Box box;
  for (const PathPoint& point : path.points()) {
    box.x_min = std::min(box.x_min, point.p.x);
    box.x_max = std::max(box.x_max, point.p.x);
    box.y_min = std::min(box.y_min, point.p.y);
    box.y_max = std::max(box.y_max, point.p.y);
  }
  return box;
}

bool Apart(const Box& a, const Box& b, double distance) {
  return a.x_min > b.x_max + distance || b.x_min > a.x_max + distance ||
         a.y_min > b.y_max + distance || b.y_min > a.y_max + distance;
}

bool LinksTo(const Lane& lane, int other) {
  return std::any_of(lane.next.begin(), lane.next.end(),
                     [other](const LaneLink& link) { return link.lane == other; });
}

// Returns the distance of two centrelines below which vehicles on them are in each other's way.
double Reach(const Lane& a, const Lane& b) {
  const bool bike = a.kind == LaneKind::kBike || b.kind == LaneKind::kBike;
  return bike ? 2.0 : 2.7;
}

std::optional<Conflict> Overlap(const Lane& mine, const Lane& other, int other_index) {
  const double reach = Reach(mine, other);
  std::optional<Conflict> found;
  const std::vector<PathPoint>& a = mine.path.points();
  const std::vector<PathPoint>& b = other.path.points();
  for (size_t i = 0; i < a.size(); i += 2) {
    for (size_t k = 0; k < b.size();) {
      const double distance = Norm(a[i].p - b[k].p);
      if (distance >= reach) {
        // Points are half a metre apart, so all points that this skips are out of reach.
        k += std::max<size_t>(1, static_cast<size_t>((distance - reach) / 0.51));
        continue;
      }
      const double s = static_cast<double>(i) * mine.path.spacing();
      const double t = static_cast<double>(k) * other.path.spacing();
      if (!found) found = Conflict{other_index, s, s, t, t, false};
      found->from = std::min(found->from, s);
      found->to = std::max(found->to, s);
      found->lane_from = std::min(found->lane_from, t);
      found->lane_to = std::max(found->lane_to, t);
      ++k;
    }
  }
  return found;
}

}  // namespace

int LaneNetwork::Add(Lane lane) {
  lanes.push_back(std::move(lane));
  return static_cast<int>(lanes.size()) - 1;
}

std::vector<std::vector<int>> LaneNetwork::Predecessors() const {
  std::vector<std::vector<int>> result(lanes.size());
  for (size_t i = 0; i < lanes.size(); ++i) {
    for (const LaneLink& link : lanes[i].next) {
      if (link.at == 0.0) result[link.lane].push_back(static_cast<int>(i));
    }
  }
  return result;
}

void LaneNetwork::FindConflicts() {
  const std::vector<std::vector<int>> before = Predecessors();
  std::vector<Box> boxes;
  boxes.reserve(lanes.size());
  for (const Lane& lane : lanes) boxes.push_back(BoxOf(lane.path));
  for (size_t i = 0; i < lanes.size(); ++i) {
    Lane& mine = lanes[i];
    if (!mine.gate) continue;
    for (size_t k = 0; k < lanes.size(); ++k) {
      const Lane& other = lanes[k];
      if (k == i || Apart(boxes[i], boxes[k], 3.0)) continue;
      if (LinksTo(other, static_cast<int>(i))) continue;
      // A lane that is joined at its start always lies ahead.
      if (std::any_of(mine.next.begin(), mine.next.end(), [k](const LaneLink& link) {
            return link.lane == static_cast<int>(k) && link.at == 0.0;
          })) {
        continue;
      }
      const bool siblings = std::any_of(before[i].begin(), before[i].end(), [&](int lane) {
        return std::find(before[k].begin(), before[k].end(), lane) != before[k].end();
      });
      if (siblings) continue;
      std::optional<Conflict> overlap = Overlap(mine, other, static_cast<int>(k));
      if (!overlap) continue;
      for (const LaneLink& link : mine.next) {
        overlap->merge |= link.lane == static_cast<int>(k) || LinksTo(other, link.lane);
      }
      mine.gate->conflicts.push_back(*overlap);
    }
  }
}

}  // namespace maneuver::data::town
