#include "server/maneuverd/services.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/rpc/open_connections.h"
#include "server/rpc/prediction_admission.h"
#include "server/serving/shadow.h"

namespace maneuver {
namespace {

constexpr int kDiskThreads = 4;
constexpr int kLoadingThreads = 1;
constexpr size_t kMaxWaitingForDisk = 256;
constexpr size_t kMaxWaitingToSend = 128;  // some 20 kB each
// Outcomes can wait: scoring takes at most one core from predictions.
constexpr int kScoringThreads = 1;
constexpr size_t kMaxWaitingForScores = 64;
// Parts of the memory's limit.
constexpr double kFilled = 0.6;
constexpr double kUrgent = 0.9;
// A smaller limit has no room for what large senders bring before they are known as such.
constexpr int64_t kLeastToWeigh = int64_t{256} << 20;

std::shared_ptr<serving::Shadow> MakeShadow(const ServerOptions& options, Storage& storage,
                                            serving::BatchScheduler& scheduler,
                                            monitoring::MetricRegistry& metrics) {
  if (options.shadow.fraction <= 0.0 || !Predicts(options.role)) return nullptr;
  return std::make_shared<serving::Shadow>(
      options.shadow, *storage.models, [&scheduler] { return scheduler.HasWaiting(); }, metrics);
}

// What the calls end with that need a model in memory.
absl::Status RefusalOfPredictions(Role role) {
  if (Predicts(role)) return absl::OkStatus();
  return errors::WithReason(
      absl::FailedPreconditionError(
          absl::StrCat("this server has --role ", std::string(RoleName(role)),
                       " and answers no predictions; ask one that has --role serve or --role all")),
      "PREDICTIONS_ELSEWHERE");
}

}  // namespace

Services::Services(const ServerOptions& options, Storage& storage, JobWork& job_work,
                   security::AccessControl& access, monitoring::MetricRegistry& metrics)
    : options_(options),
      message_gate_(kMaxWaitingToSend),
      memory_(options.memory_limit, metrics),
      send_memory_(options.sends, metrics, &memory_),
      scheduler_(options.scheduler, metrics),
      disk_(kDiskThreads, kMaxWaitingForDisk),
      loading_(kLoadingThreads, kMaxWaitingForDisk),
      maps_(options.maps, metrics),
      context_{.models = *storage.models,
               .scheduler = scheduler_,
               .maps = maps_,
               .send_memory = send_memory_,
               .blocking = disk_,
               .loading = loading_,
               .limits = {.map_by_id = true},
               .access = access,
               .shadow = MakeShadow(options, storage, scheduler_, metrics)},
      predictions_(context_),
      blocking_{disk_, send_memory_},
      models_(*storage.versions, *storage.models, job_work.version_uploads(), blocking_, access),
      replicas_(storage.store->Replicas(), blocking_),
      datasets_(*storage.datasets, job_work.supervisor(), blocking_, access),
      training_(job_work.supervisor(), blocking_, access),
      tags_(job_work.supervisor(), blocking_, access),
      outcome_metrics_(metrics),
      scoring_(kScoringThreads, kMaxWaitingForScores),
      outcomes_(context_, outcome_metrics_, scoring_,
                {storage.outcomes.get(), storage.datasets.get()}) {
  if (options.outcome_memory > 0) {
    context_.past_answers = &past_answers_.emplace(options.outcome_memory, metrics);
  }
}

std::vector<rpc::NamedService> Services::ForServer() {
  const auto reserve_memory = [this](int64_t request_bytes) {
    return memory_.AdmitRequest(request_bytes);
  };
  rpc::MessageGate* const gate = options_.memory_limit > 0 ? &message_gate_ : nullptr;
  const auto guard = [&](const char* name, grpc::Service& service) {
    return rpc::NamedService{
        .name = name, .service = &service, .reserve_memory = reserve_memory, .message_gate = gate};
  };
  rpc::NamedService predictions = guard(v1::PredictionService::service_full_name(), predictions_);
  predictions.check_request = [this](auto method, auto deadline, const auto& request) {
    return rpc::CheckWait(scheduler_, method, deadline, request);
  };
  rpc::NamedService outcomes = guard(v1::OutcomeService::service_full_name(), outcomes_);
  predictions.refusal = outcomes.refusal = RefusalOfPredictions(options_.role);
  return {std::move(predictions),
          std::move(outcomes),
          guard(v1::ModelService::service_full_name(), models_),
          guard(v1::DatasetService::service_full_name(), datasets_),
          guard(v1::TrainingService::service_full_name(), training_),
          guard(v1::TagService::service_full_name(), tags_),
          // What servers and operators need while memory is short.
          {.name = v1::ReplicaService::service_full_name(), .service = &replicas_},
          {.name = v1::AdminService::service_full_name(), .service = &admin_}};
}

void Services::BoundLargeRequests(int port) {
  const int64_t limit = options_.memory_limit;
  const int64_t least = serving::ShareOf(limit, 8, options_.limits.max_receive_bytes);
  const auto largest = static_cast<double>(options_.limits.max_message_bytes);
  memory_.RelieveBy(
      [this, received = rpc::ReceivedBytes(port), limit, least, largest](double part) mutable {
        const auto now = std::chrono::steady_clock::now();
        received.Note(now);
        const double free = (kFilled - part) * static_cast<double>(limit);
        auto allowed = static_cast<size_t>(std::max(free, static_cast<double>(least)) / largest);
        if (message_gate_.HasSlow(now)) {
          const auto recent = received.Recent();
          if (limit >= kLeastToWeigh) message_gate_.Weigh(recent);
          const auto bytes = std::accumulate(
              recent.begin(), recent.end(), 0.0,
              [](double sum, const auto& each) { return sum + static_cast<double>(each.second); });
          if (2.0 * bytes < free) allowed = std::numeric_limits<size_t>::max();
        }
        message_gate_.StopExcess(now, allowed);
        return part > kUrgent ? received.CutOffLargest(least) : 0;
      });
}

void Services::Drain() {
  predictions_.Drain();
  outcomes_.Drain();
}

}  // namespace maneuver
