#include "model/scene/lane_graph.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

namespace maneuver::scene {
namespace {

constexpr double kLeastCosine = 0.8;  // between the headings of a lane and its successor

bool IsLane(const v1::MapFeature& feature) {
  return feature.type() == v1::MAP_FEATURE_TYPE_LANE_CENTERLINE;
}

int PiecesOf(int points) {
  return (std::max(points - 1, 0) + LaneGraph::kPieceSegments - 1) / LaneGraph::kPieceSegments;
}

// Returns the number of boxes of a tree over `lanes` lanes whose root has at most `most`.
size_t TreeBoxes(size_t lanes, size_t fan_out, size_t most) {
  size_t boxes = lanes;
  for (size_t level = lanes; level > most;) {
    level = (level + fan_out - 1) / fan_out;
    boxes += level;
  }
  return boxes;
}

// Returns whether a feature has two points that are not the same. `box`: around its points.
bool IsLine(const v1::MapFeature& feature, const Box& box) {
  // If the box is this wide, one of its ends is far enough from the first point, whatever the
  // rounding.
  constexpr double kWide = 4.0 * LaneGraph::kSamePoint;
  if (box.high_x - box.low_x > kWide || box.high_y - box.low_y > kWide) return true;
  for (int i = 1; i < PointsOf(feature); ++i) {
    const double dx = feature.x(i) - feature.x(0);
    const double dy = feature.y(i) - feature.y(0);
    if (std::sqrt(dx * dx + dy * dy) > LaneGraph::kSamePoint) return true;
  }
  return false;
}

// Upper bounds of the sizes of a graph's arrays.
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

// Inserts a zero before each of the eight bits of a number.
uint32_t Spread(uint32_t bits) {
  bits = (bits | (bits << 4)) & 0x0F0F;
  bits = (bits | (bits << 2)) & 0x3333;
  return (bits | (bits << 1)) & 0x5555;
}

}  // namespace

// Where lanes begin, by grid cell.
class LaneGraph::LaneStarts {
 public:
  static constexpr size_t kBytes = 24;  // of each lane

  // Sorts the starts of all lanes.
  explicit LaneStarts(const LaneGraph& graph) {
    starts_.reserve(static_cast<size_t>(graph.size()));
    for (int i = 0; i < graph.size(); ++i) starts_.push_back(StartOf(graph, i));
    static_assert(sizeof(starts_[0]) == kBytes);
    std::sort(starts_.begin(), starts_.end());
  }

  // Calls call(lane) for every lane that begins within kMostGap of (x, y), and for some others
  // nearby. Stops after kMostCandidates calls.
  template <typename Call>
  void ForEachNear(double x, double y, Call call) const {
    const Cells cells(x, y);
    int candidates = 0;
    for (int64_t row = cells.first_row; row <= cells.last_row; ++row) {
      const std::pair first(Cell{row, cells.first_column}, 0);
      for (auto at = std::lower_bound(starts_.begin(), starts_.end(), first);
           at != starts_.end() && at->first <= Cell{row, cells.last_column}; ++at) {
        if (++candidates > LaneGraph::kMostCandidates) return;
        call(at->second);
      }
    }
  }

  // Does the same for a graph of at most kMostRootBoxes lanes, whose boxes have the order of the
  // lanes. Looks at all boxes, which takes less time than sorting for the few lanes that are asked
  // for.
  template <typename Call>
  static void ForEachNear(const LaneGraph& graph, double x, double y, Call call) {
    const Cells cells(x, y);
    constexpr double kReach = 4.0 * kMostGap;  // beyond the cells
    const Box around{x - kReach, y - kReach, x + kReach, y + kReach};
    std::vector<std::pair<Cell, int>> near;
    for (int i = 0; i < graph.size(); ++i) {
      if (!graph.boxes_[static_cast<size_t>(i)].Overlaps(around)) continue;
      const v1::MapFeature& feature = graph.FeatureOf(i);
      if (!around.Overlaps({feature.x(0), feature.y(0), feature.x(0), feature.y(0)})) continue;
      if (const auto start = StartOf(graph, i); cells.Hold(start.first)) near.push_back(start);
    }
    std::sort(near.begin(), near.end());
    near.resize(std::min<size_t>(near.size(), LaneGraph::kMostCandidates));
    for (const auto& [cell, lane] : near) call(lane);
  }

 private:
  using Cell = std::pair<int64_t, int64_t>;  // row, column

  // Cells are so large that everything within kMostGap lies in at most two rows and two columns.
  static int64_t Index(double coordinate) {
    return static_cast<int64_t>(std::floor(coordinate / (2.0 * LaneGraph::kMostGap)));
  }
  static std::pair<Cell, int> StartOf(const LaneGraph& graph, int lane) {
    const v1::MapFeature& feature = graph.FeatureOf(lane);
    return {Cell{Index(feature.y(0)), Index(feature.x(0))}, lane};
  }

  // The cells that hold everything within kMostGap of a point.
  struct Cells {
    Cells(double x, double y)
        : first_row(Index(y - LaneGraph::kMostGap)),
          last_row(Index(y + LaneGraph::kMostGap)),
          first_column(Index(x - LaneGraph::kMostGap)),
          last_column(Index(x + LaneGraph::kMostGap)) {}
    bool Hold(const Cell& cell) const {
      return cell.first >= first_row && cell.first <= last_row && cell.second >= first_column &&
             cell.second <= last_column;
    }
    int64_t first_row, last_row;
    int64_t first_column, last_column;
  };

  std::vector<std::pair<Cell, int>> starts_;
};

LaneGraph::LaneGraph(const MapFeatures& features, std::span<const Box> boxes)
    : features_(features) {
  std::vector<int> lines;
  lines.reserve(static_cast<size_t>(features.size()));
  for (int i = 0; i < features.size(); ++i) {
    const v1::MapFeature& feature = features[i];
    if (IsLane(feature) && IsLine(feature, boxes[static_cast<size_t>(i)])) {
      lines.push_back(i);
    } else if (feature.type() == v1::MAP_FEATURE_TYPE_STOP_SIGN && PointsOf(feature) > 0) {
      stop_signs_.push_back({feature.x(0), feature.y(0)});
    }
  }
  stop_signs_.shrink_to_fit();
  lanes_ = std::make_unique<LazyLane[]>(lines.size());
  ids_.reserve(lines.size());
  boxes_.reserve(TreeBoxes(lines.size(), kFanOut, kMostRootBoxes));
  for (const int line : lines) {
    AddLane(line);
    boxes_.push_back(boxes[static_cast<size_t>(line)]);
  }
  points_ = std::make_unique_for_overwrite<LanePoint[]>(most_points_);
  pieces_ = std::make_unique_for_overwrite<LanePiece[]>(most_pieces_);
  successors_ = std::make_unique_for_overwrite<int[]>(boxes_.size() * kMostSuccessors);
  if (!std::is_sorted(ids_.begin(), ids_.end())) std::sort(ids_.begin(), ids_.end());
  BuildTree();
}

LaneGraph::~LaneGraph() = default;

void LaneGraph::AddLane(int feature) {
  LazyLane& added = lanes_[static_cast<size_t>(size_)];
  const v1::MapFeature& from = features_[feature];
  added.feature = feature;
  added.lane.id = from.id();
  added.lane.speed_limit = from.speed_limit();
  added.lane.first = static_cast<int>(most_points_);
  added.lane.first_piece = static_cast<int>(most_pieces_);
  if (from.id() != 0) ids_.emplace_back(from.id(), size_);
  most_points_ += static_cast<size_t>(PointsOf(from));
  most_pieces_ += static_cast<size_t>(PiecesOf(PointsOf(from)));
  size_ += 1;
}

int64_t LaneGraph::MostBytes(const MapFeatures& features) {
  const Capacity capacity(features);
  return static_cast<int64_t>(sizeof(LaneGraph) + capacity.points * sizeof(LanePoint) +
                              capacity.pieces * sizeof(LanePiece) +
                              capacity.lanes *
                                  (sizeof(LazyLane) + kMostSuccessors * sizeof(int) +
                                   sizeof(ids_[0]) + sizeof(order_[0]) + LaneStarts::kBytes) +
                              TreeBoxes(capacity.lanes, kFanOut, kMostRootBoxes) * sizeof(Box) +
                              capacity.stop_signs * sizeof(Point2));
}

int64_t LaneGraph::bytes() const {
  return static_cast<int64_t>(
      sizeof(LaneGraph) + most_points_ * sizeof(LanePoint) + most_pieces_ * sizeof(LanePiece) +
      static_cast<size_t>(size_) *
          (sizeof(LazyLane) + kMostSuccessors * sizeof(int) + LaneStarts::kBytes) +
      ids_.capacity() * sizeof(ids_[0]) + order_.capacity() * sizeof(order_[0]) +
      boxes_.capacity() * sizeof(Box) + stop_signs_.capacity() * sizeof(Point2));
}

double LaneGraph::Gap(const Lane& lane, int next) const {
  const LanePoint& end = End(lane);
  const v1::MapFeature& feature = FeatureOf(next);
  const double gap = std::hypot(feature.x(0) - end.x, feature.y(0) - end.y);
  return gap > kSamePoint ? gap : 0.0;
}

int LaneGraph::ReadDistinctPoints(const v1::MapFeature& feature, LanePoint* point) {
  const double* const x = feature.x().data();
  const double* const y = feature.y().data();
  const int count = PointsOf(feature);
  // Processes blocks of segments, so that square roots and divisions are vectorised.
  constexpr int kBlock = 64;
  std::array<double, kBlock> length;
  std::array<double, kBlock> cosine;
  std::array<double, kBlock> sine;
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
    if (shortest <= kSamePoint) return 0;
    for (int i = 0; i < segments; ++i) {
      *point++ = {x[begin + i], y[begin + i], distance, cosine[i], sine[i]};
      distance += length[i];
    }
  }
  *point = {x[count - 1], y[count - 1], distance, (point - 1)->cosine, (point - 1)->sine};
  return count;
}

int LaneGraph::ReadPoints(const v1::MapFeature& feature, LanePoint* points) {
  points[0] = {feature.x(0), feature.y(0), 0.0, 1.0, 0.0};
  int read = 1;
  for (int i = 1; i < PointsOf(feature); ++i) {
    LanePoint& before = points[read - 1];
    const double dx = feature.x(i) - before.x;
    const double dy = feature.y(i) - before.y;
    const double length = std::sqrt(dx * dx + dy * dy);
    if (length <= kSamePoint) continue;
    before.cosine = dx / length;
    before.sine = dy / length;
    points[read++] = {feature.x(i), feature.y(i), before.distance + length, before.cosine,
                      before.sine};
  }
  return read;
}

void LaneGraph::ReadLane(int i) const {
  Lane& lane = lanes_[static_cast<size_t>(i)].lane;
  LanePoint* const points = points_.get() + lane.first;
  int count = ReadDistinctPoints(FeatureOf(i), points);
  if (count == 0) count = ReadPoints(FeatureOf(i), points);
  lane.last = lane.first + count - 1;
  LanePiece* piece = pieces_.get() + lane.first_piece;
  for (int first = lane.first; first < lane.last; first += kPieceSegments, ++piece) {
    const int last = std::min(first + kPieceSegments, lane.last);
    const LanePoint& start = points_[static_cast<size_t>(first)];
    Box box{start.x, start.y, start.x, start.y};
    for (int p = first + 1; p <= last; ++p) {
      const LanePoint& point = points_[static_cast<size_t>(p)];
      box = box.With({point.x, point.y, point.x, point.y});
    }
    *piece = {box, i, first, last};
  }
  lane.last_piece = static_cast<int>(piece - pieces_.get()) - 1;
}

int LaneGraph::FindId(int64_t id) const {
  const auto found = std::lower_bound(ids_.begin(), ids_.end(), std::pair(id, 0));
  return found == ids_.end() || found->first != id ? -1 : found->second;
}

const LaneGraph::LaneStarts& LaneGraph::starts() const {
  absl::call_once(starts_once_, [&] { starts_ = std::make_unique<const LaneStarts>(*this); });
  return *starts_;
}

void LaneGraph::LinkLane(int i) const {
  const Lane& lane = this->lane(i);
  int* const successors = successors_.get() + static_cast<size_t>(i) * kMostSuccessors;
  int& count = lanes_[static_cast<size_t>(i)].successors;
  const auto add = [&](int next, double most_gap) {
    if (next < 0 || next == i || count == kMostSuccessors || Gap(lane, next) > most_gap ||
        std::find(successors, successors + count, next) != successors + count) {
      return;
    }
    successors[count++] = next;
  };
  for (const int64_t id : FeatureOf(i).successor_ids()) {
    if (id != 0) add(FindId(id), kMostDeclaredGap);
  }
  if (count > 0) return;
  const LanePoint& end = End(lane);
  const auto add_if_ahead = [&](int next) {
    if (Gap(lane, next) > kMostGap) return;  // before the lane is read
    const LanePoint& start = Start(this->lane(next));
    if (start.cosine * end.cosine + start.sine * end.sine > kLeastCosine) add(next, kMostGap);
  };
  if (static_cast<size_t>(size_) <= kMostRootBoxes) {
    LaneStarts::ForEachNear(*this, end.x, end.y, add_if_ahead);
  } else {
    starts().ForEachNear(end.x, end.y, add_if_ahead);
  }
  // The order of the grid's cells depends on where the map lies; the order of lanes must not.
  std::sort(successors, successors + count);
}

void LaneGraph::BuildTree() {
  const size_t lanes = boxes_.size();
  if (lanes == 0) return;
  order_.resize(lanes);
  std::iota(order_.begin(), order_.end(), 0);
  if (lanes > kMostRootBoxes) SortByPlace();
  levels_.push_back({0, lanes});
  while (levels_.back().count > kMostRootBoxes) {
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

void LaneGraph::SortByPlace() {
  Box all = boxes_.front();
  for (const Box& box : boxes_) all = all.With(box);
  const auto cell = [](double middle, double low, double high) {
    return high > low ? static_cast<uint32_t>(255.0 * (middle - low) / (high - low)) : 0u;
  };
  std::vector<std::pair<uint32_t, int>> codes;
  codes.reserve(boxes_.size());
  for (size_t i = 0; i < boxes_.size(); ++i) {
    const Box& box = boxes_[i];
    const uint32_t column = cell(0.5 * (box.low_x + box.high_x), all.low_x, all.high_x);
    const uint32_t row = cell(0.5 * (box.low_y + box.high_y), all.low_y, all.high_y);
    codes.emplace_back(Spread(column) | (Spread(row) << 1), static_cast<int>(i));
  }
  std::sort(codes.begin(), codes.end());
  const std::vector<Box> boxes = boxes_;
  for (size_t i = 0; i < codes.size(); ++i) {
    order_[i] = codes[i].second;
    boxes_[i] = boxes[static_cast<size_t>(order_[i])];
  }
}

}  // namespace maneuver::scene
