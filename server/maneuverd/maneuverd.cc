// maneuverd: the prediction server.

#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "locks/stop_latch.h"
#include "model/data/dataset_store.h"
#include "model/files/durable_file.h"
#include "model/kernels/kernel_choice.h"
#include "server/errors/error_details.h"
#include "server/jobs/replica_report.h"
#include "server/jobs/retention.h"
#include "server/jobs/supervisor.h"
#include "server/maneuverd/data_lock.h"
#include "server/maneuverd/health_command.h"
#include "server/maneuverd/health_pages.h"
#include "server/maneuverd/idle_memory.h"
#include "server/maneuverd/options.h"
#include "server/maneuverd/protection.h"
#include "server/maneuverd/repair_command.h"
#include "server/maneuverd/service_manager.h"
#include "server/maneuverd/store_command.h"
#include "server/maneuverd/token_command.h"
#include "server/monitoring/logging.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/admin_service.h"
#include "server/rpc/dataset_service.h"
#include "server/rpc/library_logs.h"
#include "server/rpc/model_service.h"
#include "server/rpc/open_connections.h"
#include "server/rpc/outcome_service.h"
#include "server/rpc/prediction_admission.h"
#include "server/rpc/prediction_service.h"
#include "server/rpc/replica_service.h"
#include "server/rpc/server.h"
#include "server/rpc/tag_service.h"
#include "server/rpc/training_service.h"
#include "server/rpc/worker_pool.h"
#include "server/serving/batch_scheduler.h"
#include "server/serving/local_model_versions.h"
#include "server/serving/map_cache.h"
#include "server/serving/memory_budget.h"
#include "server/serving/outcome_collection.h"
#include "server/serving/outcome_metrics.h"
#include "server/serving/past_answers.h"
#include "server/serving/send_memory.h"
#include "server/serving/serving_table.h"
#include "server/serving/shadow.h"
#include "server/serving/version_store.h"
#include "server/serving/version_uploads.h"
#include "server/store/open_store.h"

namespace maneuver {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

constexpr int kDiskThreads = 4;
const absl::Duration kBetweenSweeps = absl::Hours(1);
constexpr std::chrono::seconds kFollowInterval{1};  // what other servers decide
constexpr size_t kMaxWaitingForDisk = 256;
constexpr size_t kMaxWaitingToSend = 128;  // some 20 kB each
// How long work on the disk may take to end after the last call and the last trainer.
constexpr std::chrono::seconds kLastWork{10};
// Parts of the memory's limit.
constexpr double kFilled = 0.6;
constexpr double kUrgent = 0.9;
// A smaller limit has no room for what large senders bring before they are known as such.
constexpr int64_t kLeastToWeigh = int64_t{256} << 20;
// Outcomes can wait: scoring takes at most one core from predictions.
constexpr int kScoringThreads = 1;
constexpr size_t kMaxWaitingForScores = 64;

// SIGTERM and SIGINT, as something to wait for.
class TerminationSignals {
 public:
  // Call before any thread is started: they inherit that these signals are not for them.
  TerminationSignals() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGTERM);
    sigaddset(&signals_, SIGINT);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    // A reader of the log that goes away does not take the server with it.
    signal(SIGPIPE, SIG_IGN);
    // The parent process may have set it to be ignored. Then the kernel reaps trainers, and the server
    // cannot learn how they ended.
    signal(SIGCHLD, SIG_DFL);
  }

  int Wait() {
    int signal = 0;
    sigwait(&signals_, &signal);
    return signal;
  }

  // The next signal ends the process at once.
  void ExitOnNext() {
    std::thread([this] {
      const int signal = Wait();
      _exit(128 + signal);
    }).detach();
  }

 private:
  sigset_t signals_;
};

// Ends the process after `time`, if it is still there. A disk or a store that hangs does not hold up
// the end; what waits for it is lost as in a crash, and nobody was told that it is done.
void ExitAfter(std::chrono::milliseconds time) {
  std::thread([time] {
    std::this_thread::sleep_for(time);
    // The log may hang, too.
    std::thread([] {
      Log(LogLevel::kError,
          "work that has not ended is broken off; does the disk or the store hang?");
    }).detach();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    _exit(1);
  }).detach();
}

jobs::SupervisorOptions SupervisorOptionsFor(const ServerOptions& options) {
  jobs::SupervisorOptions supervisor;
  supervisor.folder = options.data_dir / "jobs";
  supervisor.tags = options.data_dir / "tags";
  supervisor.tag_quota_bytes = options.jobs.tag_quota_bytes;
  supervisor.trainer = options.jobs.trainer;
  supervisor.launcher = absl::StrSplit(options.jobs.trainer_command, ' ', absl::SkipEmpty());
  supervisor.limits = options.jobs.limits;
  supervisor.checkpoints = options.jobs.checkpoints;
  supervisor.least_effective_actions = options.jobs.least_effective_actions;
  supervisor.max_running_jobs = RunsJobs(options.role) ? options.jobs.max_running : 0;
  supervisor.job_ranks = RanksForAJob(options.jobs);
  supervisor.job_memory = MemoryForAJob(options.jobs);
  supervisor.max_pending_jobs = options.jobs.max_pending;
  // A trainer that ignores SIGTERM must not hold up the end of a server that others call. Where
  // nobody calls, its last checkpoint comes first.
  supervisor.patience = options.role == Role::kWork
                            ? options.shutdown_timeout
                            : std::min(supervisor.patience, options.shutdown_timeout);
  return supervisor;
}

// What cannot be served is logged; what served before then goes on.
void Serve(const std::vector<security::ModelVersionName>& versions, serving::ServingTable& models) {
  for (const security::ModelVersionName& version : versions) {
    const security::ModelAliasName alias{version.model, std::string(security::kServingAlias)};
    if (models.Serving(version.model) == version) continue;
    if (const auto status = models.SetAlias(alias, version.version); !status.ok()) {
      Log(LogLevel::kError, "cannot serve the version of --serve",
          {{"model_version", version.ToString()}, {"reason", std::string(status.message())}});
    }
  }
}

absl::Status WritePortFile(const std::filesystem::path& file, const std::string& grpc_address,
                           const std::string& metrics_address) {
  const nlohmann::json addresses = {{"grpc", grpc_address}, {"metrics", metrics_address}};
  return files::WriteFileAtomically(file, addresses.dump() + "\n");
}

// Serves metrics and health where `options` say; nullptr if they say nowhere.
absl::StatusOr<std::unique_ptr<monitoring::HttpPages>> ServePages(
    const ServerOptions& options, const monitoring::PrometheusMetrics& metrics,
    const rpc::Server& server) {
  if (!options.metrics_listen) return nullptr;
  return monitoring::HttpPages::Serve(
      options.metrics_listen->ToString(),
      {monitoring::MetricsPage(metrics), LivenessPage([&server] { return server.IsAlive(); }),
       ReadinessPage([&server](std::string_view service) { return server.IsServing(service); },
                     Predicts(options.role))});
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

v1::ReplicaRole RoleInContract(Role role) {
  switch (role) {
    case Role::kApi:
      return v1::REPLICA_ROLE_API;
    case Role::kServe:
      return v1::REPLICA_ROLE_SERVE;
    case Role::kWork:
      return v1::REPLICA_ROLE_WORK;
    default:
      return v1::REPLICA_ROLE_ALL;
  }
}

// Returns what the other servers are to know of this one.
v1::Replica DescribeReplica(const ServerOptions& options, const serving::ServingTable& models,
                            jobs::Supervisor& supervisor) {
  v1::Replica replica;
  replica.set_name(options.replica_name);
  replica.set_role(RoleInContract(options.role));
  for (const serving::ModelAlias& alias : models.Loaded()) {
    v1::ModelAlias& loaded = *replica.add_loaded();
    loaded.set_name(alias.name.ToString());
    loaded.set_model_version(
        security::ModelVersionName{alias.name.model, alias.version}.ToString());
  }
  if (const auto capacity = supervisor.Capacity()) {
    v1::JobCapacity& has = *replica.mutable_job_capacity();
    has.mutable_devices()->Assign(capacity->devices.begin(), capacity->devices.end());
    has.set_ranks(capacity->ranks);
    has.set_memory_bytes(capacity->memory_bytes);
  }
  return replica;
}

// Bounds how many large requests are received at once, each counted as the largest that may come. They
// have what is free below 60 % of the memory's limit, but at least an eighth of the limit. While twice
// the bytes of the last seconds would fit there is no bound: requests whose bytes do not come take no
// memory. Above 90 % of the limit, closes the connections that sent the most in the last seconds, until
// the others have sent no more than that eighth.
void BoundLargeRequests(int port, const ServerOptions& options, rpc::MessageGate& gate,
                        serving::MemoryBudget& memory) {
  const int64_t least = serving::ShareOf(options.memory_limit, 8, options.limits.max_receive_bytes);
  memory.RelieveBy(
      [received = rpc::ReceivedBytes(port), &gate, least,
       weighs = options.memory_limit >= kLeastToWeigh,
       limit = static_cast<double>(options.memory_limit),
       largest = static_cast<double>(options.limits.max_message_bytes)](double part) mutable {
        const auto now = std::chrono::steady_clock::now();
        received.Note(now);
        const double free = (kFilled - part) * limit;
        auto allowed = static_cast<size_t>(std::max(free, static_cast<double>(least)) / largest);
        if (gate.HasSlow(now)) {
          const auto recent = received.Recent();
          if (weighs) gate.Weigh(recent);
          const auto bytes = std::accumulate(
              recent.begin(), recent.end(), 0.0,
              [](double sum, const auto& each) { return sum + static_cast<double>(each.second); });
          if (2.0 * bytes < free) allowed = std::numeric_limits<size_t>::max();
        }
        gate.Look(now, allowed);
        return part > kUrgent ? received.CutOffLargest(least) : 0;
      });
}

// Lets this process have as many files open as so many connections need, if it may.
void RaiseFileLimit(int connections) {
  constexpr rlim_t kOthers = 4096;
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  const rlim_t wanted = 2 * static_cast<rlim_t>(connections) + kOthers;
  files.rlim_cur = std::min(files.rlim_max, std::max(files.rlim_cur, wanted));
  setrlimit(RLIMIT_NOFILE, &files);
}

absl::Status Run(const ServerOptions& options, TerminationSignals& signals,
                 ServiceManager& manager) {
  const auto metrics = monitoring::PrometheusMetrics::Create();
  metrics
      ->AddGauge("maneuver_build_info", "1, with the version as a label.",
                 {{"version", MANEUVER_VERSION}})
      .Set(1.0);

  const IdleMemory idle_memory;
  const auto protection = Protection::Open(options, *metrics);
  if (!protection.ok()) return protection.status();
  const auto lock = DataLock::Take(options.data_dir, options.is_shared);
  if (!lock.ok()) return lock.status();
  const std::string modes = CloseToOthers(options.data_dir, options.is_shared);
  if (!modes.empty()) Log(LogLevel::kWarning, modes);
  metrics->WatchDisk(options.data_dir);
  const auto store = store::OpenStore(options.data_dir, options.store, options.is_shared, *metrics);
  if (!store.ok()) return store.status();
  const auto datasets = data::DatasetStore::Open(options.data_dir / "datasets", options.datasets,
                                                 (*store)->Datasets());
  if (!datasets.ok()) return datasets.status();
  const auto versions =
      serving::VersionStore::Open(options.data_dir / "models", (*store)->Ledger());
  if (!versions.ok()) return versions.status();
  const auto models = serving::ServingTable::Open(
      **versions, **store,
      [engine = options.engine](const std::filesystem::path& folder) {
        return inference::ActionModel::Load(folder, engine);
      },
      {.serves = Predicts(options.role)}, *metrics);
  if (!models.ok()) return models.status();

  rpc::MessageGate message_gate(kMaxWaitingToSend);
  serving::MemoryBudget memory(options.memory_limit, *metrics);
  rpc::MessageGate* const gate = options.memory_limit > 0 ? &message_gate : nullptr;
  const auto room = [&memory](int64_t request_bytes) { return memory.AdmitRequest(request_bytes); };
  // Outlives the calls, which hold shares of it.
  serving::SendMemory send_memory(options.sends, *metrics, &memory);
  serving::BatchScheduler scheduler(options.scheduler, *metrics);
  serving::LocalModelVersions job_versions(**versions, **models);
  const auto supervisor =
      jobs::Supervisor::Start(SupervisorOptionsFor(options), **store, **datasets, job_versions,
                              *metrics, (*store)->Replicas());
  if (!supervisor.ok()) return supervisor.status();
  serving::VersionUploads version_uploads(options.data_dir / "models", **versions, **models,
                                          options.datasets.keep_uploads, options.is_shared);
  jobs::Retention retention(options.jobs.retention, **supervisor, job_versions);
  retention.AlsoSweep([&datasets] {
    return (*datasets)->RemoveAbandonedUploads(std::filesystem::file_time_type::clock::now());
  });
  retention.AlsoSweep([&datasets] { return (*datasets)->AdoptFolders(); });
  retention.AlsoSweep([&version_uploads] {
    return version_uploads.RemoveAbandoned(std::filesystem::file_time_type::clock::now());
  });
  retention.SweepRegularly(kBetweenSweeps);
  // After what its work uses, before the services that give it work.
  rpc::WorkerPool disk(kDiskThreads, kMaxWaitingForDisk);
  serving::MapCache maps(options.maps, *metrics);
  const scene::ScenarioLimits limits{.map_by_id = true};
  std::shared_ptr<serving::Shadow> shadow;
  if (options.shadow.fraction > 0.0 && Predicts(options.role)) {
    shadow = std::make_shared<serving::Shadow>(
        options.shadow, **models, [&scheduler] { return scheduler.HasWaiting(); }, *metrics);
  }
  std::optional<serving::PastAnswers> past_answers;
  if (options.outcome_memory > 0) past_answers.emplace(options.outcome_memory, *metrics);
  rpc::PredictionContext context{.models = **models,
                                 .scheduler = scheduler,
                                 .maps = maps,
                                 .send_memory = send_memory,
                                 .blocking = disk,
                                 .limits = limits,
                                 .access = (*protection)->access(),
                                 .shadow = std::move(shadow),
                                 .past_answers = past_answers ? &*past_answers : nullptr};
  rpc::PredictionService predictions(context);
  security::AccessControl& access = (*protection)->access();
  const rpc::BlockingWork blocking{disk, send_memory};
  rpc::ModelService model_service(**versions, **models, version_uploads, blocking, access);
  rpc::ReplicaService replica_service((*store)->Replicas(), blocking);
  rpc::DatasetService dataset_service(**datasets, **supervisor, blocking, access);
  rpc::TrainingService training_service(**supervisor, blocking, access);
  rpc::TagService tag_service(**supervisor, blocking, access);
  serving::OutcomeMetrics outcome_metrics(*metrics);
  rpc::WorkerPool scoring(kScoringThreads, kMaxWaitingForScores);
  std::unique_ptr<serving::OutcomeCollection> outcomes;
  if (options.outcome_recordings > 0) {
    auto opened = serving::OutcomeCollection::Open(options.data_dir / "outcomes",
                                                   options.outcome_recordings, *metrics);
    if (!opened.ok()) return opened.status();
    outcomes = *std::move(opened);
  }
  rpc::OutcomeService outcome_service(context, outcome_metrics, scoring,
                                      {outcomes.get(), datasets->get()});
  rpc::AdminService admin_service;

  const absl::Status refusal = RefusalOfPredictions(options.role);
  auto server = rpc::Server::Start(
      options.listen,
      {{v1::PredictionService::service_full_name(), &predictions,
        [&scheduler](auto method, auto deadline, const auto& request) {
          return rpc::CheckWait(scheduler, method, deadline, request);
        },
        refusal, room, gate},
       {v1::OutcomeService::service_full_name(), &outcome_service, {}, refusal, room, gate},
       {v1::ModelService::service_full_name(), &model_service, {}, {}, room, gate},
       {v1::DatasetService::service_full_name(), &dataset_service, {}, {}, room, gate},
       {v1::TrainingService::service_full_name(), &training_service, {}, {}, room, gate},
       {v1::TagService::service_full_name(), &tag_service, {}, {}, room, gate},
       {v1::ReplicaService::service_full_name(), &replica_service},
       {v1::AdminService::service_full_name(), &admin_service}},
      (*protection)->access(), *metrics, (*protection)->credentials(), options.limits);
  if (!server.ok()) return server.status();
  BoundLargeRequests((*server)->address().port, options, message_gate, memory);
  const auto pages = ServePages(options, *metrics, **server);
  if (!pages.ok()) return pages.status();
  std::string metrics_address;
  if (*pages != nullptr) {
    metrics_address =
        security::ListenAddress{options.metrics_listen->host, (*pages)->port()}.ToString();
  }
  const std::string address = (*server)->address().ToString();
  if (!options.port_file.empty()) {
    const auto status = WritePortFile(options.port_file, address, metrics_address);
    if (!status.ok()) return status;
  }
  // Whoever collects both streams wants nothing but JSON, and the log has the same.
  if (options.log_format == monitoring::LogFormat::kText) {
    std::cout << "listening grpc=" << address
              << " metrics=" << (metrics_address.empty() ? "none" : metrics_address) << std::endl;
  }
  Log(LogLevel::kInfo, "listening",
      {{"grpc", address}, {"metrics", metrics_address}, {"kernels", kernels::KernelTarget()}});
  manager.TellReady([&server] { return (*server)->IsAlive(); });

  // Health turns to SERVING with the first model; until then calls say what is missing.
  (*models)->OnReadyChange([&](bool ready) { (*server)->SetPredictionsReady(ready); });
  std::optional<jobs::ReplicaReport> report;
  if (jobs::ReplicaRegistry* replicas = (*store)->Replicas()) {
    report.emplace(*replicas, [&] { return DescribeReplica(options, **models, **supervisor); });
  }
  StopLatch stop_following;
  const auto listener = (*store)->ListenForModels([&] { stop_following.Wake(); });
  std::thread loader([&] {
    Serve(options.serve, **models);
    (*models)->LoadAliased();
    while (!stop_following.StoppedWithin(kFollowInterval)) {
      if (options.is_shared) {
        (*models)->Follow();
      } else {
        (*models)->LoadAliased();  // those that could not be loaded
      }
    }
  });
  // Of servers of an earlier release, which know no ledger. The folder may hang, so apart.
  StopLatch stop_adopting;
  std::thread adopter([&] {
    while (options.is_shared && !stop_adopting.StoppedWithin(kFollowInterval)) {
      (*datasets)->AdoptNewFolders().IgnoreError();  // tried again
    }
  });

  const int signal = signals.Wait();
  signals.ExitOnNext();
  manager.TellStopping();
  ExitAfter(options.shutdown_delay + options.shutdown_timeout +
            SupervisorOptionsFor(options).patience + kLastWork);
  Log(LogLevel::kInfo, "shutting down",
      {{"signal", signal == SIGTERM ? "SIGTERM" : "SIGINT"},
       {"delay_seconds", std::chrono::duration<double>(options.shutdown_delay).count()},
       {"timeout_seconds", std::chrono::duration<double>(options.shutdown_timeout).count()}});
  const auto refusing = std::chrono::steady_clock::now() + options.shutdown_delay;
  (*server)->TurnHealth();
  (*supervisor)->Stop();
  report.reset();  // the others no longer count on this server
  // Who balances needs a moment to see that: until then nobody is turned away.
  std::this_thread::sleep_until(refusing);
  predictions.Drain();
  outcome_service.Drain();
  (*server)->Shutdown(std::chrono::system_clock::now() + options.shutdown_timeout);
  (*models)->OnReadyChange(nullptr);
  stop_following.Stop();
  stop_adopting.Stop();
  loader.join();
  adopter.join();
  manager.EndWatch();
  Log(LogLevel::kInfo, "stopped");
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  // Recordings, models and jobs are nobody else's.
  umask(077);
  if (argc > 1 && std::string_view(argv[1]) == "token") {
    return RunTokenCommand(argc - 1, argv + 1, absl::Now());
  }
  if (argc > 1 && std::string_view(argv[1]) == "health") {
    return RunHealthCommand(argc - 1, argv + 1, environ);
  }
  if (argc > 1 && std::string_view(argv[1]) == "repair") {
    return RunRepairCommand(argc - 1, argv + 1, environ);
  }
  if (argc > 1 && std::string_view(argv[1]) == "store") {
    return RunStoreCommand(argc - 1, argv + 1, environ);
  }
  const auto parsed = ParseCommandLine(argc, argv, environ);
  if (const int* status = std::get_if<int>(&parsed)) return *status;
  const auto& options = std::get<ServerOptions>(parsed);
  // gRPC locks all the time, and an Abseil that was built for debugging, as Debian's is, looks for
  // cycles of locks at each.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  monitoring::ConfigureLogging(options.log_format, options.log_level);
  rpc::LogLibraryLines();
  kernels::ChooseKernels(options.kernels);
  // Jobs inherit the choice: maneuver-trainer reads this variable.
  if (kernels::UsesPlainKernels()) setenv("MANEUVER_KERNELS", "plain", /*overwrite=*/1);
  RaiseFileLimit(options.limits.max_connections);
  if (const int most = rpc::AffordableConnections(options.limits.max_connections);
      most < options.limits.max_connections) {
    Log(LogLevel::kWarning,
        "fewer connections are accepted than --max-connections says: this process may not have "
        "more "
        "files open; raise its limit (ulimit -n, LimitNOFILE of systemd)",
        {{"connections", most}});
  }
  ServiceManager manager = ServiceManager::FromEnvironment();
  TerminationSignals signals;
  if (const absl::Status status = Run(options, signals, manager); !status.ok()) {
    Log(LogLevel::kError, "cannot serve", {{"reason", std::string(status.message())}});
    return 1;
  }
  return 0;
}

}  // namespace
}  // namespace maneuver

int main(int argc, char** argv) { return maneuver::Main(argc, argv); }
