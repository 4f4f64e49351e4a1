// maneuver recalibrate: fit the widths of a version again.

#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/job_display.h"
#include "client/cli/promotion_options.h"
#include "client/cli/resource_names.h"
#include "client/cli/settings_argument.h"

namespace maneuver::cli {
namespace {

struct RecalibrateArguments {
  std::string model;
  std::vector<std::string> datasets;
  std::vector<std::string> assignments;
  PromotionArguments promotion;
  std::optional<int64_t> priority;
  bool detach = false;
  bool validate_only = false;
};

int Recalibrate(const RecalibrateArguments& arguments, Environment& environment) {
  v1::RecalibrateRequest request;
  request.set_model(ModelResource(arguments.model));
  for (const std::string& name : arguments.datasets) request.add_datasets(DatasetResource(name));
  for (const std::string& assignment : arguments.assignments) {
    const absl::Status status = SetExampleField(assignment, request.mutable_examples());
    if (!status.ok()) return environment.Refuse(std::string(status.message()));
  }
  v1::Promotion promotion = v1::PROMOTION_UNSPECIFIED;
  std::optional<v1::PromotionCriteria> criteria;
  const absl::Status read = ReadPromotion(arguments.promotion, &promotion, &criteria);
  if (!read.ok()) return environment.Refuse(std::string(read.message()));
  request.set_promotion(promotion);
  if (criteria) *request.mutable_promotion_criteria() = *std::move(criteria);
  request.set_priority(static_cast<int32_t>(arguments.priority.value_or(0)));
  request.set_validate_only(arguments.validate_only);
  const auto job = environment.server_client().Recalibrate(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (arguments.validate_only) {
    PrintValid(*job, environment);
    return kOk;
  }
  return ShowStarted(*job, absl::StrCat("recalibrates ", request.model()), arguments.detach,
                     environment);
}

}  // namespace

void AddRecalibrate(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<RecalibrateArguments>();
  Command command = root.Add(
      "recalibrate", "Fit the widths of a version to what happened since",
      "Starts a job on the server that fits the temperature of p(y|s) and the width of the "
      "envelopes to recordings that the version did not learn from. Its networks and actions stay "
      "the same. The result is a new version of the model, measured on recordings that were not "
      "fitted to.\n"
      "Example: maneuver recalibrate town --dataset yesterday\n"
      "         maneuver recalibrate town/3 --dataset yesterday --promote if-no-worse \\\n"
      "             --promote-dataset unseen --promote-metric nll");
  command.Argument("MODEL", &arguments->model,
                   "town (the version that serves), town/2 or town@candidate");
  command.Option("--dataset", &arguments->datasets, "Dataset to fit to; may be repeated", true);
  command.Option("--set", &arguments->assignments,
                 "FIELD=VALUE of the examples to fit to: examples.stride=1s, "
                 "examples.validation_share=0.3, ...");
  AddPromotionOptions(command, &arguments->promotion);
  command.Option("--priority", &arguments->priority, -100, 100,
                 "Jobs with a higher priority run first [0]");
  command.Flag("--detach", &arguments->detach, "Start the job and return");
  command.Flag("--validate-only", &arguments->validate_only,
               "Check the request, say how much memory the job will take, start nothing");
  command.Run([arguments, &environment] { return Recalibrate(*arguments, environment); });
}

}  // namespace maneuver::cli
