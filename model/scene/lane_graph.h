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
// Lanes are read when they are first asked for: a target's paths follow a few lanes of a map that
// has hundreds. Until then the graph knows where a lane begins, and the box around it.
//
// Bounds, for any map that ValidateMap accepts: building and reading all lanes takes O(n log n)
// time and at most MostBytes() of memory for n points. A lane keeps at most kMostSuccessors, and
// considers at most kMostCandidates lanes that begin near its end.

#ifndef MANEUVER_MODEL_SCENE_LANE_GRAPH_H_
#define MANEUVER_MODEL_SCENE_LANE_GRAPH_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "absl/base/call_once.h"
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
  int64_t id = 0;            // MapFeature.id; 0 if it has none
  double speed_limit = 0.0;  // metres per second; 0 if not known
  int first = 0;
  int last = 0;
  int first_piece = 0;  // its pieces are first_piece .. last_piece
  int last_piece = 0;
};

// Consecutive segments of a lane, and the box around them.
struct LanePiece {
  Box box;
  int lane;
  int first;  // its segments begin at points first .. last - 1
  int last;
};

// Nothing that a caller sees ever changes; safe to share between threads.
class LaneGraph {
 public:
  static constexpr double kSamePoint = 1e-3;       // metres
  static constexpr double kMostGap = 0.6;          // metres
  static constexpr double kMostDeclaredGap = 5.0;  // metres
  static constexpr int kMostSuccessors = 8;
  static constexpr int kMostCandidates = 64;
  static constexpr int kPieceSegments = 16;

  // ValidateMap must accept `features`, which must stay unchanged for as long as the graph lives.
  //   boxes: around the points of each feature
  LaneGraph(const MapFeatures& features, std::span<const Box> boxes);
  ~LaneGraph();
  LaneGraph(const LaneGraph&) = delete;
  LaneGraph& operator=(const LaneGraph&) = delete;

  // Returns an upper bound of bytes() for a graph of these features. Takes O(features).
  static int64_t MostBytes(const MapFeatures& features);

  // Returns the number of lanes. They have the order of their features.
  int size() const { return size_; }
  const Lane& lane(int i) const {
    LazyLane& lane = lanes_[static_cast<size_t>(i)];
    absl::call_once(lane.read, [&] { ReadLane(i); });
    return lane.lane;
  }
  // Return points and pieces by their index in the graph, for those of lanes that lane() returned.
  const LanePoint* points() const { return points_.get(); }
  const LanePiece* pieces() const { return pieces_.get(); }
  // Returns the indices of the lanes that follow lane i: in the order declared, or in ascending
  // order if none are declared.
  std::span<const int> Successors(int i) const {
    LazyLane& lane = lanes_[static_cast<size_t>(i)];
    absl::call_once(lane.linked, [&] { LinkLane(i); });
    return {successors_.get() + static_cast<size_t>(i) * kMostSuccessors,
            static_cast<size_t>(lane.successors)};
  }
  const LanePoint& Start(const Lane& lane) const {
    return points_[static_cast<size_t>(lane.first)];
  }
  const LanePoint& End(const Lane& lane) const { return points_[static_cast<size_t>(lane.last)]; }
  double Length(const Lane& lane) const { return End(lane).distance; }
  // Returns the distance between a lane's end and the start of lane `next`, metres; 0 within
  // kSamePoint.
  double Gap(const Lane& lane, int next) const;
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

  // Returns the memory in use. Counts all lanes from the start, so the number does not change when
  // they are read.
  int64_t bytes() const;

 private:
  static constexpr size_t kFanOut = 8;
  // Looking at so many boxes takes less time than sorting them, or the lanes' starts, for a few
  // targets.
  static constexpr size_t kMostRootBoxes = 512;

  // Boxes first .. first + count - 1 of boxes_. Box i of a level encloses boxes kFanOut * i to
  // kFanOut * i + kFanOut - 1 of the level below.
  struct Level {
    size_t first;
    size_t count;
  };

  struct LazyLane {
    absl::once_flag read;    // `lane`, its points and its pieces
    absl::once_flag linked;  // its successors
    int feature = 0;         // index of the feature that it comes from
    int successors = 0;
    Lane lane;
  };
  class LaneStarts;

  void AddLane(int feature);
  const v1::MapFeature& FeatureOf(int i) const {
    return features_[lanes_[static_cast<size_t>(i)].feature];
  }
  // Read the points of a lane, and return how many there are. ReadDistinctPoints is faster, but it
  // returns 0 if two neighbours are the same.
  static int ReadDistinctPoints(const v1::MapFeature& feature, LanePoint* point);
  static int ReadPoints(const v1::MapFeature& feature, LanePoint* points);
  void ReadLane(int i) const;
  void LinkLane(int i) const;
  // Returns the first lane with this id, or -1.
  int FindId(int64_t id) const;
  const LaneStarts& starts() const;
  void BuildTree();
  // Sorts order_ and boxes_ by the Morton code of the boxes' centres, in 256 x 256 cells.
  void SortByPlace();

  template <typename Call>
  void Visit(size_t level, size_t first, size_t last, const Box& around, Call& call) const {
    const Box* const boxes = boxes_.data() + levels_[level].first;
    for (size_t i = first; i < last; ++i) {
      if (!boxes[i].Overlaps(around)) continue;
      if (level == 0) {
        const Lane& near = lane(order_[i]);
        for (int piece = near.first_piece; piece <= near.last_piece; ++piece) {
          if (pieces_[static_cast<size_t>(piece)].box.Overlaps(around)) {
            call(pieces_[static_cast<size_t>(piece)]);
          }
        }
      } else {
        const size_t child = kFanOut * i;
        Visit(level - 1, child, std::min(child + kFanOut, levels_[level - 1].count), around, call);
      }
    }
  }

  const MapFeatures& features_;
  int size_ = 0;
  size_t most_points_ = 0;
  size_t most_pieces_ = 0;
  // Of all lanes, with room for every point of their features. What is not read is not set.
  std::unique_ptr<LazyLane[]> lanes_;
  std::unique_ptr<LanePoint[]> points_;
  std::unique_ptr<LanePiece[]> pieces_;
  std::unique_ptr<int[]> successors_;         // [lanes, kMostSuccessors]
  std::vector<std::pair<int64_t, int>> ids_;  // and their lanes, in ascending order
  mutable absl::once_flag starts_once_;
  mutable std::unique_ptr<const LaneStarts> starts_;  // built when a lane first needs them
  std::vector<Point2> stop_signs_;
  // A packed R-tree. Its lowest level holds the boxes of the lanes, nearby lanes next to each
  // other.
  std::vector<int> order_;  // [lanes], into lanes_
  std::vector<Box> boxes_;
  std::vector<Level> levels_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_GRAPH_H_
