// maneuver tags: list, show, pull, delete the tags that jobs of the server made.

#include <google/protobuf/struct.pb.h>

#include <memory>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/commands.h"
#include "client/cli/job_display.h"
#include "client/cli/resource_names.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/cli/transfer_line.h"

namespace maneuver::cli {
namespace {

std::string Shards(const v1::Tags& tags) {
  return absl::StrCat(tags.shards(), " of ", tags.all_shards());
}

int ListTags(Environment& environment) {
  v1::ListTagsRequest request;
  request.set_page_size(1'000);
  v1::ListTagsResponse all;
  do {
    auto page = environment.server_client().ListTags(request, environment.call_options());
    if (!page.ok()) return environment.FailCall(page.status());
    request.set_page_token(page->next_page_token());
    page->clear_next_page_token();
    all.MergeFrom(*page);
  } while (!request.page_token().empty());
  if (environment.json()) {
    environment.PrintJson(all);
    return kOk;
  }
  Table table({{"TAGS"},
               {"MODEL"},
               {"DATASETS"},
               {"SHARDS", Align::kRight},
               {"WINDOWS", Align::kRight},
               {"SIZE", Align::kRight},
               {"CREATED"}});
  for (const v1::Tags& tags : all.tags()) {
    table.Add({ShortName(tags.name()), ShortName(tags.model_version()),
               absl::StrJoin(tags.datasets(), " "), Shards(tags), absl::StrCat(tags.window_count()),
               Bytes(tags.size_bytes()), Moment(tags.create_time())});
  }
  if (table.empty()) {
    environment.err << "no tags yet; make some with maneuver tag DATASET --model MODEL --on-server "
                       "NAME\n";
  } else {
    environment.out << table.Text(environment.color);
  }
  return kOk;
}

int ShowTags(const std::string& name, Environment& environment) {
  v1::GetTagsRequest request;
  request.set_name(TagsResource(name));
  const auto tags = environment.server_client().GetTags(request, environment.call_options());
  if (!tags.ok()) return environment.FailCall(tags.status());
  if (environment.json()) {
    environment.PrintJson(*tags);
    return kOk;
  }
  Table table({{"TAGS"}, {ShortName(tags->name())}});
  table.Add({"model", ShortName(tags->model_version())});
  table.Add({"datasets", absl::StrJoin(tags->datasets(), " ")});
  table.Add({"created", Moment(tags->create_time())});
  table.Add({"shards", Shards(*tags)});
  table.Add({"rows", absl::StrCat(tags->rows(), tags->windows() ? ", one for each window" : "")});
  table.Add({"windows", absl::StrCat(tags->window_count())});
  table.Add({"stride", tags->has_stride() ? ExactSeconds(ToSeconds(tags->stride()))
                                          : std::string("as in the model's training")});
  table.Add({"size", Bytes(tags->size_bytes())});
  environment.out << table.Text(environment.color);
  return kOk;
}

int PullTags(const std::string& name, const std::string& folder, Environment& environment) {
  TransferLine line(environment);
  const auto pulled = environment.server_client().DownloadTags(
      TagsResource(name), folder, line.callback(), environment.call_options());
  line.Clear();
  if (!pulled.ok()) return line.Fail(pulled.status());
  if (environment.json()) {
    google::protobuf::Struct written;
    (*written.mutable_fields())["tags"].set_string_value(*pulled);
    (*written.mutable_fields())["folder"].set_string_value(folder);
    environment.PrintJson(written);
  } else {
    environment.out << folder << " has " << *pulled << "\n";
  }
  return kOk;
}

int DeleteTags(const std::string& name, Environment& environment) {
  v1::DeleteTagsRequest request;
  request.set_name(TagsResource(name));
  const absl::Status status =
      environment.server_client().DeleteTags(request, environment.call_options());
  if (!status.ok()) return environment.FailCall(status);
  environment.err << request.name() << " are deleted\n";
  return kOk;
}

}  // namespace

void AddTags(Command& root, Environment& environment) {
  Command group = root.Add("tags", "Tags on the server, which maneuver tag --on-server makes");
  const auto name = std::make_shared<std::string>();
  const auto folder = std::make_shared<std::string>();

  Command list = group.Add("list", "All tags", "Example: maneuver tags list --output json");
  list.Run([&environment] { return ListTags(environment); });

  Command show =
      group.Add("show", "What tags are of, and how much", "Example: maneuver tags show june");
  show.Argument("NAME", name.get(), "Their name");
  show.Run([=, &environment] { return ShowTags(*name, environment); });

  Command pull =
      group.Add("pull", "Download tags into a folder, for maneuver find",
                "Creates the folder with files that match their SHA-256, or not at all. "
                "Only complete shards are sent. To continue an interrupted transfer, run "
                "the same command again.\n"
                "Example: maneuver tags pull june tags-june");
  pull.Argument("NAME", name.get(), "Their name");
  pull.Argument("FOLDER", folder.get(), "Folder to make");
  pull.Run([=, &environment] { return PullTags(*name, *folder, environment); });

  Command remove = group.Add("delete", "Remove tags",
                             "Refused while a job writes them.\n"
                             "Example: maneuver tags delete june");
  remove.Argument("NAME", name.get(), "Their name");
  remove.Run([=, &environment] { return DeleteTags(*name, environment); });
}

}  // namespace maneuver::cli
