#include "client/cli/model_export.h"

#include <google/protobuf/struct.pb.h>

#include <memory>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "client/cli/json_files.h"
#include "client/cli/text_format.h"
#include "model/artifact/model_folder.h"
#include "model/onnx/onnx_export.h"

namespace maneuver::cli {
namespace {

struct ExportArguments {
  std::string folder;
  std::string onnx;
  bool probabilities_only = false;
  int64_t scenes = 0;
};

int Export(const ExportArguments& arguments, Environment& environment) {
  const absl::StatusOr<artifact::StoredModel> model = artifact::ReadModelFolder(arguments.folder);
  if (absl::IsNotFound(model.status())) {
    return environment.Refuse(absl::StrCat(
        arguments.folder, " is not a model folder: ", std::string(model.status().message()),
        ". To export a version of a server, first run: maneuver model pull ", arguments.folder,
        " FOLDER"));
  }
  if (!model.ok()) return environment.FailAt(arguments.folder, model.status());
  const std::string file = onnx::ExportOnnx(*model, {.distributions = !arguments.probabilities_only,
                                                     .scenes = static_cast<int>(arguments.scenes)});
  const absl::Status status = WriteFile(arguments.onnx, file);
  if (!status.ok()) return environment.Fail(status);
  if (environment.json()) {
    google::protobuf::Struct written;
    (*written.mutable_fields())["file"].set_string_value(arguments.onnx);
    (*written.mutable_fields())["sizeBytes"].set_number_value(static_cast<double>(file.size()));
    environment.PrintJson(written);
  } else {
    environment.out << arguments.onnx << ": " << Bytes(static_cast<int64_t>(file.size())) << "\n";
  }
  return kOk;
}

}  // namespace

void AddModelExport(Command& group, Environment& environment) {
  const auto arguments = std::make_shared<ExportArguments>();
  Command command =
      group.Add("export", "Export a model folder's networks as an ONNX file",
                "The networks compute p(y|s) and the sigma trajectories of every action from a "
                "scene's inputs.\n"
                "Example: maneuver model export /var/lib/maneuver/models/town/2 --onnx town.onnx");
  command.Argument("MODEL_FOLDER", &arguments->folder,
                   "Folder with model.json and weights.safetensors");
  command.Argument("--onnx", &arguments->onnx, "File to write");
  command.Flag("--probabilities-only", &arguments->probabilities_only,
               "Leave out the distributions of actions");
  command.Option("--scenes", &arguments->scenes, 0, 10'000,
                 "Fix the number of scenes, which some engines need [0: any number]");
  command.Run([arguments, &environment] { return Export(*arguments, environment); });
}

}  // namespace maneuver::cli
