// maneuver import argoverse: sequences of Argoverse 1 Motion Forecasting as a dataset folder.

#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/dataset_import.h"
#include "client/cli/import_formats.h"
#include "model/data/argoverse/argoverse_reader.h"
#include "model/data/argoverse/vector_map.h"
#include "model/files/durable_file.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;

// Reads the maps once, then sequence after sequence.
class ArgoverseFiles {
 public:
  //   maps: the folder of the vector maps; "none": no map
  explicit ArgoverseFiles(std::string maps) : folder_(std::move(maps)) {}

  absl::Status Read(const fs::path& file, ImportSink& sink) {
    if (folder_ != "none" && !maps_) {
      const absl::Status status = ReadMaps(sink);
      if (!status.ok()) return status;
    }
    absl::StatusOr<std::string> bytes = files::ReadFile(file);
    if (!bytes.ok()) return bytes.status();
    const double size = static_cast<double>(bytes->size());
    return sink.Take({[csv = *std::move(bytes), name = file.stem().string(), maps = maps_] {
                        return data::ParseArgoverse(csv, name, maps.get());
                      },
                      file.filename(), size});
  }

 private:
  absl::Status ReadMaps(ImportSink& sink) {
    auto maps = std::make_shared<data::CityMaps>();
    std::error_code error;
    const auto entries = files::ListFolder(folder_);
    if (!entries.ok() && fs::is_directory(folder_, error)) return entries.status();
    for (const fs::path& entry : entries.value_or(std::vector<fs::path>())) {
      const std::string name = entry.filename();
      for (const char* city : {"PIT", "MIA"}) {
        if (!name.starts_with(absl::StrCat("pruned_argoverse_", city, "_")) ||
            !name.ends_with("_vector_map.xml")) {
          continue;
        }
        absl::StatusOr<data::VectorMap> map = data::ReadVectorMap(
            entry, [&sink](const absl::Status& damage) { return sink.Damaged(damage); });
        if (!map.ok()) return map.status();
        if (map->open_links > 0) {
          sink.Note(absl::StrCat(name, ": ", map->open_links,
                                 " links name lanes that the map lacks; left out"));
        }
        maps->insert_or_assign(city, data::CityMap(std::move(map->lanes)));
      }
    }
    if (maps->empty()) {
      return absl::NotFoundError(
          absl::StrCat("--maps: ", folder_,
                       " holds no pruned_argoverse_*_vector_map.xml; name the folder map_files of "
                       "the maps' archive, or none"));
    }
    maps_ = std::move(maps);
    return absl::OkStatus();
  }

  const std::string folder_;
  std::shared_ptr<const data::CityMaps> maps_;
};

struct ArgoverseArguments {
  ImportArguments common;
  std::string maps;
};

}  // namespace

void AddImportArgoverse(Command& import, Environment& environment) {
  const auto arguments = std::make_shared<ArgoverseArguments>();
  arguments->common.origin = "Argoverse 1 Motion Forecasting";
  Command command = import.Add(
      "argoverse", "Argoverse 1 Motion Forecasting (CSV sequences, vector maps in XML)",
      "One file is one recording of 5 s. In folders, files ending in .csv are read. Unusable files "
      "are\n"
      "reported and left out; the dataset is still written, and the exit status is 1.\n"
      "Example: maneuver import argoverse argoverse train/data --maps map_files\n"
      "Then:    maneuver dataset upload argoverse argoverse\n"
      "         maneuver train pittsburgh --dataset argoverse --horizon 3s");
  AddImportOptions(command, arguments->common, "CSV files, or folders of them");
  command.Argument("--maps", &arguments->maps,
                   "Folder of the vector maps (map_files); none: import without a map");
  command.Run([arguments, &environment] {
    const auto files = std::make_shared<ArgoverseFiles>(arguments->maps);
    return RunImport(arguments->common,
                     {.name = "Argoverse sequence",
                      .find = [](const auto& inputs) { return FindFiles(inputs, ".csv"); },
                      .read = [files](const fs::path& file,
                                      ImportSink& sink) { return files->Read(file, sink); }},
                     environment);
  });
}

}  // namespace maneuver::cli
