// Imports of several files: nuScenes with its tables and map, Argoverse with a sequence and a map.
// The bytes hold one file after the other, each behind a line "@NAME". What is refused has a reason
// and a place. What is accepted can be written into a dataset and read again.

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "model/data/argoverse/argoverse_reader.h"
#include "model/data/argoverse/vector_map.h"
#include "model/data/dataset_folder.h"
#include "model/data/nuscenes/expansion_map.h"
#include "model/data/nuscenes/nuscenes_scene.h"
#include "model/data/nuscenes/nuscenes_tables.h"
#include "model/scene/scenario_validation.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

// What nuScenes has beside its map.
constexpr std::array<const char*, 11> kTables = {"log",         "scene",
                                                 "sample",      "category",
                                                 "attribute",   "instance",
                                                 "sensor",      "calibrated_sensor",
                                                 "sample_data", "sample_annotation",
                                                 "ego_pose"};

using Files = std::map<std::string, std::string, std::less<>>;  // by name

Files FilesIn(std::string_view bytes) {
  Files files;
  while (!bytes.empty()) {
    // The first byte may be the end of the line before.
    const size_t end = bytes.find("\n@", 1);
    std::string_view file = bytes.substr(0, end);
    bytes = end == std::string_view::npos ? "" : bytes.substr(end + 1);
    if (file.front() != '@') continue;
    const size_t line = std::min(file.find('\n'), file.size());
    const std::string name(file.substr(1, line - 1));
    file.remove_prefix(line);
    files[name] = file.substr(0, 1) == "\n" ? file.substr(1) : file;
  }
  return files;
}

std::filesystem::path WriteFile(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << content;
  return path;
}

void ExpectPlace(const absl::Status& status, std::initializer_list<std::string_view> places) {
  for (const std::string_view place : places) {
    if (absl::StrContains(status.message(), absl::string_view(place.data(), place.size()))) return;
  }
  Expect(false, absl::StrCat("a refusal names a place: ", status.ToString()));
}

// As ValidateMap sees a map that a caller registers.
void ExpectMap(const std::vector<v1::MapFeature>& features) {
  scene::MapFeatures map;
  for (const v1::MapFeature& feature : features) *map.Add() = feature;
  const auto violations = scene::ValidateMap(map, scene::ScenarioLimits());
  Expect(violations.empty(),
         violations.empty() ? "" : violations[0].field + ": " + violations[0].description);
}

// Writes what an import would take of these recordings, and reads it again.
void ExpectDataset(const std::vector<v1::Scenario>& scenarios) {
  const std::filesystem::path folder = Folder() / "imported";
  std::vector<const v1::Scenario*> valid;
  std::set<std::string> ids;
  for (const v1::Scenario& scenario : scenarios) {
    Expect(!scenario.scenario_id().empty() && scenario.agents_size() > 0,
           "a recording has an id and agents");
    const auto violations = scene::ValidateScenario(scenario, scene::ScenarioLimits());
    for (const auto& violation : violations) {
      Expect(!violation.field.empty() && !violation.description.empty(),
             "a violation has a field and a description");
    }
    // An import gives a repeated id a number.
    if (violations.empty() && ids.insert(scenario.scenario_id()).second) valid.push_back(&scenario);
  }
  if (valid.empty()) return;
  std::filesystem::remove_all(folder);
  auto writer = data::DatasetWriter::Create(folder, "fuzz");
  Expect(writer.ok(), writer.status().ToString());
  for (const v1::Scenario* scenario : valid) {
    const absl::Status added = (*writer)->Add(*scenario);
    Expect(added.ok(), added.ToString());
  }
  const auto written = (*writer)->Commit();
  Expect(written.ok(), written.status().ToString());
  size_t read = 0;
  const absl::Status status =
      data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& scenario) {
        Expect(
            read < valid.size() && scenario.SerializeAsString() == valid[read]->SerializeAsString(),
            "a recording is read as it was written");
        ++read;
        return true;
      });
  Expect(status.ok(), status.ToString());
  Expect(read == valid.size(), "all recordings are read");
}

}  // namespace

void NuScenes(std::string_view bytes) {
  static const auto& folder = *new std::filesystem::path([] {
    const auto made = Folder() / "nuscenes";
    std::filesystem::create_directories(made);
    return made;
  }());
  const Files files = FilesIn(bytes);
  for (const char* table : kTables) {
    const auto found = files.find(table);
    const auto path = folder / absl::StrCat(table, ".json");
    if (found == files.end()) {
      std::filesystem::remove(path);
    } else {
      WriteFile(path, found->second);
    }
  }
  const auto tolerate = [](const absl::Status& damage) {
    Expect(absl::IsDataLoss(damage), damage.ToString());
    ExpectPlace(damage, {".json[", " annotations of instance "});
    return absl::OkStatus();
  };
  const auto ignore = [](double) {};
  data::CityMap city;
  if (const auto map = files.find("map"); map != files.end()) {
    auto read = data::ReadExpansionMap(
        WriteFile(folder / "toy-town.json", map->second),
        [](const absl::Status& damage) {
          Expect(absl::IsDataLoss(damage), damage.ToString());
          ExpectPlace(damage, {"toy-town.json"});
          return absl::OkStatus();
        },
        ignore);
    if (read.ok()) {
      ExpectMap(read->features);
      city = data::CityMap(std::move(read->features));
    } else {
      Expect(absl::IsDataLoss(read.status()), read.status().ToString());
      ExpectPlace(read.status(), {"toy-town.json"});
    }
  }
  const auto scenes = data::ReadNuScenes(folder, tolerate, ignore);
  if (!scenes.ok()) {
    Expect(absl::IsDataLoss(scenes.status()) || absl::IsNotFound(scenes.status()),
           scenes.status().ToString());
    ExpectPlace(scenes.status(), {".json"});
    return;
  }
  std::vector<v1::Scenario> recordings;
  for (const data::NuScenesScene& scene : *scenes) {
    Expect(!scene.name.empty(), "a scene has a name, which tells its place");
    auto recording = data::ScenarioOf(scene, &city);
    if (recording.ok()) {
      recordings.push_back(*std::move(recording));
    } else {
      Expect(absl::IsInvalidArgument(recording.status()), recording.status().ToString());
      ExpectPlace(recording.status(), {".json", "instance ", "the recording car"});
    }
  }
  ExpectDataset(recordings);
}

void Argoverse(std::string_view bytes) {
  const Files files = FilesIn(bytes);
  data::CityMaps maps;
  if (const auto map = files.find("map"); map != files.end()) {
    const char* const name = "PIT_vector_map.xml";
    auto read = data::ReadVectorMap(WriteFile(Folder() / name, map->second),
                                    [name](const absl::Status& damage) {
                                      Expect(absl::IsDataLoss(damage), damage.ToString());
                                      ExpectPlace(damage, {name});
                                      return absl::OkStatus();
                                    });
    if (read.ok()) {
      ExpectMap(read->lanes);
      maps["PIT"] = data::CityMap(std::move(read->lanes));
    } else {
      Expect(absl::IsDataLoss(read.status()), read.status().ToString());
      ExpectPlace(read.status(), {name});
    }
  }
  const auto sequence = files.find("sequence");
  if (sequence == files.end()) return;
  std::vector<v1::Scenario> recordings;
  for (const data::CityMaps* known :
       {static_cast<const data::CityMaps*>(nullptr), static_cast<const data::CityMaps*>(&maps)}) {
    auto recording = data::ParseArgoverse(sequence->second, "12345", known);
    if (recording.ok()) {
      for (const v1::Agent& agent : recording->agents()) {
        for (const v1::AgentState& state : agent.states()) {
          Expect(std::isfinite(state.heading()) && std::isfinite(state.velocity_x()) &&
                     std::isfinite(state.velocity_y()),
                 "what is derived is finite");
        }
      }
      recordings.push_back(*std::move(recording));
    } else {
      Expect(absl::IsInvalidArgument(recording.status()), recording.status().ToString());
      ExpectPlace(recording.status(),
                  {"row ", "rows", "first line", "TRACK_ID", "OBJECT_TYPE", "CITY_NAME"});
    }
    if (known != nullptr) ExpectDataset(recordings);
  }
}

}  // namespace maneuver::fuzz
