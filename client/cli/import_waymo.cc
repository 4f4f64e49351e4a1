// maneuver import waymo: Waymo Open Motion TFRecords as a dataset folder.

#include <cstdint>
#include <fstream>
#include <memory>

#include "absl/strings/str_cat.h"
#include "client/cli/dataset_import.h"
#include "client/cli/import_formats.h"
#include "model/data/tfrecord.h"
#include "model/data/waymo/waymo_reader.h"

namespace maneuver::cli {
namespace {

// Scenarios have a megabyte or a few. Longer records would only be parsed to be refused, and some
// kilobytes of gzip can become as long as they like.
constexpr uint64_t kLongestScenario = uint64_t{64} << 20;

// What else a file may be that has no TFRecord at its start.
absl::Status NoRecords(const std::filesystem::path& file, const absl::Status& damage) {
  char first = '\0';
  std::ifstream(file, std::ios::binary) >> first;
  if (first != '<') return damage;
  return absl::InvalidArgumentError(
      absl::StrCat(file.string(),
                   " is XML, not a file of TFRecords; import CommonRoad scenarios with maneuver "
                   "import commonroad"));
}

absl::Status ReadRecords(const std::filesystem::path& file, ImportSink& sink) {
  auto reader = data::TfRecordReader::Open(file, {.max_record_bytes = kLongestScenario});
  if (!reader.ok()) return reader.status();
  while (true) {
    std::string bytes;
    absl::Status status = (*reader)->Next(&bytes);
    if (absl::IsOutOfRange(status)) return absl::OkStatus();
    if (!status.ok()) {
      const bool at_start = (*reader)->offset() == 0 && !(*reader)->can_continue();
      if (absl::IsDataLoss(status) && at_start) status = NoRecords(file, status);
      if (!absl::IsDataLoss(status)) return status;
      status = sink.Damaged(status);
      if (!status.ok()) return status;
      if (!(*reader)->can_continue()) return absl::OkStatus();
      continue;
    }
    const uint64_t offset = (*reader)->offset();
    status = sink.Take({[bytes = std::move(bytes)] { return data::ParseWaymoScenario(bytes); },
                        absl::StrCat(file.filename().string(), " at offset ", offset),
                        static_cast<double>(offset)});
    if (!status.ok()) return status;
  }
}

}  // namespace

void AddImportWaymo(Command& import, Environment& environment) {
  const auto arguments = std::make_shared<ImportArguments>();
  arguments->origin = "Waymo Open Motion";
  Command command =
      import.Add("waymo", "Waymo Open Motion scenarios (TFRecord, also gzipped)",
                 "Recordings that fail validation are reported and left out; the dataset is still "
                 "written, and\n"
                 "the exit status is 1.\n"
                 "Example: maneuver import waymo waymo-training training/ --on-damage skip\n"
                 "Then:    maneuver dataset upload waymo-training waymo-training");
  AddImportOptions(command, *arguments, "TFRecord files, or folders of them");
  command.Run([arguments, &environment] {
    return RunImport(*arguments,
                     {.name = "Waymo scenario",
                      .find = [](const auto& inputs) { return FindFiles(inputs, ""); },
                      .read = ReadRecords},
                     environment);
  });
}

}  // namespace maneuver::cli
