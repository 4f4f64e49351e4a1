// maneuver import commonroad: CommonRoad XML files as a dataset folder.

#include <memory>

#include "client/cli/dataset_import.h"
#include "client/cli/import_formats.h"
#include "model/data/commonroad/commonroad_reader.h"
#include "model/files/durable_file.h"

namespace maneuver::cli {
namespace {

absl::Status ReadWhole(const std::filesystem::path& file, ImportSink& sink) {
  absl::StatusOr<std::string> bytes = files::ReadFile(file);
  if (!bytes.ok()) return bytes.status();
  const double size = static_cast<double>(bytes->size());
  return sink.Take(
      {[xml = *std::move(bytes)] { return data::ParseCommonRoad(xml); }, file.filename(), size});
}

}  // namespace

void AddImportCommonRoad(Command& import, Environment& environment) {
  const auto arguments = std::make_shared<ImportArguments>();
  arguments->origin = "CommonRoad";
  Command command = import.Add(
      "commonroad", "CommonRoad scenarios (XML of versions 2018b and 2020a)",
      "One file is one recording. In folders, files ending in .xml are read. Unusable files are "
      "reported\n"
      "and left out; the dataset is still written, and the exit status is 1.\n"
      "Example: maneuver import commonroad ngsim scenarios/ --origin \"NGSIM, CommonRoad\"\n"
      "Then:    maneuver dataset upload ngsim ngsim");
  AddImportOptions(command, *arguments, "XML files, or folders of them");
  command.Run([arguments, &environment] {
    return RunImport(*arguments,
                     {.name = "CommonRoad scenario",
                      .find = [](const auto& inputs) { return FindFiles(inputs, ".xml"); },
                      .read = ReadWhole},
                     environment);
  });
}

}  // namespace maneuver::cli
