#include "model/data/nuscenes/expansion_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/lane_links.h"
#include "model/data/nuscenes/arcline_path.h"
#include "model/data/nuscenes/json_rows.h"
#include "model/data/quoted_text.h"
#include "model/files/errno_status.h"
#include "model/scene/pose2.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

using scene::Point2;

constexpr double kResolution = 1.0;              // of centrelines, metres
constexpr double kLongestPath = 5'000.0;         // of one lane, metres
constexpr double kLongestNetwork = 5'000'000.0;  // of all lanes, metres
constexpr size_t kMostPoints = 10'000'000;       // of all lines and areas
constexpr double kEndTolerance = 0.5;            // from end_pose, metres
constexpr double kLongestEdge = 50.0;            // of a piece of road edge, metres
constexpr size_t kSharedNodes = 2;               // of a divider between neighbours

constexpr std::array<std::string_view, 12> kLayers = {
    "node",           "line",          "polygon",      "lane",
    "lane_connector", "lane_divider",  "road_divider", "ped_crossing",
    "stop_line",      "drivable_area", "connectivity", "arcline_path_3"};

using Nodes = std::vector<size_t>;  // numbers of nodes

struct Polygon {
  std::vector<Nodes> rings;  // exterior, then holes
};

struct Lane {
  std::string token;
  v1::MapFeatureType type = v1::MAP_FEATURE_TYPE_LANE_CENTERLINE;
  Nodes left;   // of the dividers
  Nodes right;  // of the dividers
  std::string place;
};

// A row that becomes features once all tables are read.
struct Shape {
  std::string token;  // of a line or polygon
  std::string place;  // "boston-seaport.json: ped_crossing, row with token 'abc'"
};

class MapReader {
 public:
  MapReader(const std::filesystem::path& file,
            const std::function<absl::Status(const absl::Status&)>& damaged)
      : file_(file), name_(files::NameOf(file)), damaged_(damaged) {}

  absl::StatusOr<ExpansionMap> Read(const std::function<void(double)>& progress) {
    absl::Status status = ReadJsonRows(
        file_, kLayers,
        [this](std::string_view table, std::string_view key, const JsonRow& row) {
          seen_.insert(std::string(table));
          ReadRow(table, std::string(key), row);
          return row.ok() ? absl::OkStatus() : Damage(row.status());
        },
        progress);
    if (!status.ok()) return status;
    for (const char* table : {"node", "lane", "arcline_path_3", "connectivity"}) {
      if (seen_.contains(table)) continue;
      return absl::DataLossError(
          absl::StrCat(name_, ": no map expansion of nuScenes: it has no rows of ", table));
    }
    status = AddLanes();
    if (status.ok()) status = AddLines();
    if (status.ok()) status = AddAreas();
    if (status.ok()) status = AddEdges();
    if (!status.ok()) return status;
    return std::move(map_);
  }

 private:
  absl::Status Damage(const absl::Status& status) {
    return damaged_(absl::DataLossError(std::string(status.message())));
  }
  absl::Status Damage(const std::string& place, const std::string& problem) {
    return damaged_(absl::DataLossError(absl::StrCat(place, ": ", problem)));
  }
  std::string PlaceOf(std::string_view table, const std::string& token) const {
    return absl::StrCat(name_, ": ", std::string(table), " ", QuotedText(token));
  }

  void ReadRow(std::string_view table, const std::string& key, const JsonRow& row) {
    if (table == "arcline_path_3") return ReadPaths(key, row);
    if (table == "connectivity") return ReadLinks(key, row);
    if (table == "polygon") return ReadPolygon(row);
    const std::string token = row.Text("token");
    if (table == "node") {
      const double most = scene::ScenarioLimits().max_coordinate;
      const Point2 point = {row.Number("x", most), row.Number("y", most)};
      if (row.ok()) nodes_[NumberOf(token)] = point;
    } else if (table == "line") {
      const Nodes nodes = NodesOf(row, "node_tokens");
      if (row.ok()) lines_[token] = nodes;
    } else if (table == "lane") {
      const bool for_bicycles = row.Text("lane_type") == "BIKE";
      lanes_.push_back(
          {token,
           for_bicycles ? v1::MAP_FEATURE_TYPE_BIKE_LANE : v1::MAP_FEATURE_TYPE_LANE_CENTERLINE,
           SegmentNodes(row, "left_lane_divider_segments"),
           SegmentNodes(row, "right_lane_divider_segments"), PlaceOf(table, token)});
      if (!row.ok()) lanes_.pop_back();
    } else if (table == "lane_connector") {
      if (row.ok()) {
        connectors_.push_back(
            {token, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {}, {}, PlaceOf(table, token)});
      }
    } else if (table == "drivable_area") {
      const std::vector<std::string> polygons = row.Texts("polygon_tokens");
      for (const std::string& polygon : polygons) {
        if (row.ok()) drivable_.push_back({polygon, PlaceOf(table, token)});
      }
    } else if (table == "ped_crossing" || table == "stop_line") {
      const std::string polygon = row.Text("polygon_token");
      if (row.ok()) {
        (table == "stop_line" ? stop_lines_ : crossings_)
            .push_back({polygon, PlaceOf(table, token)});
      }
    } else {
      const std::string line = row.Text("line_token");
      bool painted = table == "road_divider";
      if (!painted) {
        for (const JsonRow& segment : row.Rows("lane_divider_segments")) {
          painted = painted || segment.Text("segment_type") != "NIL";
        }
      }
      if (row.ok() && painted) dividers_.push_back({line, PlaceOf(table, token)});
    }
  }

  // Numbers node tokens in the order of their first use: rows name a node before its own row comes.
  size_t NumberOf(const std::string& token) {
    return node_numbers_.try_emplace(token, node_numbers_.size()).first->second;
  }
  Nodes NodesOf(const JsonRow& row, const char* field) {
    Nodes nodes;
    for (const std::string& token : row.Texts(field)) nodes.push_back(NumberOf(token));
    return nodes;
  }
  Nodes SegmentNodes(const JsonRow& row, const char* field) {
    Nodes nodes;
    for (const JsonRow& segment : row.Rows(field)) {
      nodes.push_back(NumberOf(segment.Text("node_token")));
    }
    return nodes;
  }

  void ReadPolygon(const JsonRow& row) {
    const std::string token = row.TextOrNone("token");  // null in some published rows
    Polygon polygon;
    polygon.rings.push_back(NodesOf(row, "exterior_node_tokens"));
    for (const JsonRow& hole : row.Rows("holes"))
      polygon.rings.push_back(NodesOf(hole, "node_tokens"));
    if (row.ok() && !token.empty()) polygons_[token] = std::move(polygon);
  }

  void ReadPaths(const std::string& lane, const JsonRow& row) {
    const double most = scene::ScenarioLimits().max_coordinate;
    std::vector<Point2> points;
    double length = 0.0;
    for (const JsonRow& part : row.Elements()) {
      const std::array<double, 3> start = part.Numbers<3>("start_pose", most);
      const std::array<double, 3> end = part.Numbers<3>("end_pose", most);
      ArclinePath path = {.start = {start[0], start[1], start[2]},
                          .lengths = part.Numbers<3>("segment_length", kLongestPath)};
      const auto curvatures = CurvaturesOf(part.Text("shape"), part.Number("radius", 1e12));
      if (row.ok() && !curvatures.ok()) part.Fail("", std::string(curvatures.status().message()));
      if (*std::min_element(path.lengths.begin(), path.lengths.end()) < 0.0) {
        part.Fail("segment_length", "must not be negative");
      }
      length += path.length();
      if (length > kLongestPath) part.Fail("segment_length", "is longer than any lane");
      // A part of 100 bytes may become 5,000 points.
      if (network_length_ + length > kLongestNetwork) {
        part.Fail("segment_length", "makes all lanes together longer than those of any city");
      }
      if (!row.ok()) return;
      path.curvatures = *curvatures;
      const scene::Pose2 reached = path.PoseAt(path.length());
      // Also if a radius near 0 leads nowhere: then neither is a number.
      if (!(std::hypot(reached.x() - end[0], reached.y() - end[1]) <= kEndTolerance)) {
        part.Fail("end_pose", "is not where the segments end");
        return;
      }
      AppendPoints(path, kResolution, &points);
    }
    if (!row.ok() || points.size() < 2) return;
    network_length_ += length;
    paths_[lane] = std::move(points);
  }

  void ReadLinks(const std::string& lane, const JsonRow& row) {
    for (const std::string& next : row.Texts("outgoing")) links_.emplace_back(lane, next);
    for (const std::string& before : row.Texts("incoming")) links_.emplace_back(before, lane);
  }

  absl::Status AddLanes() {
    lanes_.insert(lanes_.end(), connectors_.begin(), connectors_.end());
    std::unordered_map<std::string, v1::MapFeature*> by_token;
    map_.features.reserve(lanes_.size());
    std::vector<const Lane*> kept;
    for (size_t i = 0; i < lanes_.size(); ++i) {
      const Lane& lane = lanes_[i];
      const auto path = paths_.find(lane.token);
      if (path == paths_.end()) {
        ++map_.pathless_lanes;
        continue;
      }
      if (by_token.contains(lane.token)) {
        const absl::Status status = Damage(lane.place, "occurs twice");
        if (!status.ok()) return status;
        continue;
      }
      v1::MapFeature& feature = AddFeature(lane.type, path->second);
      feature.set_id(static_cast<int64_t>(i) + 1);
      by_token.emplace(lane.token, &feature);
      kept.push_back(&lane);
    }
    std::set<std::pair<std::string, std::string>> open;  // each is declared from both sides
    for (const auto& [from, to] : links_) {
      const auto first = by_token.find(from);
      const auto second = by_token.find(to);
      if (first == by_token.end() || second == by_token.end()) {
        open.emplace(from, to);
        continue;
      }
      AddLaneLink(second->second->id(), first->second->mutable_successor_ids());
    }
    map_.open_links = static_cast<int64_t>(open.size());
    AddNeighbors(kept);
    return absl::OkStatus();
  }

  // map_.features holds the lanes `kept`, in their order, and nothing else.
  void AddNeighbors(const std::vector<const Lane*>& kept) {
    std::unordered_map<size_t, std::vector<size_t>> by_right_node;  // lanes
    for (size_t i = 0; i < kept.size(); ++i) {
      for (const size_t node : kept[i]->right) by_right_node[node].push_back(i);
    }
    for (size_t i = 0; i < kept.size(); ++i) {
      std::map<size_t, size_t> shared;  // nodes with each lane
      for (const size_t node : std::set<size_t>(kept[i]->left.begin(), kept[i]->left.end())) {
        const auto found = by_right_node.find(node);
        if (found == by_right_node.end()) continue;
        for (const size_t other : std::set<size_t>(found->second.begin(), found->second.end())) {
          ++shared[other];
        }
      }
      for (const auto& [other, nodes] : shared) {
        if (other == i || nodes < kSharedNodes) continue;
        AddLaneLink(map_.features[other].id(), map_.features[i].mutable_left_neighbor_ids());
        AddLaneLink(map_.features[i].id(), map_.features[other].mutable_right_neighbor_ids());
      }
    }
  }

  absl::Status AddLines() {
    for (const Shape& divider : dividers_) {
      const auto line = lines_.find(divider.token);
      std::vector<Point2> points;
      absl::Status status;
      if (line == lines_.end()) {
        status = Damage(divider.place,
                        absl::StrCat("line_token ", QuotedText(divider.token), " names no line"));
      } else {
        const absl::StatusOr<bool> counted = Count(line->second, divider.place);
        status = counted.status();
        if (counted.ok() && *counted) status = Resolve(line->second, divider.place, 2, &points);
      }
      if (!status.ok()) return status;
      if (!points.empty()) AddFeature(v1::MAP_FEATURE_TYPE_ROAD_LINE, points);
    }
    return absl::OkStatus();
  }

  absl::Status AddAreas() {
    for (const auto& [shapes, type] : {std::pair(&crossings_, v1::MAP_FEATURE_TYPE_CROSSWALK),
                                       std::pair(&stop_lines_, v1::MAP_FEATURE_TYPE_STOP_LINE)}) {
      for (const Shape& shape : *shapes) {
        const absl::StatusOr<const Polygon*> polygon = Find(shape);
        if (!polygon.ok()) return polygon.status();
        if (*polygon == nullptr) continue;
        const Nodes& outline = (*polygon)->rings[0];
        const absl::StatusOr<bool> counted = Count(outline, shape.place);
        if (!counted.ok()) return counted.status();
        if (!*counted) continue;
        std::vector<Point2> points;
        const absl::Status status = Resolve(outline, shape.place, 3, &points);
        if (!status.ok()) return status;
        if (points.empty()) continue;
        if (type == v1::MAP_FEATURE_TYPE_STOP_LINE) points.push_back(points.front());
        AddFeature(type, points);
      }
    }
    return absl::OkStatus();
  }

  absl::Status AddEdges() {
    std::vector<std::pair<const Nodes*, const Shape*>> rings;
    std::map<std::pair<size_t, size_t>, int> uses;  // of each edge, by its nodes
    for (const Shape& shape : drivable_) {
      const absl::StatusOr<const Polygon*> polygon = Find(shape);
      if (!polygon.ok()) return polygon.status();
      if (*polygon == nullptr) continue;
      for (const Nodes& ring : (*polygon)->rings) {
        const absl::StatusOr<bool> counted = Count(ring, shape.place);
        if (!counted.ok()) return counted.status();
        if (!*counted) continue;
        rings.emplace_back(&ring, &shape);
        for (size_t i = 0; i < ring.size(); ++i) {
          ++uses[std::minmax(ring[i], ring[(i + 1) % ring.size()])];
        }
      }
    }
    for (const auto& [ring, shape] : rings) {
      std::vector<Point2> points;
      const absl::Status status = Resolve(*ring, shape->place, 3, &points);
      if (!status.ok()) return status;
      if (points.empty()) continue;
      std::vector<Point2> piece;
      double length = 0.0;
      const auto end_piece = [&] {
        if (piece.size() >= 2) AddFeature(v1::MAP_FEATURE_TYPE_ROAD_EDGE, piece);
        piece.clear();
        length = 0.0;
      };
      for (size_t i = 0; i < points.size(); ++i) {
        const size_t next = (i + 1) % points.size();
        if (uses[std::minmax((*ring)[i], (*ring)[next])] > 1) {
          end_piece();
          continue;
        }
        length += std::hypot(points[next].x - points[i].x, points[next].y - points[i].y);
        if (piece.empty()) piece.push_back(points[i]);
        piece.push_back(points[next]);
        if (length >= kLongestEdge) end_piece();
      }
      end_piece();
    }
    return absl::OkStatus();
  }

  // Returns the polygon of a shape, or nullptr if there is none and reading goes on.
  absl::StatusOr<const Polygon*> Find(const Shape& shape) {
    const auto found = polygons_.find(shape.token);
    if (found != polygons_.end()) return &found->second;
    const absl::Status status = Damage(
        shape.place, absl::StrCat("polygon token ", QuotedText(shape.token), " names no polygon"));
    if (!status.ok()) return status;
    return static_cast<const Polygon*>(nullptr);
  }

  // Counts the nodes of a row's line or area: many rows may name one large polygon. Returns false if
  // there are too many, and reading goes on.
  absl::StatusOr<bool> Count(const Nodes& nodes, const std::string& place) {
    if (nodes.size() > kMostPoints - points_) {
      const absl::Status status =
          Damage(place, "makes lines and areas have more points than those of any city");
      if (!status.ok()) return status;
      return false;
    }
    points_ += nodes.size();
    return true;
  }

  // Looks the nodes up. Leaves `points` empty if one is missing or there are fewer than `least`,
  // and reading goes on.
  absl::Status Resolve(const Nodes& nodes, const std::string& place, size_t least,
                       std::vector<Point2>* points) {
    if (nodes.size() < least) {
      return Damage(place, absl::StrCat("has fewer than ", least, " nodes"));
    }
    for (const size_t node : nodes) {
      const auto found = nodes_.find(node);
      if (found == nodes_.end()) {
        points->clear();
        return Damage(place, "names a node that does not exist");
      }
      points->push_back(found->second);
    }
    return absl::OkStatus();
  }

  v1::MapFeature& AddFeature(v1::MapFeatureType type, const std::vector<Point2>& points) {
    v1::MapFeature& feature = map_.features.emplace_back();
    feature.set_type(type);
    for (const Point2& point : points) {
      feature.add_x(point.x);
      feature.add_y(point.y);
    }
    return feature;
  }

  const std::filesystem::path& file_;
  const std::string name_;
  const std::function<absl::Status(const absl::Status&)>& damaged_;
  ExpansionMap map_;

  std::set<std::string> seen_;                            // tables with rows
  std::unordered_map<std::string, size_t> node_numbers_;  // by token
  std::unordered_map<size_t, Point2> nodes_;              // by number
  std::unordered_map<std::string, Nodes> lines_;
  std::unordered_map<std::string, Polygon> polygons_;
  std::unordered_map<std::string, std::vector<Point2>> paths_;  // by lane
  double network_length_ = 0.0;                                 // of all paths, metres
  size_t points_ = 0;                                           // of lines and areas
  std::vector<std::pair<std::string, std::string>> links_;      // from, to
  std::vector<Lane> lanes_;
  std::vector<Lane> connectors_;
  std::vector<Shape> dividers_;
  std::vector<Shape> crossings_;
  std::vector<Shape> stop_lines_;
  std::vector<Shape> drivable_;
};

}  // namespace

absl::StatusOr<ExpansionMap> ReadExpansionMap(
    const std::filesystem::path& file,
    const std::function<absl::Status(const absl::Status& damage)>& damaged,
    const std::function<void(double bytes)>& progress) {
  return MapReader(file, damaged).Read(progress);
}

}  // namespace maneuver::data
