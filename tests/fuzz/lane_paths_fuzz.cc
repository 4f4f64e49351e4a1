// Lanes and lane paths of any valid map: within their bounds, finite, and the same in a mirror.

#include <cmath>

#include "model/scene/lane_graph.h"
#include "model/scene/lane_paths.h"
#include "model/scene/road_map.h"
#include "model/scene/scenario_validation.h"
#include "model/scene/target_frame.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

void ExpectGraph(const scene::LaneGraph& graph, const scene::MapFeatures& features) {
  Expect(graph.bytes() <= scene::LaneGraph::MostBytes(features),
         "a graph keeps its bound of memory");
  for (int i = 0; i < graph.size(); ++i) {
    const scene::Lane& lane = graph.lane(i);
    Expect(lane.first < lane.last, "a lane has two points at least");
    Expect(i + 1 == graph.size() || lane.last < graph.lane(i + 1).first, "lanes share no point");
    Expect(graph.Successors(i).size() <= scene::LaneGraph::kMostSuccessors,
           "a lane has few successors");
    for (const int next : graph.Successors(i)) {
      Expect(next >= 0 && next < graph.size(), "successors exist");
      Expect(next != i, "no lane is its own successor");
      Expect(graph.Gap(lane, next) <= scene::LaneGraph::kMostDeclaredGap + 1e-6,
             "successors begin near the end");
    }
    double before = -1.0;
    for (int p = lane.first; p <= lane.last; ++p) {
      const scene::LanePoint& point = graph.points()[p];
      Expect(std::isfinite(point.distance) && point.distance > before, "arc lengths increase");
      Expect(std::abs(std::hypot(point.cosine, point.sine) - 1.0) < 1e-6, "headings are headings");
      before = point.distance;
    }
  }
}

// Which numbers of a row change their sign in a mirror: y, sines and the offset.
bool IsMirrored(int number) {
  if (number < 26) return number % 2 == 1;
  if (number < 39) return false;
  if (number < 52) return true;
  if (number < 62) return number % 2 == 1;
  return number == 62 || number == 63;
}

void ExpectInputs(const scene::LanePathInputs& inputs) {
  Expect(inputs.count >= 0 && inputs.count <= scene::kMostLanePaths, "six paths at most");
  for (size_t i = 0; i < inputs.values.size(); ++i) {
    Expect(std::isfinite(inputs.values[i]), "path inputs are finite");
    Expect(
        i < static_cast<size_t>(inputs.count * scene::kLanePathInputs) || inputs.values[i] == 0.0f,
        "rows without a path are 0");
  }
}

}  // namespace

void LanePaths(std::string_view bytes) {
  v1::Scenario scenario;
  if (!ParseMessage(bytes, &scenario)) return;
  if (!scene::ValidateMap(scenario.map_features(), {}).empty()) return;
  const scene::RoadMap map = scene::RoadMap::Over(scenario.map_features());
  ExpectGraph(map.lanes(), scenario.map_features());
  if (!scene::ValidateScenario(scenario, {}).empty()) return;

  static auto& finder = *new scene::LanePathFinder();
  for (int a = 0; a < std::min(scenario.agents_size(), 3); ++a) {
    const v1::Agent& agent = scenario.agents(a);
    const auto X_WT = scene::TargetPose(agent, scenario.prediction_time(), 0.125);
    if (!X_WT) continue;
    scene::LanePathInputs inputs;
    finder.Find(scenario, map.lanes(), scenario.prediction_time(), agent.id(), *X_WT, 8.0, {},
                &inputs);
    ExpectInputs(inputs);
    const auto paths =
        finder.Describe(scenario, map.lanes(), scenario.prediction_time(), agent.id(), *X_WT);
    Expect(paths.size() == static_cast<size_t>(inputs.count),
           "as many paths are drawn as are read");
    for (const scene::LanePath& path : paths) {
      Expect(path.points.size() >= 2, "a drawn path has two points at least");
      for (const scene::Point2& point : path.points) {
        Expect(std::isfinite(point.x) && std::isfinite(point.y), "drawn paths are finite");
      }
    }
    scene::LanePathInputs mirrored;
    finder.Find(scenario, map.lanes(), scenario.prediction_time(), agent.id(), *X_WT, 8.0,
                {.scale = 1.0, .mirror = true}, &mirrored);
    Expect(mirrored.count == inputs.count, "a mirror has the same paths");
    for (int i = 0; i < inputs.count * scene::kLanePathInputs; ++i) {
      const float value = inputs.values[static_cast<size_t>(i)];
      const float there = mirrored.values[static_cast<size_t>(i)];
      Expect((IsMirrored(i % scene::kLanePathInputs) ? -value : value) == there,
             "a mirror changes signs alone");
    }
    for (const double scale : {0.8, 1.25}) {
      finder.Find(scenario, map.lanes(), scenario.prediction_time(), agent.id(), *X_WT, -3.0,
                  {.scale = scale, .mirror = false}, &mirrored);
      ExpectInputs(mirrored);
    }
  }
}

}  // namespace maneuver::fuzz
