// maneuver model compare: two versions side by side, by the reports that are kept beside them.

#include "client/cli/model_compare.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <memory>
#include <ostream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/action_titles.h"
#include "client/cli/comparison_text.h"
#include "client/cli/resource_names.h"
#include "model/evaluation/report_comparison.h"

namespace maneuver::cli {
namespace {

using Reports = std::vector<v1::EvaluationReport>;

struct CompareArguments {
  std::string baseline;
  std::string candidate;
  std::optional<std::string> dataset;
  bool strata = false;
};

std::string HowToEvaluate(const std::string& model, const std::string& dataset) {
  return absl::StrCat("\n  maneuver evaluate ", model, " --dataset ", ShortName(dataset));
}

bool IsOn(const Reports& reports, const std::string& dataset) {
  return std::ranges::find(reports, dataset, &v1::EvaluationReport::dataset) != reports.end();
}

std::string Datasets(const Reports& reports) {
  std::vector<std::string> names;
  for (const v1::EvaluationReport& report : reports) names.push_back(ShortName(report.dataset()));
  return names.empty() ? "nothing" : absl::StrJoin(names, ", ");
}

// The dataset that both were evaluated on: the one that is named, or the only one.
absl::StatusOr<std::string> ChooseDataset(const CompareArguments& arguments,
                                          const Reports& baseline, const Reports& candidate) {
  if (arguments.dataset) {
    const std::string dataset = DatasetResource(*arguments.dataset);
    std::string missing;
    if (!IsOn(baseline, dataset)) missing += HowToEvaluate(arguments.baseline, dataset);
    if (!IsOn(candidate, dataset)) missing += HowToEvaluate(arguments.candidate, dataset);
    if (missing.empty()) return dataset;
    return absl::NotFoundError(absl::StrCat("the versions were not both evaluated on ",
                                            ShortName(dataset), "; run", missing));
  }
  std::vector<std::string> common;
  for (const v1::EvaluationReport& report : baseline) {
    if (IsOn(candidate, report.dataset())) common.push_back(report.dataset());
  }
  if (common.size() == 1) return common.front();
  if (!common.empty()) {
    for (std::string& dataset : common) dataset = ShortName(dataset);
    return absl::InvalidArgumentError(absl::StrCat(
        "both were evaluated on ", absl::StrJoin(common, ", "), "; choose one with --dataset"));
  }
  std::string remedy;
  if (!baseline.empty()) {
    remedy = HowToEvaluate(arguments.candidate, baseline.front().dataset());
  } else if (!candidate.empty()) {
    remedy = HowToEvaluate(arguments.baseline, candidate.front().dataset());
  } else {
    remedy = HowToEvaluate(arguments.baseline, "DATASET") +
             HowToEvaluate(arguments.candidate, "DATASET");
  }
  return absl::NotFoundError(absl::StrCat(arguments.baseline, " was evaluated on ",
                                          Datasets(baseline), ", ", arguments.candidate, " on ",
                                          Datasets(candidate), "; run", remedy));
}

absl::StatusOr<v1::EvaluationReport> ReadReport(const Reports& reports, const std::string& dataset,
                                                Environment& environment) {
  const auto found = std::ranges::find(reports, dataset, &v1::EvaluationReport::dataset);
  v1::GetEvaluationReportRequest request;
  request.set_name(found->name());
  return environment.server_client().GetEvaluationReport(request, environment.call_options());
}

// Compared, or why that cannot be and what to run.
absl::StatusOr<v1::EvaluationComparison> Compared(const CompareArguments& arguments,
                                                  const v1::EvaluationReport& baseline,
                                                  const v1::EvaluationReport& candidate) {
  auto comparison = evaluation::CompareReports(baseline, candidate);
  const bool same_waypoints = google::protobuf::util::MessageDifferencer::Equals(
      baseline.trajectory(), candidate.trajectory());
  if (comparison.ok() || !same_waypoints) return comparison;
  return absl::FailedPreconditionError(
      absl::StrCat(std::string(comparison.status().message()),
                   HowToEvaluate(arguments.baseline, baseline.dataset()),
                   HowToEvaluate(arguments.candidate, baseline.dataset())));
}

int PrintActionMapping(const std::string& baseline, const std::string& candidate,
                       Environment& environment) {
  v1::GetModelVersionRequest request;
  request.set_name(baseline);
  const auto before =
      environment.server_client().GetModelVersion(request, environment.call_options());
  if (!before.ok()) return environment.FailCall(before.status());
  request.set_name(candidate);
  const auto after =
      environment.server_client().GetModelVersion(request, environment.call_options());
  if (!after.ok()) return environment.FailCall(after.status());
  environment.out << "\nWhich action is which:\n\n"
                  << ActionMappingText(*before, *after, environment.color);
  return kOk;
}

int Compare(const CompareArguments& arguments, Environment& environment) {
  const auto baselines = ListReports(ModelResource(arguments.baseline), environment);
  if (!baselines.ok()) return environment.FailCall(baselines.status());
  const auto candidates = ListReports(ModelResource(arguments.candidate), environment);
  if (!candidates.ok()) return environment.FailCall(candidates.status());
  const auto dataset = ChooseDataset(arguments, *baselines, *candidates);
  if (!dataset.ok()) return environment.Fail(dataset.status());
  const auto baseline = ReadReport(*baselines, *dataset, environment);
  if (!baseline.ok()) return environment.FailCall(baseline.status());
  const auto candidate = ReadReport(*candidates, *dataset, environment);
  if (!candidate.ok()) return environment.FailCall(candidate.status());
  const auto comparison = Compared(arguments, *baseline, *candidate);
  if (!comparison.ok()) return environment.Fail(comparison.status());
  if (environment.json()) {
    environment.PrintJson(*comparison);
    return kOk;
  }
  environment.out << ShortName(comparison->baseline()) << " and "
                  << ShortName(comparison->candidate()) << " on "
                  << ShortName(comparison->dataset()) << ", " << comparison->examples()
                  << " examples\n\n"
                  << ComparisonText(*comparison, environment.color);
  if (arguments.strata) environment.out << "\n" << StrataText(*comparison, environment.color);
  return PrintActionMapping(comparison->baseline(), comparison->candidate(), environment);
}

}  // namespace

absl::StatusOr<Reports> ListReports(const std::string& model, Environment& environment) {
  v1::ListEvaluationReportsRequest request;
  request.set_parent(model);
  request.set_page_size(1'000);
  Reports reports;
  do {
    auto page =
        environment.server_client().ListEvaluationReports(request, environment.call_options());
    if (!page.ok()) return page.status();
    for (v1::EvaluationReport& report : *page->mutable_evaluation_reports()) {
      reports.push_back(std::move(report));
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return reports;
}

void AddModelCompare(Command& group, Environment& environment) {
  const auto arguments = std::make_shared<CompareArguments>();
  Command compare =
      group.Add("compare", "Compare the evaluations of two versions",
                "Both must have been measured on the same examples: see maneuver evaluate.\n"
                "The difference is B minus A.\n"
                "Example: maneuver model compare town/1 town/2 --dataset unseen\n"
                "         maneuver model compare town town@candidate --strata");
  compare.Argument("A", &arguments->baseline,
                   "town (the version that serves), town/2 or town@candidate");
  compare.Argument("B", &arguments->candidate, "Version to compare with A");
  compare.Option("--dataset", &arguments->dataset,
                 "Dataset of both evaluations [the only one that they share]");
  compare.Flag("--strata", &arguments->strata, "Also compare by speed, turn and other strata");
  compare.Run([arguments, &environment] { return Compare(*arguments, environment); });
}

}  // namespace maneuver::cli
