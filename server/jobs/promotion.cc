#include "server/jobs/promotion.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "model/evaluation/report_comparison.h"
#include "model/evaluation/rival_requirements.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_requests.h"

namespace maneuver::jobs {
namespace {

// So often another version may come to serve while the one before is being compared.
constexpr int kMostChanges = 5;

v1::PromotionDecision Against(const std::string& what, const absl::Status& why) {
  v1::PromotionDecision decision;
  decision.set_reason(absl::StrCat(what, ": ", std::string(why.message())));
  *decision.mutable_error() = errors::ToProto(why);
  return decision;
}

// "nll 1.3000 against 1.2500 nats"
std::string FiguresText(const v1::MetricComparison& metric) {
  std::string text = absl::StrFormat("%s %.4f against %.4f", metric.metric(),
                                     metric.candidate_value(), metric.baseline_value());
  if (!metric.unit().empty()) absl::StrAppend(&text, " ", metric.unit());
  if (metric.tolerance() > 0.0) absl::StrAppend(&text, " + ", metric.tolerance());
  return text;
}

// By what the reports say.
v1::PromotionDecision Compare(const PromotionTask& task, const v1::EvaluationReport& baseline,
                              const v1::EvaluationReport& candidate) {
  const std::string cannot =
      absl::StrCat("cannot be compared with ", baseline.model_version(), ", which serves");
  if (absl::Status status = evaluation::CheckComparable(baseline, candidate); !status.ok()) {
    return Against(cannot, status);
  }
  v1::PromotionDecision decision;
  v1::EvaluationComparison& comparison = *decision.mutable_comparison();
  comparison.set_baseline(baseline.model_version());
  comparison.set_candidate(candidate.model_version());
  comparison.set_dataset(task.criteria.dataset());
  comparison.set_examples(candidate.examples());
  std::vector<std::string> all;
  std::vector<std::string> worse;
  for (const v1::MetricCriterion& criterion : task.criteria.metrics()) {
    auto metric =
        evaluation::CompareMetric(baseline, candidate, criterion.metric(), criterion.tolerance());
    if (!metric.ok()) return Against(cannot, metric.status());
    all.push_back(FiguresText(*metric));
    if (metric->verdict() == v1::METRIC_VERDICT_WORSE) worse.push_back(all.back());
    *comparison.add_metrics() = *std::move(metric);
  }
  decision.set_promoted(worse.empty());
  decision.set_reason(absl::StrCat(worse.empty() ? "no worse than " : "worse than ",
                                   baseline.model_version(), " on ", task.criteria.dataset(), ": ",
                                   absl::StrJoin(worse.empty() ? all : worse, ", ")));
  return decision;
}

// Returns the report of a version that is kept, if it is by the task's criteria.
std::optional<v1::EvaluationReport> KeptReport(const std::string& version,
                                               const PromotionTask& task,
                                               PromotionVersions& versions) {
  auto kept = versions.FindReport(version);
  // It must say how the new version stands beside its rivals, if something is required of that.
  const bool needs_rivals = version == task.version && !task.criteria.rivals().empty();
  if (kept.ok() && kept->dataset_sha256() == task.dataset_sha256 &&
      evaluation::ChooseTheSameExamples(kept->example_settings(), task.criteria.examples()) &&
      (kept->has_rivals() || !needs_rivals)) {
    return *std::move(kept);
  }
  return std::nullopt;
}

// Returns the versions whose reports decide while `serving` serves (empty: none does), the new one
// first.
std::vector<std::string> ComparedVersions(const std::string& serving, const PromotionTask& task) {
  if (!serving.empty()) return {task.version, serving};
  if (!task.criteria.rivals().empty()) return {task.version};
  return {};
}

// Returns the decision against the new version because `version` could not be measured.
v1::PromotionDecision AgainstUnmeasured(const std::string& version, const PromotionTask& task,
                                        const absl::Status& why) {
  return Against(absl::StrCat(version, " was not measured on ", task.criteria.dataset()), why);
}

v1::PromotionDecision AsNoneServes(const PromotionTask& task) {
  v1::PromotionDecision decision;
  decision.set_promoted(true);
  decision.set_reason(absl::StrCat("no version of ", task.model, " served"));
  return decision;
}

// Turns a decision against a version that does not meet the requirements, and names where.
void HoldAgainstRivals(const PromotionTask& task, const v1::RivalStandings& rivals,
                       v1::PromotionDecision& decision) {
  const auto& requirements = task.criteria.rivals();
  if (requirements.empty()) return;
  const std::vector<v1::RivalShortfall> shortfalls =
      evaluation::FindShortfalls(rivals, requirements);
  if (shortfalls.empty()) {
    std::vector<std::string> met;
    for (const auto& each : requirements) met.push_back(evaluation::RequirementText(each));
    decision.set_reason(absl::StrCat(decision.reason(), "; ", absl::StrJoin(met, ", ")));
    return;
  }
  decision.mutable_shortfalls()->Assign(shortfalls.begin(), shortfalls.end());
  const std::string unmet = absl::StrCat("what is required on ", task.criteria.dataset(),
                                         " is not met: ", evaluation::ShortfallText(shortfalls));
  decision.set_reason(decision.promoted() ? unmet : absl::StrCat(decision.reason(), "; ", unmet));
  decision.set_promoted(false);
}

// Decides by the requirements and the version that serves, and changes nothing yet.
PromotionOutcome Judge(const std::string& serving, const PromotionTask& task,
                       PromotionVersions& versions) {
  std::vector<v1::EvaluationReport> reports;
  for (const std::string& version : ComparedVersions(serving, task)) {
    if (auto kept = KeptReport(version, task, versions)) {
      reports.push_back(*std::move(kept));
      continue;
    }
    PromotionVersions::MeasuredVersion measured = versions.Measure(version);
    if (measured.interrupted) return {std::nullopt, std::move(measured.status)};
    if (!measured.status.ok()) return {AgainstUnmeasured(version, task, measured.status), {}};
    reports.push_back(std::move(measured.report));
  }
  if (reports.empty()) return {AsNoneServes(task), {}};
  v1::PromotionDecision decision =
      serving.empty() ? AsNoneServes(task) : Compare(task, reports[1], reports[0]);
  HoldAgainstRivals(task, reports[0].rivals(), decision);
  return {std::move(decision), {}};
}

}  // namespace

v1::PromotionCriteria ResolveCriteria(v1::PromotionCriteria criteria) {
  if (criteria.metrics().empty()) {
    for (const char* metric : {"min_ade_6", "nll"}) criteria.add_metrics()->set_metric(metric);
  }
  *criteria.mutable_examples() = ResolveExamples(criteria.examples());
  return criteria;
}

std::vector<std::string> VersionsToMeasure(const PromotionTask& task, PromotionVersions& versions) {
  const std::string serving = versions.Serving();
  if (serving == task.version) return {};
  const std::optional<v1::PromotionDecision> remembered = versions.Remembered();
  if (remembered && remembered->comparison().baseline() == serving) return {};
  std::vector<std::string> unmeasured = ComparedVersions(serving, task);
  std::erase_if(unmeasured, [&](const std::string& version) {
    return KeptReport(version, task, versions).has_value();
  });
  return unmeasured;
}

PromotionOutcome MeasureVersions(const PromotionTask& task, PromotionVersions& versions) {
  for (const std::string& version : VersionsToMeasure(task, versions)) {
    const PromotionVersions::MeasuredVersion measured = versions.Measure(version);
    if (measured.interrupted) return {std::nullopt, measured.status};
    if (!measured.status.ok()) return {AgainstUnmeasured(version, task, measured.status), {}};
  }
  return {};
}

PromotionOutcome DecidePromotion(const PromotionTask& task, PromotionVersions& versions) {
  std::optional<v1::PromotionDecision> remembered = versions.Remembered();
  for (int changes = 0; changes < kMostChanges; ++changes) {
    const std::string serving = versions.Serving();
    PromotionOutcome outcome;
    if (serving == task.version) {
      // The server died after it had promoted, or somebody was quicker.
      outcome.decision = std::exchange(remembered, std::nullopt).value_or(v1::PromotionDecision());
      if (!outcome.decision->promoted()) {
        outcome.decision->set_promoted(true);
        outcome.decision->set_reason("it serves already: somebody else promoted it");
      }
      return outcome;
    }
    if (remembered && remembered->comparison().baseline() == serving) {
      outcome.decision = *remembered;
    } else {
      outcome = Judge(serving, task, versions);
    }
    remembered.reset();
    if (!outcome.decision || !outcome.decision->promoted()) return outcome;
    if (absl::Status status = versions.Remember(*outcome.decision); !status.ok()) {
      return {Against("the decision to promote it could not be written down", status), {}};
    }
    const absl::StatusOr<bool> promoted = versions.Promote(task.version, serving);
    if (errors::IsStoreAway(promoted.status())) return {std::nullopt, promoted.status()};
    if (!promoted.ok()) return {Against("it could not be promoted", promoted.status()), {}};
    if (*promoted) return outcome;
  }
  return {Against("it could not be compared",
                  absl::AbortedError("another version came to serve again and again meanwhile")),
          {}};
}

}  // namespace maneuver::jobs
