#include "model/data/argoverse/vector_map.h"

#include <cmath>
#include <map>
#include <pugixml.hpp>
#include <string>
#include <unordered_map>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "model/data/lane_links.h"
#include "model/data/quoted_text.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/scene/pose2.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

using pugi::xml_node;
using scene::Point2;

// One way: its feature, and what it declares.
struct Way {
  v1::MapFeature lane;
  std::vector<int64_t> successors;
  std::vector<int64_t> predecessors;
  std::vector<int64_t> left;
  std::vector<int64_t> right;
};

using Nodes = std::unordered_map<int64_t, Point2>;

bool IsCoordinate(double value) {
  return std::abs(value) <= scene::ScenarioLimits().max_coordinate;
}

absl::Status AddNode(const xml_node& node, Nodes* nodes) {
  int64_t id = 0;
  Point2 point;
  const char* const text = node.attribute("id").as_string();
  if (!absl::SimpleAtoi(text, &id)) {
    return absl::DataLossError(
        absl::StrCat("node: id ", QuotedText(text), " is not a whole number"));
  }
  for (const auto& [name, value] : {std::pair("x", &point.x), std::pair("y", &point.y)}) {
    const char* const number = node.attribute(name).as_string();
    if (!absl::SimpleAtod(number, value) || !IsCoordinate(*value)) {
      return absl::DataLossError(
          absl::StrCat("node ", id, ": ", name, " ", QuotedText(number), " is not a coordinate"));
    }
  }
  if (!nodes->emplace(id, point).second) {
    return absl::DataLossError(absl::StrCat("node ", id, ": another node has this id"));
  }
  return absl::OkStatus();
}

// Reads <tag k="..." v="..."/>.
absl::Status AddTag(const xml_node& tag, const std::string& what, Way* way) {
  const std::string key = tag.attribute("k").as_string();
  const char* const text = tag.attribute("v").as_string();
  const std::map<std::string, std::vector<int64_t>*> links = {{"successor", &way->successors},
                                                              {"predecessor", &way->predecessors},
                                                              {"l_neighbor_id", &way->left},
                                                              {"r_neighbor_id", &way->right}};
  const auto found = links.find(key);
  if (found == links.end() || std::string(text) == "None") return absl::OkStatus();
  int64_t id = 0;
  if (!absl::SimpleAtoi(text, &id)) {
    return absl::DataLossError(
        absl::StrCat(what, ": ", key, " ", QuotedText(text), " is neither a lane nor None"));
  }
  found->second->push_back(id);
  return absl::OkStatus();
}

absl::StatusOr<Way> ReadWay(const xml_node& node, const Nodes& nodes) {
  Way way;
  int64_t id = 0;
  const char* const text = node.attribute("lane_id").as_string();
  if (!absl::SimpleAtoi(text, &id)) {
    return absl::DataLossError(
        absl::StrCat("way: lane_id ", QuotedText(text), " is not a whole number"));
  }
  const std::string what = absl::StrCat("way ", id);
  way.lane.set_id(id);
  way.lane.set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (const xml_node& child : node.children()) {
    if (std::string(child.name()) == "tag") {
      const absl::Status status = AddTag(child, what, &way);
      if (!status.ok()) return status;
    } else if (std::string(child.name()) == "nd") {
      int64_t ref = 0;
      const char* const named = child.attribute("ref").as_string();
      const auto found = absl::SimpleAtoi(named, &ref) ? nodes.find(ref) : nodes.end();
      if (found == nodes.end()) {
        return absl::DataLossError(
            absl::StrCat(what, ": nd ref ", QuotedText(named), " names no node"));
      }
      way.lane.add_x(found->second.x);
      way.lane.add_y(found->second.y);
    }
  }
  if (way.lane.x_size() < 2) {
    return absl::DataLossError(absl::StrCat(what, ": has fewer than two nd"));
  }
  return way;
}

// Returns whether two lanes run in about the same direction, from end to end.
bool RunTheSameWay(const v1::MapFeature& a, const v1::MapFeature& b) {
  const auto along = [](const v1::MapFeature& lane) {
    return Point2{*lane.x().rbegin() - lane.x(0), *lane.y().rbegin() - lane.y(0)};
  };
  return along(a).x * along(b).x + along(a).y * along(b).y > 0.0;
}

VectorMap Linked(std::vector<Way> ways) {
  VectorMap map;
  std::unordered_map<int64_t, v1::MapFeature*> lanes;
  for (Way& way : ways) lanes.emplace(way.lane.id(), &way.lane);
  const auto find = [&](int64_t id) {
    const auto found = lanes.find(id);
    if (found != lanes.end()) return found->second;
    ++map.open_links;
    return static_cast<v1::MapFeature*>(nullptr);
  };
  for (Way& way : ways) {
    for (const int64_t id : way.successors) {
      if (find(id) != nullptr) AddLaneLink(id, way.lane.mutable_successor_ids());
    }
    for (const int64_t id : way.predecessors) {
      v1::MapFeature* const before = find(id);
      if (before != nullptr) AddLaneLink(way.lane.id(), before->mutable_successor_ids());
    }
    for (const auto& [ids, neighbors] :
         {std::pair(&way.left, way.lane.mutable_left_neighbor_ids()),
          std::pair(&way.right, way.lane.mutable_right_neighbor_ids())}) {
      for (const int64_t id : *ids) {
        const v1::MapFeature* const neighbor = find(id);
        if (neighbor != nullptr && RunTheSameWay(way.lane, *neighbor)) AddLaneLink(id, neighbors);
      }
    }
  }
  for (Way& way : ways) map.lanes.push_back(std::move(way.lane));
  return map;
}

}  // namespace

absl::StatusOr<VectorMap> ReadVectorMap(
    const std::filesystem::path& file,
    const std::function<absl::Status(const absl::Status& damage)>& damaged) {
  absl::StatusOr<std::string> xml = files::ReadFile(file);
  if (!xml.ok()) return xml.status();
  const std::string name = files::NameOf(file);
  const auto damage = [&](const absl::Status& status) {
    return damaged(absl::DataLossError(absl::StrCat(name, ": ", std::string(status.message()))));
  };
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer_inplace(xml->data(), xml->size());
  if (!parsed) {
    return absl::DataLossError(
        absl::StrCat(name, ": no XML: ", parsed.description(), " at byte ", parsed.offset));
  }
  Nodes nodes;
  std::vector<Way> ways;
  std::unordered_map<int64_t, size_t> seen;
  // All nodes come first: a way may name one that is written after it.
  for (const xml_node& node : document.document_element().children("node")) {
    absl::Status status = AddNode(node, &nodes);
    if (!status.ok()) status = damage(status);
    if (!status.ok()) return status;
  }
  for (const xml_node& node : document.document_element().children("way")) {
    absl::StatusOr<Way> way = ReadWay(node, nodes);
    absl::Status status = way.status();
    if (status.ok() && !seen.emplace(way->lane.id(), ways.size()).second) {
      status = absl::DataLossError(
          absl::StrCat("way ", way->lane.id(), ": another way has this lane_id"));
    }
    if (!status.ok()) {
      status = damage(status);
      if (!status.ok()) return status;
      continue;
    }
    ways.push_back(*std::move(way));
  }
  if (ways.empty()) {
    return absl::DataLossError(
        absl::StrCat(name, ": no vector map of Argoverse 1: it has no <way>"));
  }
  return Linked(std::move(ways));
}

}  // namespace maneuver::data
