#include "client/cli/report_collection.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/cli/action_gallery.h"
#include "client/cli/job_display.h"
#include "client/cli/model_compare.h"
#include "client/cli/report_scenes.h"
#include "client/cli/resource_names.h"
#include "client/cli/text_format.h"
#include "model/evaluation/report_comparison.h"

namespace maneuver::cli {
namespace {

constexpr int kMostOthers = 8;

report::ReportData NewReport(const std::string& title) {
  report::ReportData data;
  data.title = title;
  data.made = absl::FormatTime("%Y-%m-%d %H:%M", absl::Now(), absl::LocalTimeZone());
  data.program = "maneuver " MANEUVER_VERSION;
  return data;
}

// "models/town/versions/3" -> "models/town".
std::string ModelOf(const std::string& version) {
  return version.substr(0, version.find("/versions/"));
}

class VersionCollector {
 public:
  explicit VersionCollector(Environment& environment) : environment_(environment) {}

  // `evaluation` stands in for what is stored beside the version.
  absl::StatusOr<report::ReportData> Collect(const std::string& model,
                                             const std::optional<std::string>& dataset,
                                             const v1::EvaluationReport* evaluation) {
    v1::GetModelVersionRequest request;
    request.set_name(model);
    auto version =
        environment_.server_client().GetModelVersion(request, environment_.call_options());
    if (!version.ok()) return version.status();
    data_ = NewReport(ShortName(version->name()));
    data_.version = *std::move(version);
    AddActions();
    if (evaluation != nullptr) {
      data_.evaluation = *evaluation;
    } else {
      const absl::Status status = AddEvaluation(dataset);
      if (!status.ok()) return status;
    }
    if (data_.evaluation) AddOthers();
    AddLearning();
    AddScenes();
    return std::move(data_);
  }

 private:
  void Miss(const std::string& part, const std::string& reason, const std::string& command = "") {
    data_.missing[part] = {reason, command};
  }

  std::string HowToEvaluate() const {
    return absl::StrCat("maneuver evaluate ", data_.title,
                        " --dataset DATASET --report report.html");
  }

  void AddActions() {
    auto sets = ActionSetsOf(data_.version->name(), environment_);
    if (!sets.ok()) return Miss("actions", environment_.Explain(sets.status()));
    data_.action_sets = *std::move(sets);
  }

  absl::Status AddEvaluation(const std::optional<std::string>& dataset) {
    const auto reports = ListReports(data_.version->name(), environment_);
    if (!reports.ok()) return reports.status();
    const auto found = std::ranges::find_if(*reports, [&](const v1::EvaluationReport& report) {
      return !dataset || report.dataset() == *dataset;
    });
    if (found == reports->end() && dataset) {
      return absl::NotFoundError(absl::StrCat(data_.title, " was not evaluated on ",
                                              ShortName(*dataset), "; run\n  maneuver evaluate ",
                                              data_.title, " --dataset ", ShortName(*dataset)));
    }
    if (found == reports->end()) {
      Miss("evaluation", absl::StrCat(data_.title, " has not been evaluated yet."),
           HowToEvaluate());
      return absl::OkStatus();
    }
    v1::GetEvaluationReportRequest request;
    request.set_name(found->name());
    auto whole =
        environment_.server_client().GetEvaluationReport(request, environment_.call_options());
    if (!whole.ok()) return whole.status();
    data_.evaluation = *std::move(whole);
    return absl::OkStatus();
  }

  // Newest first, as the server lists versions.
  void AddOthers() {
    v1::ListModelVersionsRequest request;
    request.set_parent(ModelOf(data_.version->name()));
    request.set_page_size(100);
    const auto versions =
        environment_.server_client().ListModelVersions(request, environment_.call_options());
    if (!versions.ok()) return;  // a report without the comparison is worth having
    for (const v1::ModelVersion& version : versions->model_versions()) {
      if (version.name() == data_.version->name()) continue;
      const auto reports = ListReports(version.name(), environment_);
      if (!reports.ok()) continue;
      for (const v1::EvaluationReport& report : *reports) {
        if (!evaluation::CheckComparable(report, *data_.evaluation).ok()) continue;
        data_.others.push_back(report);
        break;
      }
      if (data_.others.size() == kMostOthers) return;
    }
  }

  void AddLearning() {
    const auto job = TrainingJobOf(data_.version->name(), environment_);
    if (!job.ok()) return Miss("learning", environment_.Explain(job.status()));
    if (!*job) {
      return Miss("learning",
                  "The server does not know the job that trained it: it was forgotten, "
                  "or ran elsewhere. A report of a training has its curves.",
                  "maneuver train MODEL --dataset DATASET --report report.html");
    }
    data_.job = **job;
    auto learning = LearningOf(**job, environment_);
    if (!learning.ok()) return Miss("learning", environment_.Explain(learning.status()));
    data_.learning = *std::move(learning);
  }

  void AddScenes() {
    SceneOrigin source;
    const v1::Provenance& provenance = data_.version->manifest().provenance();
    if (data_.evaluation) {
      source.dataset = data_.evaluation->dataset();
      source.examples = data_.evaluation->example_settings();
    } else if (!provenance.datasets().empty()) {
      source.dataset = DatasetResource(provenance.datasets(0));
      source.examples = provenance.settings().examples();
      source.held_out = true;
    } else {
      return Miss("scenes", "It is not known which dataset to take scenes from.", HowToEvaluate());
    }
    data_.scenes_from = source.dataset;
    auto scenes = CollectScenes(*data_.version, source, environment_);
    if (!scenes.ok()) {
      return Miss("scenes", environment_.Explain(scenes.status()), HowToEvaluate());
    }
    data_.scenes = *std::move(scenes);
  }

  Environment& environment_;
  report::ReportData data_;
};

}  // namespace

absl::StatusOr<std::vector<report::LearningPhase>> LearningOf(const v1::Job& job,
                                                              Environment& environment) {
  std::vector<v1::JobProgress> events;
  const int64_t last = job.progress().sequence();
  if (!job.has_train() || last == 0) return std::vector<report::LearningPhase>();
  v1::WatchJobRequest request;
  request.set_name(job.name());
  const auto watched = environment.server_client().WatchJob(
      request,
      [&](const v1::Job& event) {
        events.push_back(event.progress());
        return event.progress().sequence() < last;
      },
      environment.call_options());
  if (!watched.ok()) return watched.status();
  return report::LearningPhases(events);
}

absl::StatusOr<std::optional<v1::Job>> TrainingJobOf(const std::string& version,
                                                     Environment& environment) {
  v1::ListJobsRequest request;
  request.set_page_size(1'000);
  do {
    const auto page = environment.server_client().ListJobs(request, environment.call_options());
    if (!page.ok()) return page.status();
    for (const v1::Job& job : page->jobs()) {
      if (job.has_train() && job.model_version() == version) return job;
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return std::nullopt;
}

absl::StatusOr<report::ReportData> CollectVersion(const std::string& model,
                                                  const std::optional<std::string>& dataset,
                                                  Environment& environment) {
  return VersionCollector(environment).Collect(model, dataset, nullptr);
}

absl::StatusOr<report::ReportData> CollectJob(const v1::Job& job, Environment& environment) {
  if (job.has_cross_validate()) {
    return absl::InvalidArgumentError(
        absl::StrCat("there are no reports of cross-validations; maneuver job show ",
                     ShortName(job.name()), " prints one as tables"));
  }
  if (job.has_tag()) {
    return absl::InvalidArgumentError(
        absl::StrCat("there are no reports of taggings; maneuver tags pull ",
                     ShortName(job.tag().tags()), " FOLDER brings the tags for maneuver find"));
  }
  if (job.has_evaluate() && !job.has_evaluation()) {
    return absl::FailedPreconditionError(
        absl::StrCat(job.name(), " is ", StateName(job.state()), " and has measured nothing"));
  }
  if (job.has_evaluation()) {
    return VersionCollector(environment)
        .Collect(job.evaluation().model_version(), std::nullopt, &job.evaluation());
  }
  if (!job.model_version().empty()) {
    return VersionCollector(environment).Collect(job.model_version(), std::nullopt, nullptr);
  }
  report::ReportData data = NewReport(absl::StrCat(Subject(job), ", job ", ShortName(job.name())));
  auto learning = LearningOf(job, environment);
  if (!learning.ok()) return learning.status();
  data.learning = *std::move(learning);
  data.job = job;
  const bool ended = client::HasEnded(job);
  const std::string reason =
      absl::StrCat("The job is ", StateName(job.state()), " and has made no version",
                   ended ? ". It can go on:" : " yet. Once it has:");
  const std::string command =
      absl::StrCat("maneuver job ", ended ? "resume " : "report ", ShortName(job.name()));
  for (const char* part : {"actions", "evaluation", "scenes", "settings"}) {
    data.missing[part] = {reason, command};
  }
  return data;
}

}  // namespace maneuver::cli
