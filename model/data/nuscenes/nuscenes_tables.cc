#include "model/data/nuscenes/nuscenes_tables.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/nuscenes/json_rows.h"
#include "model/data/quoted_text.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

constexpr std::array<const char*, 11> kTables = {"log",
                                                 "scene",
                                                 "sample",
                                                 "category",
                                                 "attribute",
                                                 "instance",
                                                 "sample_annotation",
                                                 "sensor",
                                                 "calibrated_sensor",
                                                 "sample_data",
                                                 "ego_pose"};
constexpr const char* kLidar = "LIDAR_TOP";
constexpr double kMicrosecond = 1e-6;

template <typename Value>
using ByToken = std::unordered_map<std::string, Value>;

std::filesystem::path FileOf(const std::filesystem::path& folder, const char* table) {
  return folder / absl::StrCat(table, ".json");
}

// Returns the angle of a rotation about the vertical axis. Fails unless the quaternion w, x, y, z
// has about unit length.
float HeadingOf(const JsonRow& row) {
  const auto [w, x, y, z] = row.Numbers<4>("rotation", 1.1);
  if (row.ok() && std::abs(w * w + x * x + y * y + z * z - 1.0) > 0.1) {
    row.Fail("rotation", "must be a quaternion of unit length");
  }
  return static_cast<float>(std::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)));
}

class TableReader {
 public:
  TableReader(const std::filesystem::path& folder,
              const std::function<absl::Status(const absl::Status&)>& damaged,
              const std::function<void(double)>& progress)
      : folder_(folder), damaged_(damaged), progress_(progress) {}

  absl::StatusOr<std::vector<NuScenesScene>> Read() {
    using Add = void (TableReader::*)(const JsonRow&);
    const std::array<Add, kTables.size()> adds = {
        &TableReader::AddLog,        &TableReader::AddScene,     &TableReader::AddSample,
        &TableReader::AddCategory,   &TableReader::AddAttribute, &TableReader::AddInstance,
        &TableReader::AddAnnotation, &TableReader::AddSensor,    &TableReader::AddCalibration,
        &TableReader::AddSampleData, &TableReader::AddPose};
    for (size_t i = 0; i < kTables.size(); ++i) {
      if (kTables[i] == std::string_view("category")) CheckSamples();
      const absl::Status status = ReadTable(kTables[i], adds[i]);
      if (!status.ok()) return status;
    }
    if (absl::Status status = CheckAnnotations(); !status.ok()) return status;
    CheckPoses();
    std::vector<NuScenesScene> scenes;
    for (Scene& scene : scenes_) scenes.push_back(std::move(scene.scene));
    return scenes;
  }

 private:
  struct Scene {
    NuScenesScene scene;
    int64_t announced = 0;  // samples
    int64_t samples = 0;
    int64_t first = INT64_MAX;  // timestamp of the first sample
    int64_t last = INT64_MIN;
    std::unordered_map<size_t, size_t> tracks;  // of instances, into scene.tracks
  };
  struct Sample {
    size_t scene = 0;
    int64_t timestamp = 0;
  };
  struct Instance {
    std::string token;
    std::string category;
    int64_t announced = 0;  // annotations
    int64_t annotations = 0;
    std::optional<size_t> scene;
  };

  absl::Status ReadTable(const char* table, void (TableReader::*add)(const JsonRow&)) {
    const std::filesystem::path file = FileOf(folder_, table);
    const absl::Status status = ReadJsonRows(
        file, {},
        [&](std::string_view, std::string_view, const JsonRow& row) {
          scene_of_row_.reset();
          (this->*add)(row);
          if (row.ok()) return absl::OkStatus();
          const absl::Status damage = absl::DataLossError(std::string(row.status().message()));
          if (!scene_of_row_) return damaged_(damage);
          Damage(*scene_of_row_, std::string(damage.message()));
          return absl::OkStatus();
        },
        [&](double bytes) { progress_(before_ + bytes); });
    std::error_code error;
    before_ += static_cast<double>(std::filesystem::file_size(file, error));
    progress_(before_);
    return status;
  }

  void Damage(size_t scene, const std::string& reason) {
    std::string& damage = scenes_[scene].scene.damage;
    if (damage.empty()) damage = reason;
  }

  // Returns the value of the token that a field names. Fails if there is none.
  template <typename Value>
  const Value* Follow(const JsonRow& row, const char* field, const ByToken<Value>& table,
                      const char* file) const {
    const std::string token = row.Text(field);
    const auto found = table.find(token);
    if (found != table.end()) return &found->second;
    row.Fail(field, absl::StrCat("names ", QuotedText(token), ", which is not in ", file));
    return nullptr;
  }

  // Stores the value of a row under its token.
  template <typename Value>
  void Store(const JsonRow& row, Value value, ByToken<Value>* table) const {
    const std::string token = row.Text("token");
    if (!row.ok()) return;
    if (!table->emplace(token, std::move(value)).second) {
      row.Fail("token", absl::StrCat("is ", QuotedText(token), ", as in an earlier row"));
    }
  }

  void AddLog(const JsonRow& row) {
    std::string file = row.TextOrNone("logfile");
    if (file.empty()) file = row.Text("token");
    Store(row, std::pair(file, row.Text("location")), &logs_);
  }

  void AddScene(const JsonRow& row) {
    const size_t number = scenes_.size();
    Store(row, number, &scene_numbers_);
    if (!row.ok()) return;
    Scene& scene = scenes_.emplace_back();
    scene_of_row_ = number;
    scene.scene.name = row.TextOrNone("name");
    if (scene.scene.name.empty()) scene.scene.name = row.Text("token");
    scene.announced = row.Whole("nbr_samples");
    const auto* const log = Follow(row, "log_token", logs_, "log.json");
    if (log == nullptr) return;
    scene.scene.log = log->first;
    scene.scene.location = log->second;
  }

  void AddSample(const JsonRow& row) {
    const size_t* const scene = Follow(row, "scene_token", scene_numbers_, "scene.json");
    if (scene == nullptr) return;
    scene_of_row_ = *scene;
    const int64_t timestamp = Timestamp(row);
    Store(row, Sample{*scene, timestamp}, &samples_);
    if (!row.ok()) return;
    ++scenes_[*scene].samples;
    scenes_[*scene].first = std::min(scenes_[*scene].first, timestamp);
    scenes_[*scene].last = std::max(scenes_[*scene].last, timestamp);
  }

  int64_t Timestamp(const JsonRow& row) const {  // microseconds
    const int64_t timestamp = row.Whole("timestamp");
    if (!(std::abs(static_cast<double>(timestamp)) * kMicrosecond <=
          scene::ScenarioLimits().max_time)) {
      row.Fail("timestamp", "must be in microseconds");
    }
    return row.ok() ? timestamp : 0;
  }

  void CheckSamples() {
    for (size_t i = 0; i < scenes_.size(); ++i) {
      Scene& scene = scenes_[i];
      if (scene.samples != scene.announced || scene.samples == 0) {
        Damage(i, absl::StrCat("sample.json has ", scene.samples,
                               " samples of it, where scene.json announces ", scene.announced));
      }
      if (scene.samples > 0) {
        scene.scene.duration = static_cast<double>(scene.last - scene.first) * kMicrosecond;
      }
    }
  }

  void AddCategory(const JsonRow& row) { Store(row, row.Text("name"), &categories_); }
  void AddAttribute(const JsonRow& row) { Store(row, row.Text("name"), &attributes_); }

  void AddInstance(const JsonRow& row) {
    Store(row, instances_.size(), &instance_numbers_);
    if (!row.ok()) return;
    Instance& instance = instances_.emplace_back();
    instance.token = row.Text("token");
    instance.announced = row.Whole("nbr_annotations");
    const auto* const category = Follow(row, "category_token", categories_, "category.json");
    if (category != nullptr) instance.category = *category;
  }

  void AddAnnotation(const JsonRow& row) {
    const Sample* const sample = Follow(row, "sample_token", samples_, "sample.json");
    if (sample == nullptr) return;
    scene_of_row_ = sample->scene;
    const size_t* const number = Follow(row, "instance_token", instance_numbers_, "instance.json");
    const scene::ScenarioLimits limits;
    const std::array<double, 3> place = row.Numbers<3>("translation", limits.max_coordinate);
    const std::array<double, 3> size = row.Numbers<3>("size", limits.max_size);
    const float heading = HeadingOf(row);
    if (row.ok() && !(size[0] > 0.0 && size[1] > 0.0)) row.Fail("size", "must be positive");
    bool ridden = false, unridden = false;
    for (const std::string& token : row.Texts("attribute_tokens")) {
      const auto found = attributes_.find(token);
      if (found == attributes_.end()) {
        row.Fail("attribute_tokens",
                 absl::StrCat("names ", QuotedText(token), ", which is not in attribute.json"));
        break;
      }
      ridden = ridden || found->second == "cycle.with_rider";
      unridden = unridden || found->second == "cycle.without_rider";
    }
    if (!row.ok()) return;
    Instance& instance = instances_[*number];
    if (instance.category.empty()) {
      return row.Fail("instance_token", "names an instance without a category");
    }
    if (instance.scene && *instance.scene != sample->scene) {
      return row.Fail("instance_token", "names an instance of another scene");
    }
    instance.scene = sample->scene;
    ++instance.annotations;
    Scene& scene = scenes_[sample->scene];
    const auto [track_number, is_new] = scene.tracks.try_emplace(*number, scene.tracks.size());
    if (is_new) {
      scene.scene.tracks.push_back({.token = instance.token,
                                    .category = instance.category,
                                    .length = static_cast<float>(size[1]),
                                    .width = static_cast<float>(size[0])});
      scene.scene.tracks.back().keyframes.reserve(
          static_cast<size_t>(std::clamp<int64_t>(instance.announced, 1, scene.samples)));
    }
    NuScenesTrack& track = scene.scene.tracks[track_number->second];
    track.ridden = track.ridden || ridden;
    track.unridden = track.unridden || unridden;
    track.keyframes.push_back({static_cast<double>(sample->timestamp - scene.first) * kMicrosecond,
                               place[0], place[1], heading});
  }

  // Returns what `damaged_` says of an instance without annotations, which belongs to no scene.
  absl::Status CheckAnnotations() {
    for (const Instance& instance : instances_) {
      if (instance.annotations == instance.announced) continue;
      if (!instance.scene && instance.category.empty()) continue;  // its own row was damaged
      const std::string damage = absl::StrCat(
          "sample_annotation.json has ", instance.annotations, " annotations of instance ",
          QuotedText(instance.token), ", where instance.json announces ", instance.announced);
      if (instance.scene) {
        Damage(*instance.scene, damage);
      } else if (absl::Status status = damaged_(absl::DataLossError(damage)); !status.ok()) {
        return status;
      }
    }
    return absl::OkStatus();
  }

  void AddSensor(const JsonRow& row) { Store(row, row.Text("channel") == kLidar, &is_lidar_); }

  void AddCalibration(const JsonRow& row) {
    const bool* const is_lidar = Follow(row, "sensor_token", is_lidar_, "sensor.json");
    if (is_lidar != nullptr) Store(row, *is_lidar, &is_lidar_calibration_);
  }

  void AddSampleData(const JsonRow& row) {
    const Sample* const sample = Follow(row, "sample_token", samples_, "sample.json");
    if (sample == nullptr) return;
    scene_of_row_ = sample->scene;
    const bool* const is_lidar =
        Follow(row, "calibrated_sensor_token", is_lidar_calibration_, "calibrated_sensor.json");
    const std::string pose = row.Text("ego_pose_token");
    if (row.ok() && *is_lidar) poses_.emplace(pose, sample->scene);
  }

  void AddPose(const JsonRow& row) {
    const std::string token = row.Text("token");
    const auto wanted = poses_.find(token);
    if (wanted == poses_.end()) return;
    scene_of_row_ = wanted->second;
    poses_.erase(wanted);
    const int64_t timestamp = Timestamp(row);
    const std::array<double, 3> place =
        row.Numbers<3>("translation", scene::ScenarioLimits().max_coordinate);
    const float heading = HeadingOf(row);
    Scene& scene = scenes_[*scene_of_row_];
    if (!row.ok() || scene.samples == 0) return;
    scene.scene.ego.push_back(
        {static_cast<double>(timestamp - scene.first) * kMicrosecond, place[0], place[1], heading});
  }

  void CheckPoses() {
    for (const auto& [token, scene] : poses_) {
      Damage(scene, absl::StrCat("ego_pose.json lacks ", QuotedText(token),
                                 ", which sample_data.json names as ego_pose_token"));
    }
  }

  const std::filesystem::path& folder_;
  const std::function<absl::Status(const absl::Status&)>& damaged_;
  const std::function<void(double)>& progress_;
  double before_ = 0.0;                 // bytes of the tables that are read
  std::optional<size_t> scene_of_row_;  // that the present row belongs to

  std::vector<Scene> scenes_;
  std::vector<Instance> instances_;
  ByToken<std::pair<std::string, std::string>> logs_;  // file, location
  ByToken<size_t> scene_numbers_;
  ByToken<Sample> samples_;
  ByToken<std::string> categories_;
  ByToken<std::string> attributes_;
  ByToken<size_t> instance_numbers_;
  ByToken<bool> is_lidar_;              // sensors
  ByToken<bool> is_lidar_calibration_;  // calibrated sensors
  ByToken<size_t> poses_;               // that are wanted, and not seen yet: their scenes
};

}  // namespace

absl::StatusOr<double> SizeOfNuScenes(const std::filesystem::path& folder) {
  double bytes = 0.0;
  for (const char* table : kTables) {
    std::error_code error;
    const auto size = std::filesystem::file_size(FileOf(folder, table), error);
    if (error) {
      return absl::NotFoundError(absl::StrCat(FileOf(folder, table).string(), ": ", error.message(),
                                              "; the tables of nuScenes are in one folder"));
    }
    bytes += static_cast<double>(size);
  }
  return bytes;
}

absl::StatusOr<std::vector<NuScenesScene>> ReadNuScenes(
    const std::filesystem::path& folder,
    const std::function<absl::Status(const absl::Status& damage)>& damaged,
    const std::function<void(double bytes)>& progress) {
  return TableReader(folder, damaged, progress).Read();
}

}  // namespace maneuver::data
