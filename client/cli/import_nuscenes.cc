// maneuver import nuscenes: the tables and the map expansion of nuScenes as a dataset folder.

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/dataset_import.h"
#include "client/cli/import_formats.h"
#include "model/data/nuscenes/expansion_map.h"
#include "model/data/nuscenes/nuscenes_scene.h"
#include "model/data/nuscenes/nuscenes_tables.h"
#include "model/files/durable_file.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;

// Share of the progress that reading the tables takes. The scenes that they hold take the rest.
constexpr double kReading = 0.9;

bool HoldsTables(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder / "scene.json", error);
}

// Returns the folders of tables that the inputs name: themselves, or the one within each.
absl::StatusOr<std::vector<ImportFile>> FindTables(const std::vector<std::string>& inputs) {
  std::vector<ImportFile> found;
  for (const std::string& input : inputs) {
    std::vector<std::string> folders;
    if (HoldsTables(input)) {
      folders.push_back(input);
    } else {
      std::error_code error;
      const auto entries = files::ListFolder(input);
      if (!entries.ok() && fs::is_directory(input, error)) return entries.status();
      for (const fs::path& entry : entries.value_or(std::vector<fs::path>())) {
        if (HoldsTables(entry)) folders.push_back(entry);
      }
    }
    if (folders.empty()) {
      return absl::NotFoundError(
          absl::StrCat(input,
                       " holds no scene.json, nor does a folder in it; name a folder such as "
                       "nuscenes/v1.0-trainval"));
    }
    if (folders.size() > 1) {
      return absl::InvalidArgumentError(absl::StrCat(
          input, " holds several sets of tables: ", absl::StrJoin(folders, ", "), "; name one"));
    }
    const absl::StatusOr<double> bytes = data::SizeOfNuScenes(folders[0]);
    if (!bytes.ok()) return bytes.status();
    found.push_back({folders[0], *bytes / kReading});
  }
  return found;
}

using Maps = std::map<std::string, std::shared_ptr<const data::CityMap>>;  // by location

// Reads the maps of the scenes' locations.
absl::StatusOr<Maps> ReadMaps(const fs::path& folder,
                              const std::vector<data::NuScenesScene>& scenes, ImportSink& sink) {
  Maps maps;
  for (const data::NuScenesScene& scene : scenes) {
    if (!scene.damage.empty() || maps.contains(scene.location)) continue;
    // A name from a file must not lead elsewhere.
    const std::string name = absl::StrCat(fs::path(scene.location).filename().string(), ".json");
    std::error_code error;
    fs::path file = folder / "expansion" / name;
    if (!fs::exists(file, error)) file = folder / name;
    if (!fs::exists(file, error)) {
      return absl::NotFoundError(absl::StrCat(
          (folder / "expansion" / name).string(),
          " does not exist; unpack the map expansion there, name its folder by --maps, or import "
          "without maps by --maps none"));
    }
    absl::StatusOr<data::ExpansionMap> map = data::ReadExpansionMap(
        file, [&sink](const absl::Status& damage) { return sink.Damaged(damage); }, [](double) {});
    if (!map.ok()) return map.status();
    if (map->open_links > 0) {
      sink.Note(absl::StrCat(name, ": ", map->open_links,
                             " links of connectivity name lanes that the map lacks; left out"));
    }
    if (map->pathless_lanes > 0) {
      sink.Note(absl::StrCat(name, ": ", map->pathless_lanes,
                             " lanes have no usable arcline_path_3; left out"));
    }
    maps[scene.location] = std::make_shared<data::CityMap>(std::move(map->features));
  }
  return maps;
}

absl::Status ReadScenes(const fs::path& tables, const std::optional<std::string>& maps_folder,
                        ImportSink& sink) {
  absl::StatusOr<std::vector<data::NuScenesScene>> scenes = data::ReadNuScenes(
      tables, [&sink](const absl::Status& damage) { return sink.Damaged(damage); },
      [&sink](double bytes) { sink.ShowProgress(bytes); });
  if (!scenes.ok()) return scenes.status();
  Maps maps;
  if (maps_folder != "none") {
    // "v1.0-mini/" has an empty last part.
    const fs::path beside =
        fs::absolute(tables / "scene.json").lexically_normal().parent_path().parent_path();
    const fs::path folder = maps_folder ? fs::path(*maps_folder) : beside / "maps";
    absl::StatusOr<Maps> read = ReadMaps(folder, *scenes, sink);
    if (!read.ok()) return read.status();
    maps = *std::move(read);
  }
  const absl::StatusOr<double> bytes = data::SizeOfNuScenes(tables);
  if (!bytes.ok()) return bytes.status();
  const double of_each = *bytes * (1.0 / kReading - 1.0) / static_cast<double>(scenes->size());
  double end = *bytes;
  for (data::NuScenesScene& read : *scenes) {
    end += of_each;
    const auto scene = std::make_shared<const data::NuScenesScene>(std::move(read));
    const auto map = maps.find(scene->location);
    const absl::Status status =
        sink.Take({[scene, map = map == maps.end() ? nullptr : map->second] {
                     return data::ScenarioOf(*scene, map.get());
                   },
                   scene->name, end});
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

struct NuScenesArguments {
  ImportArguments common;
  std::optional<std::string> maps;
};

}  // namespace

void AddImportNuScenes(Command& import, Environment& environment) {
  const auto arguments = std::make_shared<NuScenesArguments>();
  arguments->common.origin = "nuScenes";
  Command command = import.Add(
      "nuscenes", "nuScenes (JSON tables and map expansion)",
      "One scene of 20 s is one recording. Its two keyframes a second become ten frames. Damaged "
      "scenes are\n"
      "reported and left out; the dataset is still written, and the exit status is 1.\n"
      "Example: maneuver import nuscenes nuscenes /data/nuscenes/v1.0-trainval\n"
      "Then:    maneuver dataset upload nuscenes nuscenes");
  AddImportOptions(command, arguments->common,
                   "Folders of tables, such as v1.0-trainval, or a folder with one of them");
  command.Option(
      "--maps", &arguments->maps,
      "Folder of the map expansion; none: import without maps [maps, beside the tables]");
  command.Run([arguments, &environment] {
    return RunImport(arguments->common,
                     {.name = "nuScenes scene",
                      .find = FindTables,
                      .read =
                          [arguments](const fs::path& tables, ImportSink& sink) {
                            return ReadScenes(tables, arguments->maps, sink);
                          }},
                     environment);
  });
}

}  // namespace maneuver::cli
