// maneuver evaluate: measure a version of a model on a dataset.

#include <memory>
#include <ostream>

#include "client/cli/commands.h"
#include "client/cli/job_display.h"
#include "client/cli/resource_names.h"
#include "client/cli/settings_argument.h"

namespace maneuver::cli {
namespace {

struct Arguments {
  std::string model;
  std::string dataset;
  std::vector<std::string> assignments;
  bool detach = false;
};

int Evaluate(const Arguments& arguments, Environment& environment) {
  v1::EvaluateRequest request;
  request.set_model(ModelResource(arguments.model));
  request.set_dataset(DatasetResource(arguments.dataset));
  for (const std::string& assignment : arguments.assignments) {
    const absl::Status status = SetField(assignment, request.mutable_examples());
    if (!status.ok()) return environment.Refuse(std::string(status.message()));
  }
  const auto job = environment.server_client().Evaluate(request, environment.call_options());
  if (!job.ok()) return environment.Fail(job.status());
  if (arguments.detach) {
    if (environment.json()) {
      environment.PrintJson(*job);
    } else {
      environment.out << job->name() << "\n";
    }
    return kOk;
  }
  environment.err << job->name() << " measures " << request.model() << " on " << request.dataset()
                  << "; Ctrl-C stops watching\n";
  return WatchToEnd(job->name(), environment);
}

}  // namespace

void AddEvaluate(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<Arguments>();
  Command command = root.Add("evaluate", "Measure a model on a dataset",
                             "Example: maneuver evaluate town --dataset unseen\n"
                             "         maneuver evaluate town/2 --dataset unseen --set stride=1s");
  command.Argument("MODEL", &arguments->model, "town (what serves), town/2 or town@candidate");
  command.Argument("--dataset", &arguments->dataset, "Dataset to measure it on");
  command.Option("--set", &arguments->assignments, "FIELD=VALUE of ExampleSettings");
  command.Flag("--detach", &arguments->detach, "Start the job and return");
  command.Run([arguments, &environment] { return Evaluate(*arguments, environment); });
}

}  // namespace maneuver::cli
