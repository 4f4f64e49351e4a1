#include "server/rpc/outcome_report.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/rpc/prediction_plan.h"
#include "server/serving/outcome_recording.h"
#include "server/serving/outcome_scoring.h"
#include "server/serving/past_answers.h"

namespace maneuver::rpc {
namespace {

using serving::PastAnswer;
using serving::ScoredOutcome;

std::string OutcomePath(int outcome) { return absl::StrCat("outcomes[", outcome, "]"); }

std::string TargetPath(int outcome, int target) {
  return absl::StrCat(OutcomePath(outcome), ".targets[", target, "]");
}

// One target of the request, on its way to its score.
struct ReportedTarget {
  const v1::TargetOutcome* reported = nullptr;
  std::string path;
  absl::Status status;
  std::shared_ptr<const PastAnswer> answer;
  bool kept = false;  // whether the answer is one of PastAnswers
  serving::ModelHandle model;
  std::optional<ScoredOutcome> scored;
};

struct ReportedOutcome {
  absl::Status status;  // if not OK, no target is scored
  std::vector<ReportedTarget> targets;
};

// Scenes that one model predicts from.
struct SceneGroup {
  Scenarios scenes;
  std::vector<std::string> paths;
  std::vector<int> outcomes;  // index of each scene in the request
};

absl::Status CheckOutcome(const v1::Outcome& outcome, const std::string& path) {
  if (outcome.targets().empty()) {
    return errors::InvalidField(absl::StrCat(path, ".targets"), "name at least one target");
  }
  std::set<int64_t> ids;
  for (int t = 0; t < outcome.targets_size(); ++t) {
    if (ids.insert(outcome.targets(t).target_id()).second) continue;
    return errors::InvalidField(absl::StrCat(path, ".targets[", t, "].target_id"), "named twice");
  }
  switch (outcome.prediction_case()) {
    case v1::Outcome::kScenario:
      return absl::OkStatus();
    case v1::Outcome::kScenarioId:
      if (outcome.scenario_id().empty()) {
        return errors::InvalidField(absl::StrCat(path, ".scenario_id"), "is empty");
      }
      if (outcome.scenario_id().size() > kMostScenarioIdBytes) {
        return errors::InvalidField(absl::StrCat(path, ".scenario_id"),
                                    "is longer than the id of any scenario");
      }
      // Also refuses what is not a number, which has no place in an order.
      if (std::abs(outcome.prediction_time()) <= scene::ScenarioLimits().max_time) {
        return absl::OkStatus();
      }
      return errors::InvalidField(absl::StrCat(path, ".prediction_time"),
                                  "must be a finite number of seconds within -1e11 and 1e11");
    default:
      return errors::InvalidField(absl::StrCat(path, ".scenario"),
                                  "send the scene, or the scenario_id of a recent prediction");
  }
}

absl::Status NotKept(const v1::Outcome& outcome, const std::string& path, bool any_kept) {
  return errors::WithReason(
      absl::NotFoundError(
          absl::StrCat(path, ": the server keeps no ", any_kept ? "" : "answers, and so no ",
                       "answer for this target of scenario ", outcome.scenario_id(),
                       " at that prediction time that is not scored yet; send the scene instead")),
      "ANSWER_NOT_KEPT");
}

class OutcomeReport {
 public:
  OutcomeReport(PredictionContext& context, const v1::ReportOutcomesRequest& request,
                serving::TimePoint deadline, const std::function<bool()>& cancelled)
      : context_(context), request_(request), deadline_(deadline), cancelled_(cancelled) {}

  // Finds or computes all answers and scores them.
  absl::Status Score() {
    Begin();
    for (auto& [reference, group] : groups_) {
      if (absl::Status status = CheckWanted(); !status.ok()) return status;
      if (absl::Status status = Predict(reference, group); !status.ok()) return status;
    }
    if (!unavailable_.ok()) return unavailable_;
    for (size_t i = 0; i < outcomes_.size(); ++i) {
      if (!outcomes_[i].status.ok()) continue;
      for (ReportedTarget& target : outcomes_[i].targets) {
        if (absl::Status status = CheckWanted(); !status.ok()) return status;
        ScoreTarget(target);
      }
    }
    return CheckWanted();
  }

  // Keeps the outcomes that came with their scenes, each with its most surprising target.
  absl::Status Collect(serving::OutcomeCollection& collection) const {
    constexpr size_t kNll = 4;
    static_assert(serving::kOutcomeMetrics[kNll] == "nll");
    std::vector<serving::CollectedOutcome> collected;
    for (size_t i = 0; i < outcomes_.size(); ++i) {
      const v1::Outcome& outcome = request_.outcomes(static_cast<int>(i));
      if (!outcomes_[i].status.ok() || !outcome.has_scenario()) continue;
      std::set<int64_t> scored;
      double surprise = -std::numeric_limits<double>::infinity();
      const inference::ActionModel* model = nullptr;
      for (const ReportedTarget& target : outcomes_[i].targets) {
        if (!target.status.ok()) continue;
        scored.insert(target.reported->target_id());
        surprise = std::max(surprise, target.scored->metrics[kNll]);
        model = &target.model->model();
      }
      if (scored.empty()) continue;
      collected.push_back({serving::OutcomeRecording(outcome, scored, model->spec()), surprise,
                           serving::EventOf(outcome.scenario().scenario_id(),
                                            outcome.scenario().prediction_time())});
    }
    return collection.Add(collected);
  }

  // Counts each target, lets go of the answers that are scored, and writes the response.
  void Finish(serving::OutcomeMetrics& metrics, v1::ReportOutcomesResponse* response) {
    for (size_t i = 0; i < outcomes_.size(); ++i) {
      v1::OutcomeScore& score = *response->add_scores();
      score.set_outcome_index(static_cast<int>(i));
      if (!outcomes_[i].status.ok()) {
        *score.mutable_error() = errors::ToProto(outcomes_[i].status);
        for (int t = 0; t < request_.outcomes(static_cast<int>(i)).targets_size(); ++t) {
          metrics.CountFailed(outcomes_[i].status);
        }
        continue;
      }
      for (ReportedTarget& target : outcomes_[i].targets) {
        // Somebody else may have reported the same meanwhile.
        if (target.status.ok() && target.kept && !context_.past_answers->Remove(*target.answer)) {
          target.status = NotKept(request_.outcomes(static_cast<int>(i)), target.path, true);
        }
        Write(target, score.add_targets());
        if (target.status.ok()) {
          metrics.Observe(*target.model, *target.scored);
        } else {
          metrics.CountFailed(target.status);
        }
      }
    }
  }

 private:
  absl::StatusOr<serving::ModelHandle> FindModel(
      const std::optional<security::ModelReference>& reference) {
    auto model = context_.models.Find(reference);
    if (model.ok() && *model == nullptr) model = context_.models.Load(reference);
    if (absl::IsUnavailable(model.status())) unavailable_.Update(model.status());
    return model;
  }

  absl::Status CheckWanted() const {
    if (cancelled_()) return absl::CancelledError("the caller has gone");
    if (std::chrono::steady_clock::now() < deadline_) return absl::OkStatus();
    return absl::DeadlineExceededError("the deadline passed before all outcomes were scored");
  }

  // Checks the outcomes, finds the kept answers, and groups the scenes by the model that predicts.
  void Begin() {
    outcomes_.resize(static_cast<size_t>(request_.outcomes_size()));
    for (int i = 0; i < request_.outcomes_size(); ++i) {
      const v1::Outcome& outcome = request_.outcomes(i);
      ReportedOutcome& reported = outcomes_[static_cast<size_t>(i)];
      reported.status = CheckOutcome(outcome, OutcomePath(i));
      if (!reported.status.ok()) continue;
      for (int t = 0; t < outcome.targets_size(); ++t) {
        ReportedTarget& target = reported.targets.emplace_back();
        target.reported = &outcome.targets(t);
        target.path = TargetPath(i, t);
      }
      if (outcome.has_scenario()) {
        SceneGroup& group = groups_[outcome.model().empty() ? request_.model() : outcome.model()];
        v1::Scenario& scene = *group.scenes.Add();
        scene = outcome.scenario();
        scene.clear_target_ids();
        for (const auto& target : outcome.targets()) scene.add_target_ids(target.target_id());
        group.paths.push_back(OutcomePath(i) + ".scenario");
        group.outcomes.push_back(i);
      } else {
        reported.status = FindKept(outcome, i, reported.targets);
      }
    }
  }

  // Finds the kept answers of the targets and their models.
  absl::Status FindKept(const v1::Outcome& outcome, int index,
                        std::vector<ReportedTarget>& targets) {
    std::optional<security::ModelVersionName> version;
    if (!outcome.model().empty()) {
      const auto reference = security::ParseOptionalModelReference(
          outcome.model(), absl::StrCat(OutcomePath(index), ".model"));
      if (!reference.ok()) return reference.status();
      const auto resolved = context_.models.Resolve(*reference);
      if (absl::IsUnavailable(resolved.status())) unavailable_.Update(resolved.status());
      if (!resolved.ok()) return resolved.status();
      version = *resolved;
    }
    for (ReportedTarget& target : targets) {
      if (context_.past_answers != nullptr) {
        target.answer =
            context_.past_answers->Find(outcome.scenario_id(), target.reported->target_id(),
                                        outcome.prediction_time(), version);
      }
      if (target.answer == nullptr) {
        target.status = NotKept(outcome, target.path, context_.past_answers != nullptr);
        continue;
      }
      target.kept = true;
      auto model = FindModel(target.answer->version);
      target.status = model.status();
      if (model.ok()) target.model = *std::move(model);
    }
    return absl::OkStatus();
  }

  // Predicts from scenes. An error is that of the whole call.
  absl::Status Predict(const std::string& reference_text, SceneGroup& group) {
    const auto refuse = [&](const absl::Status& status) {
      for (const int outcome : group.outcomes) {
        outcomes_[static_cast<size_t>(outcome)].status = status;
      }
      return absl::OkStatus();
    };
    const auto reference = security::ParseOptionalModelReference(reference_text, "model");
    if (!reference.ok()) {
      for (const int outcome : group.outcomes) {
        const bool of_outcome = !request_.outcomes(outcome).model().empty();
        outcomes_[static_cast<size_t>(outcome)].status =
            security::ParseOptionalModelReference(
                reference_text, of_outcome ? OutcomePath(outcome) + ".model" : "model")
                .status();
      }
      return absl::OkStatus();
    }
    const auto model = FindModel(*reference);
    if (!model.ok()) return refuse(model.status());
    const PredictionPlan plan =
        PlanPrediction(group.scenes, (*model)->model().spec(), scene::ScenarioLimits(),
                       /*classify=*/false, {}, /*strict=*/false, group.paths);
    const auto answers = Answer(*model, plan, group);
    if (!answers.ok()) return answers.status();
    serving::PastAnswerMaker maker((*model)->name(), (*model)->model().spec());
    for (size_t s = 0; s < group.outcomes.size(); ++s) {
      ReportedOutcome& reported = outcomes_[static_cast<size_t>(group.outcomes[s])];
      reported.status = plan.scenarios[s].status;
      if (!reported.status.ok()) continue;
      for (size_t t = 0; t < reported.targets.size(); ++t) {
        ReportedTarget& target = reported.targets[t];
        const PlannedTarget& planned = plan.scenarios[s].targets[t];
        target.status = planned.status;
        if (!target.status.ok()) continue;
        const serving::TargetAnswer& answer = (*answers)[planned.index];
        target.status = answer.status;
        if (!target.status.ok()) continue;
        target.answer = std::make_shared<const PastAnswer>(
            maker.Make(plan.targets[planned.index], answer.encoding));
        target.model = *model;
      }
    }
    return absl::OkStatus();
  }

  // Returns the answers to the plan's targets, once the scheduler has them.
  absl::StatusOr<std::vector<serving::TargetAnswer>> Answer(const serving::ModelHandle& model,
                                                            const PredictionPlan& plan,
                                                            const SceneGroup& group) {
    if (plan.targets.empty()) return std::vector<serving::TargetAnswer>();
    auto promise = std::make_shared<std::promise<std::vector<serving::TargetAnswer>>>();
    auto future = promise->get_future();
    auto call = std::make_shared<serving::PredictionCall>();
    call->model = model;
    call->targets = plan.targets;
    for (const v1::Scenario& scene : group.scenes) {
      call->bytes += static_cast<int64_t>(scene.ByteSizeLong());
    }
    call->priority = serving::Priority::kBulk;
    call->deadline = deadline_;
    call->done = [promise](std::vector<serving::TargetAnswer> answers) {
      promise->set_value(std::move(answers));
    };
    if (absl::Status status = context_.scheduler.Submit(call); !status.ok()) return status;
    constexpr std::chrono::milliseconds kBetweenLooks{20};
    while (future.wait_for(kBetweenLooks) != std::future_status::ready) {
      if (cancelled_()) call->cancelled.store(true, std::memory_order_relaxed);
    }
    std::vector<serving::TargetAnswer> answers = future.get();
    for (const serving::TargetAnswer& answer : answers) {
      if (absl::IsCancelled(answer.status) || absl::IsDeadlineExceeded(answer.status) ||
          absl::IsUnavailable(answer.status)) {
        return answer.status;
      }
    }
    return answers;
  }

  void ScoreTarget(ReportedTarget& target) {
    if (!target.status.ok()) return;
    const absl::Status ran =
        serving::ServedModel::Lease(*target.model).With([&](serving::Engine& engine) {
          auto scored = serving::ScoreOutcome(*target.answer, target.reported->states(),
                                              target.model->model(), engine.session(), target.path);
          target.status = scored.status();
          if (scored.ok()) target.scored = *std::move(scored);
        });
    if (!ran.ok()) target.status = ran;
  }

  static void Write(const ReportedTarget& target, v1::TargetScore* proto) {
    proto->set_target_id(target.reported->target_id());
    if (!target.status.ok()) {
      *proto->mutable_error() = errors::ToProto(target.status);
      return;
    }
    const evaluation::Measurement& measured = target.scored->measurement;
    proto->set_model_version(target.model->name().ToString());
    proto->set_action_id(measured.action);
    proto->set_responsibility(measured.responsibilities[measured.action]);
    proto->set_probability(measured.probabilities[measured.action]);
    for (size_t i = 0; i < serving::kOutcomeMetrics.size(); ++i) {
      (*proto->mutable_metrics())[std::string(serving::kOutcomeMetrics[i])] =
          target.scored->metrics[i];
    }
    proto->set_speed_stratum(std::string(target.scored->speed_stratum));
  }

  PredictionContext& context_;
  const v1::ReportOutcomesRequest& request_;
  const serving::TimePoint deadline_;
  const std::function<bool()>& cancelled_;
  std::vector<ReportedOutcome> outcomes_;     // of the request
  std::map<std::string, SceneGroup> groups_;  // by the model's name in the request
  absl::Status unavailable_;                  // why a model cannot be found at the moment
};

}  // namespace

int CountTargets(const v1::ReportOutcomesRequest& request) {
  int targets = 0;
  for (const v1::Outcome& outcome : request.outcomes()) targets += outcome.targets_size();
  return targets;
}

absl::Status ReportOutcomes(PredictionContext& context, serving::OutcomeMetrics& metrics,
                            const v1::ReportOutcomesRequest& request, serving::TimePoint deadline,
                            const std::function<bool()>& cancelled,
                            v1::ReportOutcomesResponse* response,
                            serving::OutcomeCollection* collection) {
  OutcomeReport report(context, request, deadline, cancelled);
  if (absl::Status status = report.Score(); !status.ok()) return status;
  if (collection != nullptr) {
    if (absl::Status status = report.Collect(*collection); !status.ok()) {
      return errors::WithStorageReason(status);
    }
  }
  report.Finish(metrics, response);
  return absl::OkStatus();
}

}  // namespace maneuver::rpc
