#include "server/rpc/prediction_run.h"

#include <utility>

#include "model/artifact/model_spec.h"
#include "server/errors/error_details.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/prediction_admission.h"
#include "server/rpc/prediction_answers.h"
#include "server/rpc/prediction_query.h"

namespace maneuver::rpc {

std::shared_ptr<PredictionRun> PredictionRun::Start(PredictionContext& context,
                                                    const PredictionIo& io,
                                                    serving::TimePoint deadline,
                                                    std::shared_ptr<const void> request,
                                                    std::function<void(absl::Status)> done) {
  std::shared_ptr<PredictionRun> run(
      new PredictionRun(context, io, deadline, std::move(request), std::move(done)));
  run->FindModel();
  return run;
}

PredictionRun::PredictionRun(PredictionContext& context, const PredictionIo& io,
                             serving::TimePoint deadline, std::shared_ptr<const void> request,
                             std::function<void(absl::Status)> done)
    : context_(context),
      io_(io),
      request_(std::move(request)),
      done_(std::move(done)),
      call_(std::make_shared<serving::PredictionCall>()) {
  call_->deadline = deadline;
}

void PredictionRun::Finish(absl::Status status) {
  // What is left to send is an error.
  if (!status.ok()) memory_.ShrinkTo(0);
  // They may hold what keeps this run alive.
  const auto request = std::move(request_);
  const auto done = std::exchange(done_, nullptr);
  done(std::move(status));
}

void PredictionRun::FindModel() {
  const auto reference = security::ParseOptionalModelReference(*io_.model, "model");
  if (!reference.ok()) return Finish(reference.status());
  if (io_.scenarios->empty()) {
    return Finish(errors::InvalidField("scenarios", "name at least one scenario"));
  }
  auto model = context_.models.Find(*reference);
  if (model.ok() && *model == nullptr) {
    const bool accepted = context_.loading.Post(
        [self = shared_from_this(), reference = *reference] {
          auto loaded = self->context_.models.Load(reference);
          const auto status = loaded.ok() ? self->Submit(*std::move(loaded)) : loaded.status();
          if (!status.ok()) self->Finish(status);
        },
        io_.bytes);
    if (!accepted) Finish(Busy());
    return;
  }
  const auto status = model.ok() ? Submit(*std::move(model)) : model.status();
  if (!status.ok()) Finish(status);
}

absl::Status PredictionRun::ParseQuestion(int actions) {
  if (io_.classifications != nullptr) {
    call_->question = serving::ClassifyTrajectory();
  } else if (io_.query != nullptr) {
    auto describe = ParseQuery(*io_.query, actions);
    if (!describe.ok()) return describe.status();
    call_->question = *std::move(describe);
  }
  return absl::OkStatus();
}

absl::Status PredictionRun::Submit(serving::ModelHandle model) {
  const v1::ModelSpec& spec = model->model().spec();
  if (auto status = AnswerNames(*model); !status.ok()) return status;
  if (auto status = ParseQuestion(spec.actions()); !status.ok()) return status;
  if (auto status = ReserveMemory(spec); !status.ok()) return status;
  const auto priority = ParsePriority(io_.priority);
  if (!priority.ok()) return priority.status();
  call_->priority = *priority;
  call_->bytes = io_.bytes;
  auto maps = FindMaps(*io_.scenarios, context_.maps);
  if (!maps.ok()) return maps.status();
  plan_ = PlanPrediction(*io_.scenarios, spec, context_.limits,
                         /*classify=*/io_.classifications != nullptr, *std::move(maps), io_.strict,
                         /*paths=*/{},
                         /*joint=*/io_.query != nullptr && io_.query->joint_combinations() > 0);
  *io_.model_version = model->name().ToString();
  if (io_.waypoint_times != nullptr) {
    const auto times = artifact::WaypointTimes(spec.trajectory());
    io_.waypoint_times->Assign(times.begin(), times.end());
  }
  if (plan_.targets.empty()) {
    Answer({});
    return absl::OkStatus();
  }
  call_->model = std::move(model);
  call_->targets = plan_.targets;
  call_->done = [self = shared_from_this()](std::vector<serving::TargetAnswer> answers) {
    self->Answer(std::move(answers));
  };
  const auto status = context_.scheduler.Submit(call_);
  if (!status.ok()) call_->done = nullptr;
  return status;
}

absl::Status PredictionRun::AnswerNames(const serving::ServedModel& model) {
  const serving::ServedModel::ActionNames names = model.action_names();
  if (io_.required_action_names != nullptr) {
    auto status = CheckRequiredNames(*io_.required_action_names, *names, model.name());
    if (!status.ok()) return status;
  }
  if (io_.action_names != nullptr) io_.action_names->Assign(names->begin(), names->end());
  return absl::OkStatus();
}

absl::Status PredictionRun::ReserveMemory(const v1::ModelSpec& spec) {
  const bool sigma = io_.query == nullptr || !io_.query->omit_sigma_trajectories();
  auto share = ReserveAnswer(context_.send_memory, *io_.scenarios, spec, call_->question, sigma);
  if (!share.ok()) return share.status();
  memory_ = *std::move(share);
  answer_bytes_.store(memory_.bytes(), std::memory_order_relaxed);
  return absl::OkStatus();
}

int64_t PredictionRun::MessageBytes() const {
  size_t bytes = 0;
  if (io_.predictions != nullptr) {
    for (const auto& prediction : *io_.predictions) bytes += prediction.ByteSizeLong();
  } else {
    for (const auto& each : *io_.classifications) bytes += each.ByteSizeLong();
  }
  return static_cast<int64_t>(bytes);
}

void PredictionRun::KeepAnswers(const std::vector<serving::TargetAnswer>& answers) {
  serving::PastAnswerMaker maker(call_->model->name(), call_->model->model().spec());
  for (size_t i = 0; i < answers.size(); ++i) {
    if (!answers[i].status.ok()) continue;
    context_.past_answers->Keep(maker.Make(call_->targets[i], answers[i].encoding));
  }
}

void PredictionRun::Answer(std::vector<serving::TargetAnswer> answers) {
  // Deadline, cancellation and shutdown concern the whole request: its caller gets no answer full
  // of errors.
  for (const serving::TargetAnswer& answer : answers) {
    if (absl::IsCancelled(answer.status) || absl::IsDeadlineExceeded(answer.status) ||
        absl::IsUnavailable(answer.status)) {
      return Finish(answer.status);
    }
  }
  if (io_.classifications != nullptr) {
    WriteClassifications(*io_.scenarios, plan_, answers, io_.classifications);
  } else {
    AnswerStyle style;
    style.probabilities = io_.probabilities;
    if (io_.query != nullptr) {
      style.sigma_trajectories = !io_.query->omit_sigma_trajectories();
      style.frame = io_.query->frame();
    }
    WritePredictions(*io_.scenarios, plan_, answers, style, io_.predictions, call_->joint);
    if (context_.past_answers != nullptr) KeepAnswers(answers);
  }
  memory_.ShrinkTo(MessageBytes());
  // Once it is finished the server may end: the shadow is kept, the context is not.
  const auto shadow = answers.empty() || request_ == nullptr ? nullptr : context_.shadow;
  if (shadow == nullptr || !shadow->Samples(call_->targets)) return Finish(absl::OkStatus());
  auto kept = std::make_shared<std::pair<std::shared_ptr<const void>, ScenarioMaps>>(
      std::move(request_), std::move(plan_.maps));
  Finish(absl::OkStatus());
  shadow->Offer(*call_, std::move(answers), std::move(kept));
}

}  // namespace maneuver::rpc
