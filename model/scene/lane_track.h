// Lanes one after another as one line, for the search of lane paths.

#ifndef MANEUVER_MODEL_SCENE_LANE_TRACK_H_
#define MANEUVER_MODEL_SCENE_LANE_TRACK_H_

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "model/scene/lane_graph.h"
#include "model/scene/map_features.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

// A direction in the world.
struct Heading {
  double cosine = 1.0;
  double sine = 0.0;
};

// A place on a path.
struct Spot {
  Point2 p_WP;
  Heading heading;
};

// Where a path passes something.
struct Passing {
  double squared_distance = std::numeric_limits<double>::infinity();
  double at = 0.0;  // arc length from the start of the path's first lane
  Heading heading;
};

// Consecutive lanes as one line. Arc lengths are metres in the recorded world, from the start of
// the first lane. Between two lanes the line is straight, with the heading at the start of the
// second one; beyond the last lane it continues straight.
class LaneTrack {
 public:
  // Begins a track without lanes.
  //   foot: arc length at which the target is nearest
  void Begin(const LaneGraph& graph, double foot) {
    graph_ = &graph;
    foot_ = foot;
    legs_.clear();
    pieces_.clear();
  }
  //   start: arc length of the lane's first point
  void AddLane(const Lane& lane, double start) { legs_.push_back({&lane, start}); }
  // Call it after the last AddLane if lanes were added in descending order.
  void Reverse() { std::reverse(legs_.begin(), legs_.end()); }

  double foot() const { return foot_; }
  double end() const { return legs_.back().start + graph_->Length(*legs_.back().lane); }
  size_t legs() const { return legs_.size(); }
  const Lane& lane(size_t leg) const { return *legs_[leg].lane; }
  double start(size_t leg) const { return legs_[leg].start; }
  const LanePoint& lane_start(size_t leg) const { return graph_->Start(lane(leg)); }

  // Reads places one after the other, in ascending order of arc length.
  class Reader {
   public:
    explicit Reader(const LaneTrack& track) : track_(track) { Enter(0); }
    Spot operator()(double at) {
      while (leg_ + 1 < track_.legs_.size() && at >= track_.legs_[leg_ + 1].start) Enter(leg_ + 1);
      const Lane& lane = track_.lane(leg_);
      const LanePoint* const points = track_.graph_->points();
      const double distance = at - track_.legs_[leg_].start;
      if (distance > points[lane.last].distance) return BeyondLane(distance);
      const LanePoint* const after =
          std::upper_bound(points + point_ + 1, points + lane.last, distance,
                           [](double d, const LanePoint& point) { return d < point.distance; });
      point_ = static_cast<int>(after - points) - 1;
      return Along(points[point_], distance);
    }

   private:
    void Enter(size_t leg) {
      leg_ = leg;
      point_ = track_.lane(leg).first;
    }
    static Spot Along(const LanePoint& point, double distance) {
      const double ahead = distance - point.distance;
      return {{point.x + ahead * point.cosine, point.y + ahead * point.sine},
              {point.cosine, point.sine}};
    }
    // Returns a place in the gap before the next lane, or straight ahead after the last one.
    Spot BeyondLane(double distance) const {
      const LanePoint& end = track_.graph_->End(track_.lane(leg_));
      if (leg_ + 1 == track_.legs_.size()) return Along(end, distance);
      const LanePoint& next = track_.graph_->Start(track_.lane(leg_ + 1));
      const double gap = track_.start(leg_ + 1) - track_.start(leg_) - end.distance;
      const double share = (distance - end.distance) / gap;
      return {{end.x + share * (next.x - end.x), end.y + share * (next.y - end.y)},
              {next.cosine, next.sine}};
    }

    const LaneTrack& track_;
    size_t leg_ = 0;
    int point_ = 0;  // later reads are never before it
  };

  // Selects the part that NearestPoint() searches.
  void SelectPart(double from, double to) {
    from_ = from;
    to_ = to;
    pieces_.clear();
    for (const Leg& leg : legs_) {
      const Lane& lane = *leg.lane;
      for (int i = lane.first_piece; i <= lane.last_piece; ++i) {
        const LanePiece& piece = graph_->pieces()[static_cast<size_t>(i)];
        if (leg.start + DistanceOf(piece.last) < from || leg.start + DistanceOf(piece.first) > to) {
          continue;
        }
        box_ = pieces_.empty() ? piece.box : box_.With(piece.box);
        pieces_.push_back({i, leg.start});
      }
    }
  }

  // Returns where the selected part comes nearest to a point; the first place if several are
  // equally near. The distance is infinite unless it is below `reach` metres.
  Passing NearestPoint(const Point2& p_WP, double reach) const {
    Passing nearest;
    nearest.squared_distance = reach * reach;
    bool found = false;
    const Box around{p_WP.x - reach, p_WP.y - reach, p_WP.x + reach, p_WP.y + reach};
    if (pieces_.empty() || !box_.Overlaps(around)) return {};
    for (const auto& [index, start] : pieces_) {
      const LanePiece& piece = graph_->pieces()[static_cast<size_t>(index)];
      if (!piece.box.Overlaps(around)) continue;
      for (int i = piece.first; i < piece.last; ++i) found |= PassSegment(i, start, p_WP, &nearest);
    }
    return found ? nearest : Passing{};
  }

  // Appends the corners between two arc lengths, and the places there.
  void AppendCorners(double from, double to, std::vector<Point2>* corners) const {
    Reader reader(*this);
    corners->push_back(reader(from).p_WP);
    for (const Leg& leg : legs_) {
      const Lane& lane = *leg.lane;
      for (int i = lane.first; i <= lane.last; ++i) {
        const LanePoint& point = graph_->points()[static_cast<size_t>(i)];
        const double at = leg.start + point.distance;
        if (at > from && at < to) corners->push_back({point.x, point.y});
      }
    }
    corners->push_back(reader(to).p_WP);
  }

 private:
  // At the corner between two segments, the first of them is nearest. Square metres.
  static constexpr double kRounding = 1e-9;

  struct Leg {
    const Lane* lane;
    double start;  // arc length of its first point
  };

  double DistanceOf(int point) const {
    return graph_->points()[static_cast<size_t>(point)].distance;
  }

  // Updates `nearest` if the segment from `point`, on a lane that begins at `start`, is nearer.
  // Returns whether it is.
  bool PassSegment(int point, double start, const Point2& p_WP, Passing* nearest) const {
    const LanePoint& from = graph_->points()[static_cast<size_t>(point)];
    const double begin = start + from.distance;
    const double least = std::max(from_ - begin, 0.0);
    const double most = std::min(to_ - begin, DistanceOf(point + 1) - from.distance);
    if (least > most) return false;
    const double dx = p_WP.x - from.x;
    const double dy = p_WP.y - from.y;
    const double along = std::clamp(dx * from.cosine + dy * from.sine, least, most);
    const double off_x = dx - along * from.cosine;
    const double off_y = dy - along * from.sine;
    const double squared = off_x * off_x + off_y * off_y;
    if (squared >= nearest->squared_distance - kRounding) return false;
    *nearest = {squared, begin + along, {from.cosine, from.sine}};
    return true;
  }

  const LaneGraph* graph_ = nullptr;
  double foot_ = 0.0;
  std::vector<Leg> legs_;
  // The selected part, and the box around the pieces that it touches.
  double from_ = 0.0;
  double to_ = 0.0;
  Box box_{};
  std::vector<std::pair<int, double>> pieces_;  // of the graph; arc length where their lane begins
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_TRACK_H_
