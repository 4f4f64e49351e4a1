#include "model/scene/lane_graph.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace maneuver::scene {
namespace {

constexpr double kLeastCosine = 0.8;  // between the headings of a lane and its successor

int PointsOf(const v1::MapFeature& feature) { return std::min(feature.x_size(), feature.y_size()); }

bool IsLane(const v1::MapFeature& feature) {
  return feature.type() == v1::MAP_FEATURE_TYPE_LANE_CENTERLINE;
}

int PiecesOf(int points) {
  return (std::max(points - 1, 0) + LaneGraph::kPieceSegments - 1) / LaneGraph::kPieceSegments;
}

// Returns the number of boxes of a tree over `pieces` pieces.
size_t TreeBoxes(size_t pieces, size_t fan_out) {
  size_t boxes = pieces;
  for (size_t level = pieces; level > fan_out;) {
    level = (level + fan_out - 1) / fan_out;
    boxes += level;
  }
  return boxes;
}

// Upper bounds of the sizes of a graph's vectors.
struct Capacity {
  size_t lanes = 0;
  size_t points = 0;
  size_t pieces = 0;
  size_t stop_signs = 0;

  explicit Capacity(const MapFeatures& features) {
    for (const v1::MapFeature& feature : features) {
      if (IsLane(feature)) {
        lanes += 1;
        points += static_cast<size_t>(PointsOf(feature));
        pieces += static_cast<size_t>(PiecesOf(PointsOf(feature)));
      } else if (feature.type() == v1::MAP_FEATURE_TYPE_STOP_SIGN) {
        stop_signs += 1;
      }
    }
  }
};

// Finds lanes by id.
class LaneIds {
 public:
  explicit LaneIds(const std::vector<Lane>& lanes) {
    ids_.reserve(lanes.size());
    for (size_t i = 0; i < lanes.size(); ++i) {
      if (lanes[i].id != 0) ids_.emplace_back(lanes[i].id, static_cast<int>(i));
    }
    std::sort(ids_.begin(), ids_.end());
  }

  // Returns the first lane with this id, or -1.
  int Find(int64_t id) const {
    const auto found = std::lower_bound(ids_.begin(), ids_.end(), std::pair(id, 0));
    return found == ids_.end() || found->first != id ? -1 : found->second;
  }

 private:
  std::vector<std::pair<int64_t, int>> ids_;
};

// Finds lanes that begin near a point. Keeps their starts sorted by grid cell.
class LaneStarts {
 public:
  explicit LaneStarts(const LaneGraph& graph) {
    starts_.reserve(graph.lanes().size());
    for (size_t i = 0; i < graph.lanes().size(); ++i) {
      const LanePoint& start = graph.Start(graph.lanes()[i]);
      starts_.emplace_back(Cell{Index(start.y), Index(start.x)}, static_cast<int>(i));
    }
    std::sort(starts_.begin(), starts_.end());
  }

  // Calls call(lane) for every lane that begins within kMostGap of (x, y), and for some others
  // nearby. Stops after kMostCandidates calls.
  template <typename Call>
  void ForEachNear(double x, double y, Call call) const {
    int candidates = 0;
    const int64_t last_row = Index(y + LaneGraph::kMostGap);
    const int64_t last_column = Index(x + LaneGraph::kMostGap);
    for (int64_t row = Index(y - LaneGraph::kMostGap); row <= last_row; ++row) {
      const std::pair first(Cell{row, Index(x - LaneGraph::kMostGap)}, 0);
      for (auto at = std::lower_bound(starts_.begin(), starts_.end(), first);
           at != starts_.end() && at->first <= Cell{row, last_column}; ++at) {
        if (++candidates > LaneGraph::kMostCandidates) return;
        call(at->second);
      }
    }
  }

 private:
  using Cell = std::pair<int64_t, int64_t>;  // row, column

  // Cells are so large that everything within kMostGap lies in at most two rows and two columns.
  static int64_t Index(double coordinate) {
    return static_cast<int64_t>(std::floor(coordinate / (2.0 * LaneGraph::kMostGap)));
  }

  std::vector<std::pair<Cell, int>> starts_;
};

// Inserts a zero before each of the eight bits of a number.
uint32_t Spread(uint32_t bits) {
  bits = (bits | (bits << 4)) & 0x0F0F;
  bits = (bits | (bits << 2)) & 0x3333;
  return (bits | (bits << 1)) & 0x5555;
}

}  // namespace

LaneGraph::LaneGraph(const MapFeatures& features) {
  const Capacity capacity(features);
  lanes_.reserve(capacity.lanes);
  points_.reserve(capacity.points);
  pieces_.reserve(capacity.pieces);
  stop_signs_.reserve(capacity.stop_signs);
  std::vector<int> features_of;
  features_of.reserve(capacity.lanes);
  for (int i = 0; i < features.size(); ++i) {
    const v1::MapFeature& feature = features[i];
    if (IsLane(feature)) {
      AddLane(feature);
      if (features_of.size() < lanes_.size()) features_of.push_back(i);
    } else if (feature.type() == v1::MAP_FEATURE_TYPE_STOP_SIGN && PointsOf(feature) > 0) {
      stop_signs_.push_back({feature.x(0), feature.y(0)});
    }
  }
  LinkLanes(features, features_of);
  BuildTree();
}

int64_t LaneGraph::MostBytes(const MapFeatures& features) {
  const Capacity capacity(features);
  return static_cast<int64_t>(sizeof(LaneGraph) + capacity.points * sizeof(LanePoint) +
                              capacity.lanes * (sizeof(Lane) + kMostSuccessors * sizeof(int)) +
                              capacity.pieces * (sizeof(LanePiece) + sizeof(int)) +
                              TreeBoxes(capacity.pieces, kFanOut) * sizeof(Box) +
                              capacity.stop_signs * sizeof(Point2));
}

int64_t LaneGraph::bytes() const {
  return static_cast<int64_t>(
      sizeof(LaneGraph) + points_.capacity() * sizeof(LanePoint) +
      lanes_.capacity() * sizeof(Lane) + pieces_.capacity() * sizeof(LanePiece) +
      (successors_.capacity() + order_.capacity()) * sizeof(int) + boxes_.capacity() * sizeof(Box) +
      stop_signs_.capacity() * sizeof(Point2));
}

double LaneGraph::Gap(const Lane& lane, const Lane& next) const {
  const LanePoint& end = End(lane);
  const LanePoint& start = Start(next);
  const double gap = std::hypot(start.x - end.x, start.y - end.y);
  return gap > kSamePoint ? gap : 0.0;
}

void LaneGraph::AddLane(const v1::MapFeature& feature) {
  const auto first = points_.size();
  const int count = PointsOf(feature);
  if (!AddDistinctPoints(feature.x().data(), feature.y().data(), count)) {
    AddPoints(feature.x().data(), feature.y().data(), count);
  }
  if (points_.size() < first + 2) {
    points_.resize(first);
    return;
  }
  lanes_.push_back({.id = feature.id(),
                    .speed_limit = feature.speed_limit(),
                    .first = static_cast<int>(first),
                    .last = static_cast<int>(points_.size()) - 1,
                    .first_piece = static_cast<int>(pieces_.size()),
                    .last_piece = 0,
                    .first_successor = 0,
                    .successors = 0});
  AddPieces(static_cast<int>(lanes_.size()) - 1);
}

bool LaneGraph::AddDistinctPoints(const double* x, const double* y, int count) {
  if (count < 2) return false;
  // Processes blocks of segments, so that square roots and divisions are vectorised.
  constexpr int kBlock = 64;
  std::array<double, kBlock> length;
  std::array<double, kBlock> cosine;
  std::array<double, kBlock> sine;
  const size_t first = points_.size();
  points_.resize(first + static_cast<size_t>(count));
  LanePoint* point = points_.data() + first;
  double distance = 0.0;
  for (int begin = 0; begin + 1 < count; begin += kBlock) {
    const int segments = std::min(kBlock, count - 1 - begin);
    double shortest = kSamePoint + 1.0;
    for (int i = 0; i < segments; ++i) {
      const double dx = x[begin + i + 1] - x[begin + i];
      const double dy = y[begin + i + 1] - y[begin + i];
      length[i] = std::sqrt(dx * dx + dy * dy);
      cosine[i] = dx / length[i];
      sine[i] = dy / length[i];
    }
    for (int i = 0; i < segments; ++i) shortest = length[i] < shortest ? length[i] : shortest;
    if (shortest <= kSamePoint) {
      points_.resize(first);
      return false;
    }
    for (int i = 0; i < segments; ++i) {
      *point++ = {x[begin + i], y[begin + i], distance, cosine[i], sine[i]};
      distance += length[i];
    }
  }
  *point = {x[count - 1], y[count - 1], distance, (point - 1)->cosine, (point - 1)->sine};
  return true;
}

void LaneGraph::AddPoints(const double* x, const double* y, int count) {
  for (int i = 0; i < count; ++i) {
    if (i == 0) {
      points_.push_back({x[0], y[0], 0.0, 1.0, 0.0});
      continue;
    }
    LanePoint& before = points_.back();
    const double dx = x[i] - before.x;
    const double dy = y[i] - before.y;
    const double length = std::sqrt(dx * dx + dy * dy);
    if (length <= kSamePoint) continue;
    before.cosine = dx / length;
    before.sine = dy / length;
    const LanePoint next{x[i], y[i], before.distance + length, before.cosine, before.sine};
    points_.push_back(next);
  }
}

void LaneGraph::AddPieces(int lane) {
  Lane& added = lanes_[static_cast<size_t>(lane)];
  for (int first = added.first; first < added.last; first += kPieceSegments) {
    const int last = std::min(first + kPieceSegments, added.last);
    const LanePoint& start = points_[static_cast<size_t>(first)];
    Box box{start.x, start.y, start.x, start.y};
    for (int i = first + 1; i <= last; ++i) {
      const LanePoint& point = points_[static_cast<size_t>(i)];
      box = box.With({point.x, point.y, point.x, point.y});
    }
    pieces_.push_back({box, lane, first, last});
  }
  added.last_piece = static_cast<int>(pieces_.size()) - 1;
}

void LaneGraph::LinkLanes(const MapFeatures& features, const std::vector<int>& features_of) {
  const LaneIds ids(lanes_);
  std::optional<LaneStarts> starts;  // built when a lane first needs them
  for (size_t i = 0; i < lanes_.size(); ++i) {
    Lane& lane = lanes_[i];
    lane.first_successor = static_cast<int>(successors_.size());
    const auto add = [&](int next, double most_gap) {
      const auto known = Successors(lane);
      if (next < 0 || next == static_cast<int>(i) || lane.successors == kMostSuccessors ||
          Gap(lane, lanes_[static_cast<size_t>(next)]) > most_gap ||
          std::find(known.begin(), known.end(), next) != known.end()) {
        return;
      }
      successors_.push_back(next);
      lane.successors += 1;
    };
    for (const int64_t id : features[features_of[i]].successor_ids()) {
      if (id != 0) add(ids.Find(id), kMostDeclaredGap);
    }
    if (lane.successors > 0) continue;
    const LanePoint& end = End(lane);
    if (!starts) starts.emplace(*this);
    starts->ForEachNear(end.x, end.y, [&](int next) {
      const LanePoint& start = Start(lanes_[static_cast<size_t>(next)]);
      if (start.cosine * end.cosine + start.sine * end.sine > kLeastCosine) add(next, kMostGap);
    });
    // The order of the grid's cells depends on where the map lies; the order of lanes must not.
    std::sort(successors_.begin() + lane.first_successor, successors_.end());
  }
  successors_.shrink_to_fit();
}

void LaneGraph::BuildTree() {
  if (pieces_.empty()) return;
  Box all = pieces_.front().box;
  for (const LanePiece& piece : pieces_) all = all.With(piece.box);
  // Sorts the pieces by the Morton code of their centres, in 256 x 256 cells.
  const auto cell = [](double middle, double low, double high) {
    return high > low ? static_cast<uint32_t>(255.0 * (middle - low) / (high - low)) : 0u;
  };
  std::vector<std::pair<uint32_t, int>> codes;
  codes.reserve(pieces_.size());
  for (size_t i = 0; i < pieces_.size(); ++i) {
    const Box& box = pieces_[i].box;
    const uint32_t column = cell(0.5 * (box.low_x + box.high_x), all.low_x, all.high_x);
    const uint32_t row = cell(0.5 * (box.low_y + box.high_y), all.low_y, all.high_y);
    codes.emplace_back(Spread(column) | (Spread(row) << 1), static_cast<int>(i));
  }
  std::sort(codes.begin(), codes.end());
  order_.reserve(pieces_.size());
  boxes_.reserve(TreeBoxes(pieces_.size(), kFanOut));
  for (const auto& [code, piece] : codes) {
    order_.push_back(piece);
    boxes_.push_back(pieces_[static_cast<size_t>(piece)].box);
  }
  levels_.push_back({0, boxes_.size()});
  while (levels_.back().count > kFanOut) {
    const Level below = levels_.back();
    levels_.push_back({boxes_.size(), (below.count + kFanOut - 1) / kFanOut});
    for (size_t i = 0; i < below.count; i += kFanOut) {
      Box box = boxes_[below.first + i];
      for (size_t j = i + 1; j < std::min(i + kFanOut, below.count); ++j) {
        box = box.With(boxes_[below.first + j]);
      }
      boxes_.push_back(box);
    }
  }
}

}  // namespace maneuver::scene
