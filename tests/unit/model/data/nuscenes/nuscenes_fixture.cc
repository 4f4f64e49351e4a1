#include "tests/unit/model/data/nuscenes/nuscenes_fixture.h"

#include <cmath>
#include <fstream>
#include <numbers>
#include <utility>
#include <vector>

#include "model/files/digest.h"

namespace maneuver::data {
namespace {

using nlohmann::json;

constexpr double kRadian = std::numbers::pi / 180.0;
constexpr int64_t kFirst = 1'532'402'927'000'000;  // microseconds

std::string Of(const std::string& scene, const std::string& name) { return scene + "/" + name; }

json Quaternion(double heading) {
  return {std::cos(heading / 2.0), 0.0, 0.0, std::sin(heading / 2.0)};
}

json Tokens(const std::vector<std::string>& names) {
  json tokens = json::array();
  for (const std::string& name : names) tokens.push_back(NuScenesFixture::Token(name));
  return tokens;
}

void AddNode(const std::string& name, double x, double y, json* map) {
  (*map)["node"].push_back({{"token", NuScenesFixture::Token(name)}, {"x", x}, {"y", y}});
}

void AddPolygon(const std::string& name, const std::vector<std::string>& nodes,
                const std::vector<std::vector<std::string>>& holes, json* map) {
  json rings = json::array();
  for (const auto& hole : holes) rings.push_back({{"node_tokens", Tokens(hole)}});
  (*map)["polygon"].push_back({{"token", NuScenesFixture::Token(name)},
                               {"exterior_node_tokens", Tokens(nodes)},
                               {"holes", rings}});
}

json Segments(const std::vector<std::string>& nodes, const std::string& type) {
  json segments = json::array();
  for (const std::string& node : nodes) {
    segments.push_back({{"node_token", NuScenesFixture::Token(node)}, {"segment_type", type}});
  }
  return segments;
}

void AddLane(const std::string& name, const std::vector<std::string>& left,
             const std::vector<std::string>& right, json* map) {
  (*map)["lane"].push_back(
      {{"token", NuScenesFixture::Token(name)},
       {"polygon_token", NuScenesFixture::Token("area")},
       {"lane_type", "CAR"},
       {"from_edge_line_token", NuScenesFixture::Token("dashes")},
       {"to_edge_line_token", NuScenesFixture::Token("dashes")},
       {"left_lane_divider_segments", Segments(left, "SINGLE_SOLID_WHITE")},
       {"right_lane_divider_segments", Segments(right, "SINGLE_SOLID_WHITE")}});
}

json Path(const std::vector<double>& start, const std::vector<double>& end,
          const std::string& shape, double radius, const std::vector<double>& lengths) {
  return {{"start_pose", start},
          {"end_pose", end},
          {"shape", shape},
          {"radius", radius},
          {"segment_length", lengths}};
}

json Links(const std::vector<std::string>& incoming, const std::vector<std::string>& outgoing) {
  return {{"incoming", Tokens(incoming)}, {"outgoing", Tokens(outgoing)}};
}

json MakeMap() {
  json map = {{"version", "1.3"}, {"canvas_edge", {200.0, 100.0}}};
  for (const char* table :
       {"polygon", "line", "node", "drivable_area", "road_segment", "road_block", "lane",
        "ped_crossing", "walkway", "stop_line", "carpark_area", "road_divider", "lane_divider",
        "traffic_light", "lane_connector"}) {
    map[table] = json::array();
  }
  // Tables may name rows of tables that come later in the file.
  AddPolygon("area", {"a1", "a2", "a3", "a4"}, {{"h1", "h2", "h3"}}, &map);
  AddPolygon("next area", {"a2", "b1", "b2", "a3"}, {}, &map);
  AddPolygon("crossing", {"c1", "c2", "c3", "c4"}, {}, &map);
  AddPolygon("stop", {"s1", "s2", "s3", "s4"}, {}, &map);
  map["polygon"].push_back(
      {{"token", nullptr}, {"exterior_node_tokens", json::array()}, {"holes", json::array()}});
  map["line"] = {
      {{"token", NuScenesFixture::Token("dashes")}, {"node_tokens", Tokens({"d1", "d2", "d3"})}},
      {{"token", NuScenesFixture::Token("middle")}, {"node_tokens", Tokens({"m1", "m2", "m3"})}}};
  for (int i = 0; i < 3; ++i) {
    AddNode("d" + std::to_string(i + 1), 50.0 * i, 1.75, &map);
    AddNode("m" + std::to_string(i + 1), 50.0 * i, 5.25, &map);
  }
  AddNode("a1", 0, -2, &map), AddNode("a2", 60, -2, &map), AddNode("a3", 60, 9, &map),
      AddNode("a4", 0, 9, &map);
  AddNode("b1", 100, -2, &map), AddNode("b2", 100, 9, &map);
  AddNode("h1", 10, 5, &map), AddNode("h2", 12, 5, &map), AddNode("h3", 11, 6, &map);
  AddNode("c1", 70, -2, &map), AddNode("c2", 73, -2, &map), AddNode("c3", 73, 9, &map),
      AddNode("c4", 70, 9, &map);
  AddNode("s1", 67, -1.5, &map), AddNode("s2", 68, -1.5, &map), AddNode("s3", 68, 1.5, &map),
      AddNode("s4", 67, 1.5, &map);
  map["drivable_area"] = {
      {{"token", NuScenesFixture::Token("drivable")},
       {"polygon_tokens",
        {NuScenesFixture::Token("area"), nullptr, NuScenesFixture::Token("next area")}}}};
  AddLane("one", {"d1", "d2", "d3"}, {}, &map);
  AddLane("two", {"m1", "m2", "m3"}, {"d1", "d2", "d3"}, &map);
  AddLane("three", {"m3", "m2", "m1"}, {}, &map);
  AddLane("up", {}, {}, &map);
  for (const char* name : {"left", "back"}) {
    map["lane_connector"].push_back({{"token", NuScenesFixture::Token(name)},
                                     {"polygon_token", NuScenesFixture::Token("area")}});
  }
  map["lane_divider"] = {
      {{"token", NuScenesFixture::Token("divider")},
       {"line_token", NuScenesFixture::Token("dashes")},
       {"lane_divider_segments", Segments({"d1", "d2", "d3"}, "DOUBLE_DASHED_WHITE")}},
      {{"token", NuScenesFixture::Token("unpainted")},
       {"line_token", NuScenesFixture::Token("dashes")},
       {"lane_divider_segments", Segments({"d1", "d2", "d3"}, "NIL")}}};
  map["road_divider"] = {{{"token", NuScenesFixture::Token("road divider")},
                          {"line_token", NuScenesFixture::Token("middle")},
                          {"road_segment_token", nullptr}}};
  map["ped_crossing"] = {{{"token", NuScenesFixture::Token("zebra")},
                          {"polygon_token", NuScenesFixture::Token("crossing")},
                          {"road_segment_token", nullptr}}};
  map["stop_line"] = {{{"token", NuScenesFixture::Token("stop line")},
                       {"polygon_token", NuScenesFixture::Token("stop")},
                       {"stop_line_type", "TRAFFIC_LIGHT"},
                       {"ped_crossing_tokens", json::array()},
                       {"traffic_light_tokens", json::array()},
                       {"road_block_token", nullptr}}};
  const double quarter = 0.5 * std::numbers::pi;
  map["arcline_path_3"] = {
      {NuScenesFixture::Token("one"),
       {Path({0, 0, 0}, {60, 0, 0}, "LSL", 999.0, {0, 60, 0}),
        Path({60, 0, 0}, {100, 0, 0}, "RSR", 999.0, {0, 40, 0})}},
      {NuScenesFixture::Token("two"),
       {Path({0, 3.5, 0}, {100, 3.5, 0}, "LSR", 999.0, {0, 100, 0})}},
      {NuScenesFixture::Token("three"),
       {Path({100, 7, 2 * quarter}, {0, 7, 2 * quarter}, "RSL", 999.0, {0, 100, 0})}},
      {NuScenesFixture::Token("left"),
       {Path({100, 0, 0}, {110, 15, quarter}, "LSL", 10.0, {10.0 * quarter, 5, 0})}},
      {NuScenesFixture::Token("up"),
       {Path({110, 15, quarter}, {110, 35, quarter}, "LSL", 999.0, {0, 20, 0})}},
      {NuScenesFixture::Token("back"),
       {Path({110, 35, quarter}, {90, 35, 3 * quarter}, "LSL", 10.0, {10.0 * 2 * quarter, 0, 0})}}};
  // Only "up" says that it follows "left"; "gone" is not a lane.
  map["connectivity"] = {{NuScenesFixture::Token("one"), Links({"back"}, {"left", "gone"})},
                         {NuScenesFixture::Token("two"), Links({}, {})},
                         {NuScenesFixture::Token("three"), Links({}, {})},
                         {NuScenesFixture::Token("left"), Links({"one"}, {})},
                         {NuScenesFixture::Token("up"), Links({"left"}, {"back"})},
                         {NuScenesFixture::Token("back"), Links({"up"}, {"one"})}};
  return map;
}

void WriteJson(const std::filesystem::path& file, const json& value) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file) << value.dump(0);
}

}  // namespace

std::string NuScenesFixture::Token(const std::string& name) {
  return files::Sha256Hex(name).substr(0, 32);
}

json& NuScenesFixture::Row(const std::string& table, const std::string& name) {
  for (json& row : tables.at(table)) {
    if (row["token"] == Token(name)) return row;
  }
  std::abort();  // no such row: the test is wrong
}

void NuScenesFixture::AddInstance(const std::string& scene, const std::string& name,
                                  const std::string& category, int annotations) {
  tables["instance"].push_back({{"token", Token(Of(scene, name))},
                                {"category_token", Token(category)},
                                {"nbr_annotations", annotations},
                                {"first_annotation_token", ""},
                                {"last_annotation_token", ""}});
}

void NuScenesFixture::Annotate(const std::string& scene, int sample, const std::string& name,
                               double x, double y, double heading, const std::string& attribute) {
  const std::string of_sample = Of(scene, std::to_string(sample));
  tables["sample_annotation"].push_back(
      {{"token", Token(Of(of_sample, name))},
       {"sample_token", Token(of_sample)},
       {"instance_token", Token(Of(scene, name))},
       {"visibility_token", "4"},
       {"attribute_tokens", attribute.empty() ? json::array() : Tokens({attribute})},
       {"translation", {x, y, 0.9}},
       {"size", {1.9, 4.5, 1.6}},
       {"rotation", Quaternion(heading)},
       {"prev", ""},
       {"next", ""},
       {"num_lidar_pts", 7},
       {"num_radar_pts", 0}});
}

NuScenesFixture::NuScenesFixture(int scenes, int samples) : map(MakeMap()) {
  for (const char* table :
       {"log", "scene", "sample", "category", "attribute", "instance", "sample_annotation",
        "sensor", "calibrated_sensor", "sample_data", "ego_pose"}) {
    tables[table] = json::array();
  }
  for (const char* name :
       {"vehicle.car", "vehicle.bicycle", "human.pedestrian.adult", "movable_object.barrier"}) {
    tables["category"].push_back({{"token", Token(name)}, {"name", name}, {"description", ""}});
  }
  for (const char* name : {"vehicle.moving", "cycle.with_rider", "cycle.without_rider"}) {
    tables["attribute"].push_back({{"token", Token(name)}, {"name", name}, {"description", ""}});
  }
  for (const char* name : {"LIDAR_TOP", "CAM_FRONT"}) {
    tables["sensor"].push_back({{"token", Token(name)}, {"channel", name}, {"modality", "lidar"}});
    tables["calibrated_sensor"].push_back({{"token", Token(Of("calibrated", name))},
                                           {"sensor_token", Token(name)},
                                           {"translation", {0.9, 0.0, 1.8}},
                                           {"rotation", Quaternion(0.0)},
                                           {"camera_intrinsic", json::array()}});
  }
  for (int s = 0; s < scenes; ++s) {
    const std::string number = std::to_string(s + 1);
    const std::string scene = "scene-" + std::string(4 - number.size(), '0') + number;
    const std::string log = std::string("n001-") + static_cast<char>('a' + s / 2);
    if (s % 2 == 0) {
      tables["log"].push_back({{"token", Token(log)},
                               {"logfile", log},
                               {"vehicle", "n001"},
                               {"date_captured", "2018-07-24"},
                               {"location", "toy-town"}});
    }
    tables["scene"].push_back({{"token", Token(scene)},
                               {"log_token", Token(log)},
                               {"nbr_samples", samples},
                               {"first_sample_token", Token(Of(scene, "0"))},
                               {"last_sample_token", Token(Of(scene, std::to_string(samples - 1)))},
                               {"name", scene},
                               {"description", ""}});
    const int64_t first = kFirst + int64_t{60'000'000} * s;
    AddInstance(scene, "car", "vehicle.car", samples);
    AddInstance(scene, "walker", "human.pedestrian.adult", samples);
    AddInstance(scene, "rider", "vehicle.bicycle", samples);
    AddInstance(scene, "bicycle", "vehicle.bicycle", samples);
    AddInstance(scene, "barrier", "movable_object.barrier", 1);
    AddInstance(scene, "turner", "vehicle.car", samples);
    for (int i = 0; i < samples; ++i) {
      tables["sample"].push_back({{"token", Token(Of(scene, std::to_string(i)))},
                                  {"timestamp", first + 500'000 * i},
                                  {"scene_token", Token(scene)},
                                  {"prev", ""},
                                  {"next", ""}});
      const double t = 0.5 * i;
      Annotate(scene, i, "car", 10.0 * t, 0.0, 0.0, "vehicle.moving");
      Annotate(scene, i, "walker", 20.0, -10.0 + t, 90.0 * kRadian, "");
      Annotate(scene, i, "rider", 4.0 * t, -3.0, 0.0, "cycle.with_rider");
      Annotate(scene, i, "bicycle", 30.0, -6.0, 0.0, "cycle.without_rider");
      if (i == 0) Annotate(scene, i, "barrier", 40.0, -6.0, 0.0, "");
      Annotate(scene, i, "turner", 50.0, 10.0, (170.0 + 20.0 * i) * kRadian, "");
    }
    for (int i = 0; i <= 10 * (samples - 1); ++i) {  // at 20 Hz; the camera has poses of its own
      for (const char* sensor : {"LIDAR_TOP", "CAM_FRONT"}) {
        const std::string name = Of(Of(scene, sensor), std::to_string(i));
        tables["sample_data"].push_back(
            {{"token", Token(name)},
             {"sample_token",
              Token(Of(scene, std::to_string(std::min((i + 9) / 10, samples - 1))))},
             {"ego_pose_token", Token(Of("pose", name))},
             {"calibrated_sensor_token", Token(Of("calibrated", sensor))},
             {"timestamp", first + 50'000 * i},
             {"fileformat", "pcd"},
             {"is_key_frame", i % 10 == 0},
             {"height", 0},
             {"width", 0},
             {"filename", ""},
             {"prev", ""},
             {"next", ""}});
        const bool is_lidar = std::string(sensor) == "LIDAR_TOP";
        tables["ego_pose"].push_back({{"token", Token(Of("pose", name))},
                                      {"timestamp", first + 50'000 * i},
                                      {"rotation", Quaternion(0.0)},
                                      {"translation", {is_lidar ? 0.4 * i : -1e6, 3.5, 0.0}}});
      }
    }
  }
}

void NuScenesFixture::Write(const std::filesystem::path& root) const {
  for (const auto& [name, rows] : tables) WriteJson(Tables(root) / (name + ".json"), rows);
  WriteJson(root / "maps" / "expansion" / "toy-town.json", map);
}

}  // namespace maneuver::data
