// maneuver dataset: upload, register, list, show, annotate, index, delete.

#include <google/protobuf/struct.pb.h>

#include <memory>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/dataset_annotate.h"
#include "client/cli/dataset_show.h"
#include "client/cli/resource_names.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/cli/transfer_line.h"
#include "model/data/recording_index.h"

namespace maneuver::cli {
namespace {

int Upload(const std::string& folder, const std::string& name, Environment& environment) {
  TransferLine line(environment);
  const absl::StatusOr<v1::Dataset> dataset = environment.server_client().UploadDataset(
      folder, DatasetResource(name), line.callback(), environment.call_options());
  line.Clear();
  if (!dataset.ok()) {
    return line.Fail(dataset.status(), "the server keeps what has arrived for a while");
  }
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << dataset->name() << ": " << HowMany(dataset->recordings(), "recording")
                    << ", " << Bytes(SizeBytes(*dataset)) << "\n";
  }
  return kOk;
}

int Register(const std::string& name, const std::string& folder, Environment& environment) {
  v1::RegisterDatasetRequest request;
  request.set_name(DatasetResource(name));
  request.set_folder(folder);
  const auto dataset =
      environment.server_client().RegisterDataset(request, environment.call_options());
  if (!dataset.ok()) return environment.FailCall(dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << dataset->name() << ": " << HowMany(dataset->recordings(), "recording")
                    << ", " << Bytes(SizeBytes(*dataset)) << ", in place in " << folder << "\n";
  }
  return kOk;
}

int ListDatasets(Environment& environment) {
  v1::ListDatasetsRequest request;
  request.set_page_size(1'000);
  v1::ListDatasetsResponse all;
  do {
    auto page = environment.server_client().ListDatasets(request, environment.call_options());
    if (!page.ok()) return environment.FailCall(page.status());
    request.set_page_token(page->next_page_token());
    page->clear_next_page_token();
    all.MergeFrom(*page);
  } while (!request.page_token().empty());
  if (environment.json()) {
    environment.PrintJson(all);
    return kOk;
  }
  Table table({{"DATASET"},
               {"RECORDINGS", Align::kRight},
               {"DRIVING", Align::kRight},
               {"SIZE", Align::kRight},
               {"CREATED"},
               {"ORIGIN"}});
  for (const v1::Dataset& dataset : all.datasets()) {
    if (dataset.format_version() == 0) {
      const std::string name = ShortName(dataset.name());
      table.Add({name, "-", "-", "-", "-", "unreadable"});
      environment.err << dataset.name() << " cannot be read; maneuver dataset show " << name
                      << " says why\n";
      continue;
    }
    table.Add({ShortName(dataset.name()), absl::StrCat(dataset.recordings()),
               Spell(dataset.duration_seconds()), Bytes(SizeBytes(dataset)),
               Moment(dataset.create_time()), dataset.origin()});
  }
  if (table.empty()) {
    environment.err << "no datasets yet; add one with maneuver dataset upload FOLDER NAME\n";
  } else {
    environment.out << table.Text(environment.color);
  }
  return kOk;
}

int IndexDataset(const std::string& folder, Environment& environment) {
  const auto index = data::RecordingIndex::Open(
      folder, [&](const std::string& what) { environment.err << what << "\n"; });
  if (!index.ok()) return environment.Fail(index.status());
  const auto recordings = static_cast<int64_t>(index->entries().size());
  if (environment.json()) {
    google::protobuf::Struct indexed;
    (*indexed.mutable_fields())["folder"].set_string_value(folder);
    (*indexed.mutable_fields())["recordings"].set_number_value(static_cast<double>(recordings));
    environment.PrintJson(indexed);
  } else {
    environment.out << folder << ": " << HowMany(recordings, "recording") << " indexed\n";
  }
  return kOk;
}

int DeleteDataset(const std::string& name, Environment& environment) {
  v1::DeleteDatasetRequest request;
  request.set_name(DatasetResource(name));
  const absl::Status status =
      environment.server_client().DeleteDataset(request, environment.call_options());
  if (!status.ok()) return environment.FailCall(status);
  environment.err << request.name() << " is deleted\n";
  return kOk;
}

}  // namespace

void AddDataset(Command& root, Environment& environment) {
  Command group = root.Add("dataset", "Datasets on the server");
  const auto name = std::make_shared<std::string>();
  const auto folder = std::make_shared<std::string>();

  Command upload = group.Add("upload", "Send a dataset folder to the server",
                             "The dataset appears whole or not at all, and never changes. To\n"
                             "continue an interrupted upload, run the same command again.\n"
                             "Example: maneuver dataset upload town town");
  upload.Argument("FOLDER", folder.get(), "Folder with dataset.json");
  upload.Argument("NAME", name.get(), "Its name on the server: a-z, 0-9 and -");
  upload.Run([=, &environment] { return Upload(*folder, *name, environment); });

  Command in_place =
      group.Add("register", "Register a folder on the server's disk as a dataset, without a copy",
                "The server reads and verifies the folder; nothing is sent or copied. The\n"
                "folder must lie where the server's --dataset-folders allows it. Deleting\n"
                "the dataset leaves the folder as it is. For administrators.\n"
                "Example: maneuver dataset register waymo /data/waymo/training");
  in_place.Argument("NAME", name.get(), "Its name on the server: a-z, 0-9 and -");
  in_place.Argument("FOLDER", folder.get(), "Absolute path of the folder, on the server");
  in_place.Run([=, &environment] { return Register(*name, *folder, environment); });

  Command list = group.Add("list", "All datasets", "Example: maneuver dataset list --output json");
  list.Run([&environment] { return ListDatasets(environment); });

  const auto shown = std::make_shared<ShowDatasetArguments>();
  Command show = group.Add("show", "Summarise a dataset and draw its scenes",
                           "Example: maneuver dataset show town --plot town.png\n"
                           "Example: maneuver dataset show town --set examples.stride=1s");
  show.Argument("NAME", &shown->source,
                "Its name, or the path of a folder with dataset.json, such as ./town");
  show.Option("--set", &shown->changes,
              "FIELD=VALUE of the examples to count: examples.stride=1s, "
              "examples.standing_distance=2, ...");
  show.Picture("--plot", &shown->plot, "PNG file to draw some of its scenes into");
  show.Option("--scenes", &shown->scenes, 1, 36, "Number of scenes to draw");
  show.Run([=, &environment] { return ShowDataset(*shown, environment); });

  const auto labelled = std::make_shared<AnnotateArguments>();
  Command annotate =
      group.Add("annotate", "Add labels of actions to a dataset folder",
                "Writes a new folder with the same shards and one more with the labels.\n"
                "LABELS is a CSV file: recording,target,time,action\n"
                "Example: maneuver dataset annotate town labels.csv town-labelled");
  annotate.Argument("FOLDER", &labelled->folder, "Folder with dataset.json");
  annotate.Argument("LABELS", &labelled->labels, "CSV file");
  annotate.Argument("OUTPUT", &labelled->output, "The new folder");
  annotate.Option("--action", &labelled->actions,
                  "An action that labels may name; may be repeated [any name]");
  annotate.Run([=, &environment] { return AnnotateDataset(*labelled, environment); });

  Command index =
      group.Add("index", "Index a dataset folder, so that single recordings can be read",
                "Writes a small file beside each shard that has none. A damaged or\n"
                "stale index is named and rebuilt. A folder that this version\n"
                "wrote, and a dataset on a server, has its indexes already.\n"
                "Example: maneuver dataset index town");
  index.Argument("FOLDER", folder.get(), "Folder with dataset.json");
  index.Run([=, &environment] { return IndexDataset(*folder, environment); });

  Command remove = group.Add("delete", "Remove a dataset",
                             "Refused while a job needs it.\n"
                             "Example: maneuver dataset delete town");
  remove.Argument("NAME", name.get(), "Its name");
  remove.Run([=, &environment] { return DeleteDataset(*name, environment); });
}

}  // namespace maneuver::cli
