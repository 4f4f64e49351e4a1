#include "model/data/commonroad/lanelet_map.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

// Distance beside a bound at which other lanelets are searched, to tell whether the bound is an
// edge of the road; also the longest piece of a bound that is tested at once, metres. Pieces are
// longer if the bounds would have more of them: no roads are so long, but a file may say so.
constexpr double kBeside = 0.3;
constexpr double kPiece = 2.0;
constexpr double kMostPieces = 100'000.0;  // of all bounds, beyond one for each segment

double Distance(const MapPoint& a, const MapPoint& b) { return std::hypot(b.x - a.x, b.y - a.y); }

MapPoint Between(const MapPoint& a, const MapPoint& b, double share) {
  return {a.x + share * (b.x - a.x), a.y + share * (b.y - a.y)};
}

// Returns `points` points at equal distances along the line.
Polyline Resample(const Polyline& line, size_t points) {
  std::vector<double> along = {0.0};
  for (size_t i = 1; i < line.size(); ++i) {
    along.push_back(along.back() + Distance(line[i - 1], line[i]));
  }
  Polyline sampled;
  size_t i = 1;
  for (size_t k = 0; k < points; ++k) {
    const double at = along.back() * static_cast<double>(k) /
                      static_cast<double>(std::max<size_t>(1, points - 1));
    while (i + 1 < line.size() && along[i] < at) ++i;
    const double length = along[i] - along[i - 1];
    const double share = length > 0.0 ? std::clamp((at - along[i - 1]) / length, 0.0, 1.0) : 0.0;
    sampled.push_back(Between(line[i - 1], line[i], share));
  }
  return sampled;
}

// The ground of a lanelet: the polygon from its left bound around to its right one.
class Area {
 public:
  explicit Area(const Lanelet& lanelet) : outline_(lanelet.left) {
    outline_.insert(outline_.end(), lanelet.right.rbegin(), lanelet.right.rend());
    low_ = high_ = outline_.front();
    for (const MapPoint& point : outline_) {
      low_ = {std::min(low_.x, point.x), std::min(low_.y, point.y)};
      high_ = {std::max(high_.x, point.x), std::max(high_.y, point.y)};
    }
  }

  const Polyline& outline() const { return outline_; }
  const MapPoint& low() const { return low_; }  // the corners of the box around it
  const MapPoint& high() const { return high_; }

  // Counts the sides that a ray to the right crosses.
  bool Contains(const MapPoint& point) const {
    if (point.x < low_.x || point.x > high_.x || point.y < low_.y || point.y > high_.y) {
      return false;
    }
    bool inside = false;
    for (size_t i = 0, j = outline_.size() - 1; i < outline_.size(); j = i++) {
      const MapPoint& a = outline_[i];
      const MapPoint& b = outline_[j];
      if ((a.y > point.y) == (b.y > point.y)) continue;
      if (point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)) inside = !inside;
    }
    return inside;
  }

 private:
  Polyline outline_;
  MapPoint low_;
  MapPoint high_;
};

// The grounds of all lanelets, by the squares of a grid that they touch.
class Areas {
 public:
  explicit Areas(const std::vector<Lanelet>& lanelets) {
    for (const Lanelet& lanelet : lanelets) {
      const Area& area = areas_.emplace_back(lanelet);
      const Square low = SquareOf(area.low());
      const Square high = SquareOf(area.high());
      if ((high.first - low.first + 1) * (high.second - low.second + 1) > kMostSquares) {
        large_.push_back(areas_.size() - 1);
        continue;
      }
      for (int64_t x = low.first; x <= high.first; ++x) {
        for (int64_t y = low.second; y <= high.second; ++y) {
          entries_.emplace_back(Square(x, y), areas_.size() - 1);
        }
      }
    }
    std::sort(entries_.begin(), entries_.end());
  }

  const Area& operator[](size_t lanelet) const { return areas_[lanelet]; }

  // Returns whether a point is on the ground of a lanelet other than `own`.
  bool IsOnAnother(size_t own, const MapPoint& point) const {
    const auto contains = [&](size_t i) { return i != own && areas_[i].Contains(point); };
    const Square square = SquareOf(point);
    for (auto entry = std::lower_bound(entries_.begin(), entries_.end(), Entry(square, 0));
         entry != entries_.end() && entry->first == square; ++entry) {
      if (contains(entry->second)) return true;
    }
    return std::any_of(large_.begin(), large_.end(), contains);
  }

 private:
  using Square = std::pair<int64_t, int64_t>;
  using Entry = std::pair<Square, size_t>;  // a lanelet that touches the square
  static constexpr double kSide = 20.0;     // metres
  static constexpr int64_t kMostSquares = 64;

  static Square SquareOf(const MapPoint& point) {
    static constexpr double kMost = 1e9;  // further away is one square
    const auto number = [](double x) {
      return static_cast<int64_t>(std::floor(std::clamp(x / kSide, -kMost, kMost)));
    };
    return {number(point.x), number(point.y)};
  }

  std::vector<Area> areas_;
  std::vector<Entry> entries_;  // by square
  std::vector<size_t> large_;   // touch too many squares: looked at for each point
};

v1::MapFeature Feature(v1::MapFeatureType type, const Polyline& line) {
  v1::MapFeature feature;
  feature.set_type(type);
  for (const MapPoint& point : line) {
    feature.add_x(point.x);
    feature.add_y(point.y);
  }
  return feature;
}

// Appends to `features` the parts of a lanelet's bound beside which no other lanelet lies.
//   side: 1 for the left bound, -1 for the right one.
//   longest: piece that is tested at once, metres
void AddEdges(const Polyline& bound, double side, double longest, size_t own, const Areas& areas,
              std::vector<v1::MapFeature>* features) {
  Polyline run;
  const auto end_run = [&] {
    if (run.size() >= 2) features->push_back(Feature(v1::MAP_FEATURE_TYPE_ROAD_EDGE, run));
    run.clear();
  };
  for (size_t i = 1; i < bound.size(); ++i) {
    const double length = Distance(bound[i - 1], bound[i]);
    if (!(length > 0.0 && std::isfinite(length))) continue;
    const int pieces = static_cast<int>(std::clamp(std::ceil(length / longest), 1.0, kMostPieces));
    const MapPoint beside = {-side * (bound[i].y - bound[i - 1].y) / length * kBeside,
                             side * (bound[i].x - bound[i - 1].x) / length * kBeside};
    for (int k = 0; k < pieces; ++k) {
      const MapPoint middle = Between(bound[i - 1], bound[i], (k + 0.5) / pieces);
      if (areas.IsOnAnother(own, {middle.x + beside.x, middle.y + beside.y})) {
        end_run();
        continue;
      }
      if (run.empty())
        run.push_back(Between(bound[i - 1], bound[i], static_cast<double>(k) / pieces));
      // Keeps only the end of a straight stretch.
      const MapPoint end = Between(bound[i - 1], bound[i], (k + 1.0) / pieces);
      if (k > 0 && run.size() > 1) {
        run.back() = end;
      } else {
        run.push_back(end);
      }
    }
  }
  end_run();
}

// Returns how long the pieces of bounds are that AddEdges tests at once, metres.
double LongestPiece(const std::vector<Lanelet>& lanelets) {
  double total = 0.0;
  for (const Lanelet& lanelet : lanelets) {
    for (const Polyline* bound : {&lanelet.left, &lanelet.right}) {
      for (size_t i = 1; i < bound->size(); ++i) total += Distance((*bound)[i - 1], (*bound)[i]);
    }
  }
  return std::max(kPiece, total / kMostPieces);
}

// Returns the successors of each lanelet, declared by itself or by its successor, without
// duplicates.
std::map<int64_t, std::vector<int64_t>> SuccessorsOf(const std::vector<Lanelet>& lanelets) {
  std::map<int64_t, std::vector<int64_t>> successors;
  const auto add = [&](int64_t from, int64_t to) {
    std::vector<int64_t>& known = successors[from];
    if (std::ssize(known) < scene::ScenarioLimits().max_lane_links &&
        std::find(known.begin(), known.end(), to) == known.end()) {
      known.push_back(to);
    }
  };
  for (const Lanelet& lanelet : lanelets) {
    for (const int64_t id : lanelet.successors) add(lanelet.id, id);
    for (const int64_t id : lanelet.predecessors) add(id, lanelet.id);
  }
  return successors;
}

}  // namespace

Polyline Centerline(const Lanelet& lanelet) {
  const size_t points = std::max(lanelet.left.size(), lanelet.right.size());
  const bool alike = lanelet.left.size() == lanelet.right.size();
  const Polyline left = alike ? lanelet.left : Resample(lanelet.left, points);
  const Polyline right = alike ? lanelet.right : Resample(lanelet.right, points);
  Polyline center;
  for (size_t i = 0; i < points; ++i) center.push_back(Between(left[i], right[i], 0.5));
  return center;
}

std::vector<v1::MapFeature> MapOf(const std::vector<Lanelet>& lanelets) {
  std::vector<v1::MapFeature> features;
  const Areas areas(lanelets);
  std::set<std::pair<int64_t, int64_t>> drawn;  // pairs whose common bound is drawn
  const double longest = LongestPiece(lanelets);
  std::map<int64_t, std::vector<int64_t>> successors = SuccessorsOf(lanelets);
  for (size_t i = 0; i < lanelets.size(); ++i) {
    const Lanelet& lanelet = lanelets[i];
    if (lanelet.kind == Lanelet::Kind::kCrosswalk) {
      features.push_back(Feature(v1::MAP_FEATURE_TYPE_CROSSWALK, areas[i].outline()));
      features.back().set_id(lanelet.id);
      continue;
    }
    if (lanelet.kind != Lanelet::Kind::kSidewalk) {
      v1::MapFeature center =
          Feature(lanelet.kind == Lanelet::Kind::kBicycle ? v1::MAP_FEATURE_TYPE_BIKE_LANE
                                                          : v1::MAP_FEATURE_TYPE_LANE_CENTERLINE,
                  Centerline(lanelet));
      center.set_id(lanelet.id);
      center.set_speed_limit(lanelet.speed_limit);
      for (const int64_t id : successors[lanelet.id]) center.add_successor_ids(id);
      if (lanelet.neighbor_left) center.add_left_neighbor_ids(*lanelet.neighbor_left);
      if (lanelet.neighbor_right) center.add_right_neighbor_ids(*lanelet.neighbor_right);
      features.push_back(std::move(center));
    }
    for (const double side : {1.0, -1.0}) {
      const Polyline& bound = side > 0.0 ? lanelet.left : lanelet.right;
      const std::optional<int64_t>& beside =
          side > 0.0 ? lanelet.beside_left : lanelet.beside_right;
      if (!beside) {
        AddEdges(bound, side, longest, i, areas, &features);
      } else if (drawn.insert(std::minmax(lanelet.id, *beside)).second) {
        features.push_back(Feature(v1::MAP_FEATURE_TYPE_ROAD_LINE, bound));
      }
    }
    for (const Polyline& line : lanelet.stop_lines) {
      features.push_back(Feature(v1::MAP_FEATURE_TYPE_STOP_LINE, line));
    }
  }
  return features;
}

}  // namespace maneuver::data
