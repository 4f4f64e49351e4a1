#include "client/cli/report.h"

#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <memory>
#include <ostream>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/figures.h"
#include "client/cli/json_files.h"
#include "client/cli/report_collection.h"
#include "client/cli/resource_names.h"
#include "client/cli/text_format.h"
#include "client/report/report_page.h"
#include "client/report/tensorboard.h"

namespace maneuver::cli {
namespace {

constexpr char kPage[] = "report.html";

// Whether a file can be made or replaced.
absl::Status CheckFile(const std::string& path) {
  const std::filesystem::path parent = std::filesystem::path(path).parent_path();
  const std::string folder = parent.empty() ? "." : parent.string();
  std::error_code ignored;
  int error = 0;
  if (std::filesystem::is_directory(path, ignored)) {
    error = EISDIR;
  } else if (std::filesystem::exists(path, ignored)) {
    if (access(path.c_str(), W_OK) != 0) error = errno;
  } else if (access(folder.c_str(), W_OK | X_OK) != 0) {
    error = errno;
  }
  if (error == 0) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("cannot write ", path, ": ", std::generic_category().message(error)));
}

// Writes the curves where they are asked for.
absl::Status WriteCurves(const std::vector<report::LearningPhase>& learning,
                         const ReportFiles& files, Environment& environment) {
  if (files.curves) {
    const absl::Status status = WriteFile(*files.curves, report::CurvesCsv(learning));
    if (!status.ok()) return status;
    environment.err << "the curves are " << *files.curves << "\n";
  }
  if (files.tensorboard) {
    const absl::Status status = report::WriteTensorBoard(learning, *files.tensorboard);
    if (!status.ok()) return status;
    environment.err << "the curves are in " << *files.tensorboard << "; tensorboard --logdir "
                    << *files.tensorboard << " draws them\n";
  }
  return absl::OkStatus();
}

int Write(const report::ReportData& data, const ReportFiles& files, Environment& environment) {
  if (data.learning.empty() && (files.curves || files.tensorboard)) {
    return environment.Fail(absl::FailedPreconditionError(absl::StrCat(
        "there are no learning curves of ", data.title,
        ": no epoch has ended, or the server does not know the job that trained it any more")));
  }
  absl::Status status = WriteCurves(data.learning, files, environment);
  if (!status.ok()) return environment.Fail(status);
  if (!files.page) return kOk;
  const std::string page = report::ReportPage(data);
  status = WriteFile(*files.page, page);
  if (!status.ok()) return environment.Fail(status);
  environment.err << "the report is " << *files.page << " ("
                  << Bytes(static_cast<int64_t>(page.size())) << ")\n";
  return kOk;
}

// Curves alone need nothing but the job that trained.
int WriteCurvesOf(const v1::Job& job, const ReportFiles& files, Environment& environment) {
  report::ReportData data;
  data.title = job.name();
  auto learning = LearningOf(job, environment);
  if (!learning.ok()) return environment.FailCall(learning.status());
  data.learning = *std::move(learning);
  return Write(data, files, environment);
}

int WriteModelReport(const std::string& model, const std::optional<std::string>& dataset,
                     const ReportFiles& files, Environment& environment) {
  std::optional<std::string> resource;
  if (dataset) resource = DatasetResource(*dataset);
  const auto data = CollectVersion(ModelResource(model), resource, environment);
  if (!data.ok()) return environment.FailCall(data.status());
  return Write(*data, files, environment);
}

// What `job report` and `model report` take: a page unless curves alone are asked for.
struct ReportArguments {
  std::string name;
  std::optional<std::string> dataset;
  ReportFiles files;
};

ReportFiles FilesOf(const ReportArguments& arguments) {
  ReportFiles files = arguments.files;
  if (!files.any()) files.page = kPage;
  return files;
}

void AddPageOption(Command& command, ReportFiles* files) {
  command.Option(
      "-o,--out", &files->page,
      absl::StrCat("HTML file to write [", kPage, "; none with --curves or --tensorboard]"));
  AddCurveOptions(command, files);
}

}  // namespace

void AddCurveOptions(Command& command, ReportFiles* files) {
  command.Option("--curves", &files->curves, "CSV file to write the learning curves into");
  command.Option("--tensorboard", &files->tensorboard,
                 "Folder to write the learning curves into, as TensorBoard's event files");
}

absl::Status PrepareReport(const ReportFiles& files) {
  for (const std::optional<std::string>& file : {files.page, files.curves}) {
    const absl::Status status = file ? CheckFile(*file) : absl::OkStatus();
    if (!status.ok()) return status;
  }
  return files.tensorboard ? PrepareFigureFolder(*files.tensorboard) : absl::OkStatus();
}

int WriteJobReport(const std::string& job, const ReportFiles& files, Environment& environment) {
  const absl::Status prepared = PrepareReport(files);
  if (!prepared.ok()) return environment.Refuse(std::string(prepared.message()));
  v1::GetJobRequest request;
  request.set_name(job);
  const auto found = environment.server_client().GetJob(request, environment.call_options());
  if (!found.ok()) return environment.FailCall(found.status());
  if (!files.page && found->has_train()) return WriteCurvesOf(*found, files, environment);
  const auto data = CollectJob(*found, environment);
  if (!data.ok()) return environment.FailCall(data.status());
  return Write(*data, files, environment);
}

int WriteReportOfWatched(const std::string& job, const ReportFiles& files,
                         Environment& environment) {
  v1::GetJobRequest request;
  request.set_name(job);
  const auto found = environment.server_client().GetJob(request, environment.call_options());
  if (!found.ok()) return environment.FailCall(found.status());
  if (!client::HasEnded(*found)) {
    environment.err << "and once it has ended: maneuver job report " << ShortName(job)
                    << (files.page ? " --out " + *files.page : "")
                    << (files.curves ? " --curves " + *files.curves : "")
                    << (files.tensorboard ? " --tensorboard " + *files.tensorboard : "") << "\n";
    return kOk;
  }
  return WriteJobReport(job, files, environment);
}

void AddJobReport(Command& group, Environment& environment) {
  const auto arguments = std::make_shared<ReportArguments>();
  Command command = group.Add(
      "report", "Write the results of a training or an evaluation as a page for a browser",
      "Writes one HTML file that needs no network. For a training in progress it shows the curves "
      "so far.\n"
      "Example: maneuver job report 3f2a\n"
      "         maneuver job report 3f2a --curves curves.csv --tensorboard runs/3f2a");
  command.Argument("JOB", &arguments->name, "Its name, as maneuver job list prints it");
  AddPageOption(command, &arguments->files);
  command.Run([arguments, &environment] {
    return WriteJobReport(JobResource(arguments->name), FilesOf(*arguments), environment);
  });
}

void AddModelReport(Command& group, Environment& environment) {
  const auto arguments = std::make_shared<ReportArguments>();
  Command command = group.Add(
      "report", "Write everything about a version as a page for a browser",
      "Writes one HTML file that needs no network: actions, scenes, learning curves, its newest "
      "evaluation, other versions, settings.\n"
      "Example: maneuver model report town\n"
      "         maneuver model report town/3 --dataset unseen --out town-3.html");
  command.Argument("MODEL", &arguments->name, "town (what serves), town/2 or town@candidate");
  command.Option("--dataset", &arguments->dataset, "Evaluation to show [the newest]");
  AddPageOption(command, &arguments->files);
  command.Run([arguments, &environment] {
    const ReportFiles files = FilesOf(*arguments);
    const absl::Status prepared = PrepareReport(files);
    if (!prepared.ok()) return environment.Refuse(std::string(prepared.message()));
    return WriteModelReport(arguments->name, arguments->dataset, files, environment);
  });
}

}  // namespace maneuver::cli
