#include "client/cli/model_transfer.h"

#include <google/protobuf/struct.pb.h>

#include <memory>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/resource_names.h"
#include "client/cli/transfer_line.h"

namespace maneuver::cli {
namespace {

int Pull(const std::string& model, const std::string& folder, Environment& environment) {
  TransferLine line(environment);
  const auto version = environment.server_client().DownloadModelVersion(
      ModelResource(model), folder, line.callback(), environment.call_options());
  line.Clear();
  if (!version.ok()) return line.Fail(version.status());
  if (environment.json()) {
    google::protobuf::Struct written;
    (*written.mutable_fields())["modelVersion"].set_string_value(*version);
    (*written.mutable_fields())["folder"].set_string_value(folder);
    environment.PrintJson(written);
  } else {
    environment.out << folder << " is " << ShortName(*version) << "\n";
  }
  return kOk;
}

int Push(const std::string& folder, const std::string& model, Environment& environment) {
  const std::string parent = ModelResource(model);
  if (parent.find("/versions/") != std::string::npos || parent.find('@') != std::string::npos) {
    return environment.Refuse(absl::StrCat("name the model alone, such as ",
                                           model.substr(0, model.find_first_of("/@")),
                                           ": the server gives the version its number"));
  }
  TransferLine line(environment);
  const auto version = environment.server_client().UploadModelVersion(
      folder, parent, line.callback(), environment.call_options());
  line.Clear();
  if (!version.ok()) return line.Fail(version.status());
  if (environment.json()) {
    environment.PrintJson(*version);
    return kOk;
  }
  environment.out << ShortName(version->name()) << "\n";
  if (version->aliases().empty()) {
    environment.err << "it does not serve yet: maneuver model promote "
                    << ShortName(version->name()) << "\n";
  }
  return kOk;
}

}  // namespace

void AddModelTransfer(Command& group, Environment& environment) {
  const auto model = std::make_shared<std::string>();
  const auto folder = std::make_shared<std::string>();
  Command pull = group.Add("pull", "Download a version from the server into a folder",
                           "Creates the folder with files that match their SHA-256, or not at all. "
                           "To continue an interrupted transfer, run the same command again.\n"
                           "Example: maneuver model pull town/3 town-3\n"
                           "         maneuver --server other:8470 model push town-3 town");
  pull.Argument("MODEL", model.get(), "town (what serves), town/3 or town@candidate");
  pull.Argument("FOLDER", folder.get(), "Folder to make");
  pull.Run([=, &environment] { return Pull(*model, *folder, environment); });

  Command push = group.Add(
      "push", "Upload a version from a folder to the server",
      "The server checks it by SHA-256, loads it once, and registers it as the model's next "
      "version, which does not serve yet. A version that it already has is not registered again.\n"
      "Example: maneuver model push town-3 town");
  push.Argument("FOLDER", folder.get(), "Folder with model.json and weights.safetensors");
  push.Argument("MODEL", model.get(), "Model to add the version to, such as town");
  push.Run([=, &environment] { return Push(*folder, *model, environment); });
}

}  // namespace maneuver::cli
