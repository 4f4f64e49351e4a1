#include "tests/unit/model/data/argoverse/argoverse_fixture.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace maneuver::data {
namespace {

std::string Row(double time, const char* track, const char* type, double x, double y) {
  return absl::StrFormat("%.6f,%s,%s,%.9f,%.9f,PIT\n", time, track, type, x, y);
}

struct LaneTags {
  std::string left = "None";
  std::string right = "None";
  std::vector<int> predecessors = {};
  std::vector<int> successors = {};
};

std::string Way(int lane, int from, int to, const LaneTags& tags) {
  std::string way = absl::StrCat(
      " <way lane_id=\"", lane, "\">\n  <tag k=\"has_traffic_control\" v=\"False\" />\n",
      "  <tag k=\"turn_direction\" v=\"NONE\" />\n  <tag k=\"is_intersection\" v=\"False\" />\n",
      "  <tag k=\"l_neighbor_id\" v=\"", tags.left, "\" />\n  <tag k=\"r_neighbor_id\" v=\"",
      tags.right, "\" />\n  <nd ref=\"", from, "\" />\n  <nd ref=\"", to, "\" />\n");
  for (const int id : tags.predecessors) {
    absl::StrAppend(&way, "  <tag k=\"predecessor\" v=\"", id, "\" />\n");
  }
  for (const int id : tags.successors) {
    absl::StrAppend(&way, "  <tag k=\"successor\" v=\"", id, "\" />\n");
  }
  return absl::StrCat(way, " </way>\n");
}

}  // namespace

std::string ArgoverseSequence(double first) {
  std::string csv = "TIMESTAMP,TRACK_ID,OBJECT_TYPE,X,Y,CITY_NAME\n";
  for (int i = 0; i < 50; ++i) {
    const double t = 0.1 * i;
    absl::StrAppend(&csv, Row(first + t, "av", "AV", 10.0 * t, 0.0),
                    Row(first + t, "agent", "AGENT", 10.0 + 8.0 * t - 0.5 * t * t, 3.5),
                    Row(first + t, "parked", "OTHERS", 30.0, 7.0));
    if (i < 10) absl::StrAppend(&csv, Row(first + t, "short", "OTHERS", 50.0, -20.0 + 2.0 * t));
  }
  return csv;
}

std::string ArgoverseMap() {
  std::string xml = "<?xml version=\"1.0\"?>\n<ArgoverseVectorMap>\n";
  const std::vector<std::pair<double, double>> nodes = {
      {0, 0}, {50, 0}, {100, 0}, {0, 3.5}, {50, 3.5}, {50, 7}, {0, 7}, {5000, 0}, {5050, 0}};
  for (size_t i = 0; i < nodes.size(); ++i) {
    absl::StrAppend(&xml, " <node id=\"", i, "\" x=\"", nodes[i].first, "\" y=\"", nodes[i].second,
                    "\" height=\"0.5\" />\n");
  }
  return absl::StrCat(xml, Way(1, 0, 1, {.left = "3"}),
                      Way(2, 1, 2, {.predecessors = {1}, .successors = {5, 99}}),
                      Way(3, 3, 4, {.left = "4", .right = "1"}), Way(4, 5, 6, {.left = "3"}),
                      Way(5, 7, 8, {.successors = {1}}), "</ArgoverseVectorMap>\n");
}

}  // namespace maneuver::data
