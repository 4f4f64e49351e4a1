#include "tests/bench/bench_scenes.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>
#include <utility>

#include "client/observed_scenario.h"
#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
#include "model/data/town/synthetic_town.h"
#include "model/data/waymo/waymo_reader.h"
#include "model/scene/target_frame.h"

namespace maneuver::bench {
namespace {

constexpr double kStateTolerance = 0.05;  // seconds
// Ids of copies are apart by these.
constexpr int64_t kCopiedAgents = int64_t{1} << 40;
constexpr int64_t kCopiedFeatures = int64_t{1} << 40;

// Chooses the targets. Returns false if there are too few vehicles.
bool ChooseTargets(int targets, v1::Scenario* scene) {
  const double now = scene->prediction_time();
  const auto position = [&](const v1::Agent& agent) {
    return scene::TargetPose(agent, now, kStateTolerance);
  };
  const v1::Agent* first =
      scene->target_ids().empty() ? nullptr : scene::FindAgent(*scene, scene->target_ids(0));
  const auto center = first == nullptr ? std::nullopt : position(*first);
  std::vector<std::pair<double, int64_t>> vehicles;
  for (const v1::Agent& agent : scene->agents()) {
    if (agent.type() != v1::AGENT_TYPE_VEHICLE) continue;
    const auto X_WT = position(agent);
    if (!X_WT) continue;
    const scene::Point2 p_W = *X_WT * scene::Point2{0.0, 0.0};
    const scene::Point2 c_W = center ? *center * scene::Point2{0.0, 0.0} : p_W;
    vehicles.emplace_back(std::hypot(p_W.x - c_W.x, p_W.y - c_W.y), agent.id());
  }
  if (static_cast<int>(vehicles.size()) < targets) return false;
  std::sort(vehicles.begin(), vehicles.end());
  scene->clear_target_ids();
  for (int i = 0; i < targets; ++i) {
    scene->add_target_ids(vehicles[static_cast<size_t>(i)].second);
  }
  return true;
}

void AddScene(v1::Scenario scene, int targets, std::vector<v1::Scenario>* scenes) {
  if (!ChooseTargets(targets, &scene)) return;
  client::StripFuture(&scene);
  scenes->push_back(std::move(scene));
}

// Returns the width of the map along x, metres.
double MapWidth(const v1::Scenario& scene) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const v1::MapFeature& feature : scene.map_features()) {
    for (const double x : feature.x()) {
      low = std::min(low, x);
      high = std::max(high, x);
    }
  }
  return high - low;
}

// Returns the map features by their distance from the first target.
std::vector<const v1::MapFeature*> NearestFirst(const v1::Scenario& scene) {
  const v1::Agent* const target = scene::FindAgent(scene, scene.target_ids(0));
  const auto X_WT = scene::TargetPose(*target, scene.prediction_time(), kStateTolerance);
  std::vector<std::pair<double, const v1::MapFeature*>> features;
  for (const v1::MapFeature& feature : scene.map_features()) {
    double nearest = std::numeric_limits<double>::infinity();
    for (int i = 0; i < feature.x_size(); ++i) {
      nearest = std::min(nearest, std::hypot(feature.x(i) - X_WT->x(), feature.y(i) - X_WT->y()));
    }
    features.emplace_back(nearest, &feature);
  }
  std::stable_sort(features.begin(), features.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<const v1::MapFeature*> sorted;
  for (const auto& [distance, feature] : features) sorted.push_back(feature);
  return sorted;
}

// Adds a feature, `shift` metres along x from where it is. The lanes of a copy follow each other.
void AddCopy(const v1::MapFeature& feature, int copy, double shift, v1::Scenario* scene) {
  v1::MapFeature& added = *scene->add_map_features();
  added = feature;
  for (double& x : *added.mutable_x()) x += shift;
  const int64_t offset = copy * kCopiedFeatures;
  if (added.id() != 0) added.set_id(added.id() + offset);
  for (int64_t& id : *added.mutable_successor_ids()) id += offset;
}

}  // namespace

absl::StatusOr<std::vector<v1::Scenario>> DatasetScenes(const std::filesystem::path& folder,
                                                        int targets, int most) {
  std::vector<v1::Scenario> scenes;
  const absl::Status status =
      data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& scene) {
        AddScene(std::move(scene), targets, &scenes);
        return static_cast<int>(scenes.size()) < most;
      });
  if (!status.ok()) return status;
  return scenes;
}

std::vector<v1::Scenario> WaymoRecordings() {
  std::vector<v1::Scenario> recordings;
  const char* folder = std::getenv("MANEUVER_REAL_DATA");
  if (folder == nullptr) return recordings;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.path().filename().string().starts_with("validation.tfrecord")) continue;
    auto reader = data::TfRecordReader::Open(entry.path());
    std::string payload;
    while (reader.ok() && (*reader)->Next(&payload).ok()) {
      auto recording = data::ParseWaymoScenario(payload);
      if (recording.ok()) recordings.push_back(*std::move(recording));
    }
  }
  return recordings;
}

std::vector<v1::Scenario> WaymoScenes(int targets, int most) {
  std::vector<v1::Scenario> scenes;
  for (v1::Scenario& recording : WaymoRecordings()) {
    if (static_cast<int>(scenes.size()) == most) break;
    AddScene(std::move(recording), targets, &scenes);
  }
  return scenes;
}

std::vector<v1::Scenario> TownScenes(int targets, int most) {
  constexpr int kTries = 20;  // for each scene: many layouts have few vehicles
  std::vector<v1::Scenario> scenes;
  for (int i = 0; i < kTries * most && static_cast<int>(scenes.size()) < most; ++i) {
    AddScene(data::town::GenerateRecording({}, i).scenario, targets, &scenes);
  }
  return scenes;
}

int64_t MapPoints(const v1::Scenario& scenario) {
  int64_t points = 0;
  for (const v1::MapFeature& feature : scenario.map_features()) points += feature.x_size();
  return points;
}

v1::PredictRequest RequestFor(const std::vector<v1::Scenario>& scenes, int actions) {
  v1::PredictRequest request;
  for (const v1::Scenario& scene : scenes) *request.add_scenarios() = scene;
  request.mutable_query()->set_top_k(actions);
  return request;
}

v1::Scenario WithAgents(const v1::Scenario& scene, int count) {
  v1::Scenario changed = scene;
  changed.clear_agents();
  std::vector<const v1::Agent*> others;
  for (const v1::Agent& agent : scene.agents()) {
    const bool target = std::find(scene.target_ids().begin(), scene.target_ids().end(),
                                  agent.id()) != scene.target_ids().end();
    if (target) {
      *changed.add_agents() = agent;
    } else {
      others.push_back(&agent);
    }
  }
  for (int i = 0; i < count && !others.empty(); ++i) {
    const size_t copy = static_cast<size_t>(i) / others.size();
    v1::Agent& agent = *changed.add_agents();
    agent = *others[static_cast<size_t>(i) % others.size()];
    agent.set_id(agent.id() + static_cast<int64_t>(copy) * kCopiedAgents);
  }
  return changed;
}

v1::Scenario WithMapPoints(const v1::Scenario& scene, int64_t points) {
  v1::Scenario changed = scene;
  changed.clear_map_features();
  if (MapPoints(scene) == 0) return changed;
  const std::vector<const v1::MapFeature*> features = NearestFirst(scene);
  const double width = MapWidth(scene);
  int64_t have = 0;
  for (size_t i = 0; have < points; ++i) {
    const v1::MapFeature& feature = *features[i % features.size()];
    const auto copy = static_cast<int>(i / features.size());
    AddCopy(feature, copy, copy * width, &changed);
    have += feature.x_size();
  }
  return changed;
}

v1::Scenario WithMapCopies(const v1::Scenario& scene, int copies) {
  v1::Scenario changed = scene;
  changed.clear_map_features();
  for (int copy = 0; copy < copies; ++copy) {
    for (const v1::MapFeature& feature : scene.map_features()) {
      AddCopy(feature, copy, 0.0, &changed);
    }
  }
  return changed;
}

}  // namespace maneuver::bench
