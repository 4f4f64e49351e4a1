// maneuver dataset: upload, list, show, delete.

#include <chrono>
#include <memory>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/progress_line.h"
#include "client/cli/resource_names.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"

namespace maneuver::cli {
namespace {

int64_t SizeBytes(const v1::Dataset& dataset) {
  int64_t bytes = 0;
  for (const v1::Shard& shard : dataset.shards()) bytes += shard.size_bytes();
  return bytes;
}

int Upload(const std::string& folder, const std::string& name, Environment& environment) {
  ProgressLine progress(environment.err, environment.interactive);
  const auto start = std::chrono::steady_clock::now();
  const absl::StatusOr<v1::Dataset> dataset = environment.server_client().UploadDataset(
      folder, DatasetResource(name),
      [&](int64_t sent, int64_t total) {
        const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start;
        const double rate = static_cast<double>(sent) / std::max(passed.count(), 1e-3);
        progress.Show(static_cast<double>(sent) / static_cast<double>(std::max<int64_t>(total, 1)),
                      sent == total ? std::string("the server checks it")
                                    : absl::StrCat(Bytes(sent), " of ", Bytes(total), ", ",
                                                   Bytes(static_cast<int64_t>(rate)), " a second"));
      },
      environment.call_options());
  progress.Clear();
  if (!dataset.ok()) return environment.Fail(dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << dataset->name() << ": " << dataset->recordings() << " recordings, "
                    << Bytes(SizeBytes(*dataset)) << "\n";
  }
  return kOk;
}

int ListDatasets(Environment& environment) {
  v1::ListDatasetsRequest request;
  request.set_page_size(1'000);
  v1::ListDatasetsResponse all;
  do {
    auto page = environment.server_client().ListDatasets(request, environment.call_options());
    if (!page.ok()) return environment.Fail(page.status());
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

void PrintCounts(const std::string& title,
                 const google::protobuf::Map<std::string, int64_t>& counts,
                 Environment& environment) {
  if (counts.empty()) return;
  Table table({{title}, {"COUNT", Align::kRight}});
  for (const auto& [name, count] : std::map<std::string, int64_t>(counts.begin(), counts.end())) {
    table.Add({name, absl::StrCat(count)});
  }
  environment.out << "\n" << table.Text(environment.color);
}

int ShowDataset(const std::string& name, Environment& environment) {
  v1::DescribeDatasetRequest request;
  request.set_name(DatasetResource(name));
  const auto summary =
      environment.server_client().DescribeDataset(request, environment.call_options());
  if (!summary.ok()) return environment.Fail(summary.status());
  if (environment.json()) {
    environment.PrintJson(*summary);
    return kOk;
  }
  const v1::Dataset& dataset = summary->dataset();
  Table table({{"DATASET"}, {ShortName(dataset.name())}});
  table.Add({"origin", dataset.origin()});
  table.Add({"created", Moment(dataset.create_time())});
  table.Add({"recordings", absl::StrCat(dataset.recordings())});
  table.Add({"driving", Spell(dataset.duration_seconds())});
  table.Add(
      {"size", absl::StrCat(Bytes(SizeBytes(dataset)), " in ", dataset.shards_size(), " files")});
  table.Add({"examples", absl::StrCat(summary->examples())});
  table.Add({"standing", absl::StrCat(summary->standing_examples())});
  environment.out << table.Text(environment.color);
  PrintCounts("AGENTS", summary->agents_by_type(), environment);
  PrintCounts("MAP", summary->map_features_by_type(), environment);
  PrintCounts("MANEUVERS", summary->maneuvers(), environment);
  return kOk;
}

int DeleteDataset(const std::string& name, Environment& environment) {
  v1::DeleteDatasetRequest request;
  request.set_name(DatasetResource(name));
  const absl::Status status =
      environment.server_client().DeleteDataset(request, environment.call_options());
  if (!status.ok()) return environment.Fail(status);
  environment.err << request.name() << " is deleted\n";
  return kOk;
}

}  // namespace

void AddDataset(Command& root, Environment& environment) {
  Command group = root.Add("dataset", "Datasets on the server");
  const auto name = std::make_shared<std::string>();
  const auto folder = std::make_shared<std::string>();

  Command upload = group.Add("upload", "Send a dataset folder to the server",
                             "The dataset appears whole or not at all, and never changes.\n"
                             "Example: maneuver dataset upload town town");
  upload.Argument("FOLDER", folder.get(), "Folder with dataset.json");
  upload.Argument("NAME", name.get(), "Its name on the server: a-z, 0-9 and -");
  upload.Run([=, &environment] { return Upload(*folder, *name, environment); });

  Command list = group.Add("list", "All datasets", "Example: maneuver dataset list --output json");
  list.Run([&environment] { return ListDatasets(environment); });

  Command show =
      group.Add("show", "What is in a dataset, counted", "Example: maneuver dataset show town");
  show.Argument("NAME", name.get(), "Its name");
  show.Run([=, &environment] { return ShowDataset(*name, environment); });

  Command remove = group.Add("delete", "Remove a dataset",
                             "Refused while a job needs it.\n"
                             "Example: maneuver dataset delete town");
  remove.Argument("NAME", name.get(), "Its name");
  remove.Run([=, &environment] { return DeleteDataset(*name, environment); });
}

}  // namespace maneuver::cli
