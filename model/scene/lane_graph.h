// The driving lanes of a map: where they run, which follow which, and which pass near a point.
//
// A lane is a MAP_FEATURE_TYPE_LANE_CENTERLINE with at least two points that are more than
// kSamePoint apart. All other features are ignored. A point within kSamePoint of its predecessor is
// skipped. Arc lengths count from the lane's own start, in metres.
//
// Successors. A successor that a lane declares (MapFeature.successor_ids) counts if that lane
// begins within kMostDeclaredGap of this one's end. If none does, every lane counts that begins
// within kMostGap of this one's end at an angle of less than 37 degrees to it (cosine above 0.8). A
// lane is never its own successor. If several lanes share one id, the id names the first.
//
// Bounds, for any map that ValidateMap accepts: building takes O(n log n) time and at most
// MostBytes() of memory for n points. A lane keeps at most kMostSuccessors, and considers at most
// kMostCandidates lanes that begin near its end.

#ifndef MANEUVER_MODEL_SCENE_LANE_GRAPH_H_
#define MANEUVER_MODEL_SCENE_LANE_GRAPH_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "model/scene/map_features.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

// A point of a lane, and the straight segment from it to the next point.
struct LanePoint {
  double x;         // world, metres
  double y;         // world, metres
  double distance;  // arc length from the lane's start, metres
  // Of the segment's heading, world. The last point repeats those of the segment before it.
  double cosine;
  double sine;
};

// Points first .. last of the graph, in the direction of travel.
struct Lane {
  int64_t id;          // MapFeature.id; 0 if it has none
  double speed_limit;  // metres per second; 0 if not known
  int first;
  int last;
  int first_piece;  // its pieces are first_piece .. last_piece
  int last_piece;
  int first_successor;
  int successors;
};

// Consecutive segments of a lane, and the box around them.
struct LanePiece {
  Box box;
  int lane;
  int first;  // its segments begin at points first .. last - 1
  int last;
};

// Immutable after construction; safe to share between threads. Keeps no reference to the features.
class LaneGraph {
 public:
  static constexpr double kSamePoint = 1e-3;       // metres
  static constexpr double kMostGap = 0.6;          // metres
  static constexpr double kMostDeclaredGap = 5.0;  // metres
  static constexpr int kMostSuccessors = 8;
  static constexpr int kMostCandidates = 64;
  static constexpr int kPieceSegments = 16;

  // ValidateMap must accept `features`.
  explicit LaneGraph(const MapFeatures& features);
  // Returns an upper bound of bytes() for a graph of these features. Takes O(features).
  static int64_t MostBytes(const MapFeatures& features);

  const std::vector<Lane>& lanes() const { return lanes_; }
  // Returns the points of all lanes, lane by lane.
  const std::vector<LanePoint>& points() const { return points_; }
  // Returns the pieces of all lanes, lane by lane. Each has at most kPieceSegments segments.
  const std::vector<LanePiece>& pieces() const { return pieces_; }
  // Returns the indices of the lanes that follow this one: in the order declared, or in ascending
  // order if none are declared.
  std::span<const int> Successors(const Lane& lane) const {
    return {successors_.data() + lane.first_successor, static_cast<size_t>(lane.successors)};
  }
  const LanePoint& Start(const Lane& lane) const {
    return points_[static_cast<size_t>(lane.first)];
  }
  const LanePoint& End(const Lane& lane) const { return points_[static_cast<size_t>(lane.last)]; }
  double Length(const Lane& lane) const { return End(lane).distance; }
  // Returns the distance between a lane's end and the start of `next`, metres; 0 within kSamePoint.
  double Gap(const Lane& lane, const Lane& next) const;
  // Returns the positions of the map's stop signs, world, metres.
  const std::vector<Point2>& stop_signs() const { return stop_signs_; }

  // Calls call(const LanePiece&) for every piece whose box comes within `distance` metres of p_WP
  // along both axes. The order depends on the map alone.
  template <typename Call>
  void ForEachPieceNear(const Point2& p_WP, double distance, Call&& call) const {
    if (levels_.empty()) return;
    const Box around{p_WP.x - distance, p_WP.y - distance, p_WP.x + distance, p_WP.y + distance};
    Visit(levels_.size() - 1, 0, levels_.back().count, around, call);
  }

  int64_t bytes() const;

 private:
  static constexpr size_t kFanOut = 8;

  // Boxes first .. first + count - 1 of boxes_. Box i of a level encloses boxes kFanOut * i to
  // kFanOut * i + kFanOut - 1 of the level below.
  struct Level {
    size_t first;
    size_t count;
  };

  void AddLane(const v1::MapFeature& feature);
  // Appends the points of a lane. AddDistinctPoints is faster but requires at least two points, no
  // two neighbours of which are the same. Otherwise it adds nothing and returns false.
  bool AddDistinctPoints(const double* x, const double* y, int count);
  void AddPoints(const double* x, const double* y, int count);
  void AddPieces(int lane);
  // features_of[i]: index of the feature that lane i comes from.
  void LinkLanes(const MapFeatures& features, const std::vector<int>& features_of);
  void BuildTree();

  template <typename Call>
  void Visit(size_t level, size_t first, size_t last, const Box& around, Call& call) const {
    const Box* const boxes = boxes_.data() + levels_[level].first;
    for (size_t i = first; i < last; ++i) {
      if (!boxes[i].Overlaps(around)) continue;
      if (level == 0) {
        call(pieces_[static_cast<size_t>(order_[i])]);
      } else {
        const size_t child = kFanOut * i;
        Visit(level - 1, child, std::min(child + kFanOut, levels_[level - 1].count), around, call);
      }
    }
  }

  std::vector<LanePoint> points_;
  std::vector<Lane> lanes_;
  std::vector<LanePiece> pieces_;
  std::vector<int> successors_;
  std::vector<Point2> stop_signs_;
  // A packed R-tree. Its lowest level holds the boxes of the pieces, nearby pieces next to each
  // other.
  std::vector<int> order_;  // [pieces], into pieces_
  std::vector<Box> boxes_;
  std::vector<Level> levels_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_GRAPH_H_
