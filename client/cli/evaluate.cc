// maneuver evaluate: measure a version of a model on a dataset.

#include <memory>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/figures.h"
#include "client/cli/job_display.h"
#include "client/cli/report.h"
#include "client/cli/resource_names.h"
#include "client/cli/settings_argument.h"

namespace maneuver::cli {
namespace {

struct EvaluateArguments {
  std::string model;
  std::string dataset;
  std::vector<std::string> assignments;
  std::optional<std::string> figures;
  ReportFiles report;
  std::optional<int64_t> priority;
  bool detach = false;
  bool validate_only = false;
};

void SayHowToDraw(const v1::Job& job, const EvaluateArguments& arguments,
                  Environment& environment) {
  environment.err << "when it has ended, draw the figures with: maneuver job show "
                  << ShortName(job.name()) << " --figures " << *arguments.figures << "\n";
}

int Evaluate(const EvaluateArguments& arguments, Environment& environment) {
  v1::EvaluateRequest request;
  request.set_model(ModelResource(arguments.model));
  request.set_dataset(DatasetResource(arguments.dataset));
  for (const std::string& assignment : arguments.assignments) {
    const absl::Status status = SetExampleField(assignment, request.mutable_examples());
    if (!status.ok()) return environment.Refuse(std::string(status.message()));
  }
  if (arguments.figures) request.set_sampled_examples(kSampledExamples);
  // Before anything is computed. A detached job is drawn later, wherever `job show` is told to.
  if (!arguments.validate_only && !arguments.detach) {
    absl::Status prepared = PrepareReport(arguments.report);
    if (prepared.ok() && arguments.figures) prepared = PrepareFigureFolder(*arguments.figures);
    if (!prepared.ok()) return environment.Refuse(std::string(prepared.message()));
  }
  request.set_priority(static_cast<int32_t>(arguments.priority.value_or(0)));
  request.set_validate_only(arguments.validate_only);
  const auto job = environment.server_client().Evaluate(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (arguments.validate_only) {
    PrintValid(*job, environment);
    return kOk;
  }
  const int watched =
      ShowStarted(*job, absl::StrCat("measures ", request.model(), " on ", request.dataset()),
                  arguments.detach, environment);
  if (watched == kFailed) return watched;
  const int reported = arguments.report.any()
                           ? WriteReportOfWatched(job->name(), arguments.report, environment)
                           : kOk;
  if (watched == kInterrupted || arguments.detach) {
    if (arguments.figures) SayHowToDraw(*job, arguments, environment);
    return watched;
  }
  if (reported != kOk || !arguments.figures) return reported;
  v1::GetJobRequest ended;
  ended.set_name(job->name());
  const auto evaluated = environment.server_client().GetJob(ended, environment.call_options());
  if (!evaluated.ok()) return environment.FailCall(evaluated.status());
  return DrawFigures(evaluated->evaluation(), *arguments.figures, environment);
}

}  // namespace

void AddEvaluate(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<EvaluateArguments>();
  Command command =
      root.Add("evaluate", "Measure a model on a dataset",
               "Example: maneuver evaluate town --dataset unseen\n"
               "         maneuver evaluate town/2 --dataset unseen --set examples.stride=1s\n"
               "         maneuver evaluate town --dataset unseen --report report.html\n"
               "         maneuver evaluate town --dataset unseen --figures figures");
  command.Argument("MODEL", &arguments->model,
                   "town (the version that serves), town/2 or town@candidate");
  command.Argument("--dataset", &arguments->dataset, "Dataset to measure it on");
  command.Option("--set", &arguments->assignments,
                 "FIELD=VALUE of the examples to measure on: examples.stride=1s, "
                 "examples.max_examples=1000, ...");
  command.Option("--report", &arguments->report.page,
                 "HTML file to write: a page for a browser that shows the results and the "
                 "version");
  command.Option(
      "--figures", &arguments->figures,
      "Folder to draw into: actions, their means over trajectories, scenes, reliability");
  command.Option("--priority", &arguments->priority, -100, 100,
                 "Jobs with a higher priority run first [0]");
  command.Flag("--detach", &arguments->detach, "Start the job and return");
  command.Flag("--validate-only", &arguments->validate_only,
               "Check the request, say how much memory the job will take, start nothing");
  command.Exclude("--report", "--detach");  // maneuver job report writes it later
  command.Run([arguments, &environment] { return Evaluate(*arguments, environment); });
}

}  // namespace maneuver::cli
