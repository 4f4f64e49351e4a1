// The part of ModelRegistry that keeps reports of evaluations beside versions.

#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/monitoring/logging.h"
#include "server/serving/evaluation_files.h"
#include "server/serving/model_registry.h"

namespace maneuver::serving {
namespace {

using security::EvaluationName;
using security::ModelVersionName;

// Where it is says what it is of: a version's folder may have been brought from another server.
v1::EvaluationReport Named(v1::EvaluationReport report, const EvaluationName& name) {
  report.set_name(name.ToString());
  report.set_model_version(name.version.ToString());
  return report;
}

}  // namespace

absl::Status ModelRegistry::KeepReport(const v1::EvaluationReport& report) {
  const auto version = security::ParseModelVersionName(report.model_version(), "model_version");
  if (!version.ok()) return version.status();
  const auto dataset = security::ParseDatasetName(report.dataset(), "dataset");
  if (!dataset.ok()) return dataset.status();
  v1::EvaluationReport kept = Named(report, {*version, *dataset});
  kept.clear_sampled_examples();
  // Nobody removes the version meanwhile.
  const std::lock_guard change(change_mutex_);
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = ResolveLocked(*version); !found.ok()) return found.status();
  }
  return WriteEvaluation(folders_.FolderOf(*version), *dataset, kept);
}

absl::StatusOr<std::vector<v1::EvaluationReport>> ModelRegistry::ListReports(
    const ModelVersionName& name) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = ResolveLocked(name); !found.ok()) return found.status();
  }
  std::vector<v1::EvaluationReport> reports;
  for (const std::string& dataset : ListEvaluations(folders_.FolderOf(name))) {
    absl::StatusOr<v1::EvaluationReport> report = GetReport({name, dataset});
    if (!report.ok()) {
      monitoring::Log(monitoring::LogLevel::kWarning, "report left out",
                      {{"evaluation", EvaluationName{name, dataset}.ToString()},
                       {"reason", std::string(report.status().message())}});
      continue;
    }
    report->clear_action_usage();
    report->clear_reliability();
    report->clear_strata();
    report->clear_action_uses();
    report->clear_rivals();
    reports.push_back(*std::move(report));
  }
  const auto nanoseconds = [](const v1::EvaluationReport& report) {
    return google::protobuf::util::TimeUtil::TimestampToNanoseconds(report.create_time());
  };
  std::ranges::stable_sort(
      reports, [&](const auto& a, const auto& b) { return nanoseconds(a) > nanoseconds(b); });
  return reports;
}

absl::StatusOr<v1::EvaluationReport> ModelRegistry::GetReport(const EvaluationName& name) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = ResolveLocked(name.version); !found.ok()) return found.status();
  }
  absl::StatusOr<v1::EvaluationReport> report =
      ReadEvaluation(folders_.FolderOf(name.version), name.evaluation);
  if (absl::IsNotFound(report.status())) {
    return errors::WithReason(
        absl::NotFoundError(absl::StrCat(name.version.ToString(), " was not evaluated on datasets/",
                                         name.evaluation, "; evaluate it first")),
        "EVALUATION_NOT_FOUND", {{"evaluation", name.ToString()}});
  }
  if (!report.ok()) {
    return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                  name.ToString(), " is damaged; evaluate the version again")),
                              "EVALUATION_DAMAGED", {{"evaluation", name.ToString()}});
  }
  return Named(*std::move(report), name);
}

}  // namespace maneuver::serving
