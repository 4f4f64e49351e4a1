// maneuverd: the prediction server.

#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "locks/stop_latch.h"
#include "model/files/durable_file.h"
#include "model/kernels/kernel_choice.h"
#include "model/machine/openmp_spinning.h"
#include "server/jobs/replica_report.h"
#include "server/jobs/supervisor.h"
#include "server/maneuverd/health_command.h"
#include "server/maneuverd/health_pages.h"
#include "server/maneuverd/idle_memory.h"
#include "server/maneuverd/job_work.h"
#include "server/maneuverd/options.h"
#include "server/maneuverd/protection.h"
#include "server/maneuverd/repair_command.h"
#include "server/maneuverd/service_manager.h"
#include "server/maneuverd/services.h"
#include "server/maneuverd/storage.h"
#include "server/maneuverd/store_command.h"
#include "server/maneuverd/termination.h"
#include "server/maneuverd/token_command.h"
#include "server/monitoring/http_pages.h"
#include "server/monitoring/logging.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/library_logs.h"
#include "server/rpc/open_connections.h"
#include "server/rpc/server.h"
#include "server/security/access_control.h"
#include "server/security/listen_address.h"
#include "server/security/resource_name.h"
#include "server/serving/serving_table.h"
#include "server/store/store.h"

namespace maneuver {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

constexpr std::chrono::seconds kFollowInterval{1};  // what other servers decide
// How long work on the disk may take to end after the last call and the last trainer.
constexpr std::chrono::seconds kLastWork{10};

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

// Lets this process have as many files open as so many connections need, if it may.
void RaiseFileLimit(int connections) {
  constexpr rlim_t kOthers = 4096;
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  const rlim_t wanted = 2 * static_cast<rlim_t>(connections) + kOthers;
  files.rlim_cur = std::min(files.rlim_max, std::max(files.rlim_cur, wanted));
  setrlimit(RLIMIT_NOFILE, &files);
}

// Says where the server listens: in the port file, on standard output and in the log.
absl::Status Announce(const ServerOptions& options, const rpc::Server& server,
                      const monitoring::HttpPages* pages) {
  const std::string address = server.address().ToString();
  std::string metrics_address;
  if (pages != nullptr) {
    metrics_address =
        security::ListenAddress{options.metrics_listen->host, pages->port()}.ToString();
  }
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
  return absl::OkStatus();
}

// Loads the models that are served and, of a store that is shared, follows what other servers change.
class Follower {
 public:
  // Begins on threads of its own. Both arguments must outlive it.
  Follower(const ServerOptions& options, Storage& storage)
      : listener_(storage.store->ListenForModels([this] { stop_loading_.Wake(); })),
        loader_([this, &options, &models = *storage.models] {
          Serve(options.serve, models);
          models.LoadAliased();
          while (!stop_loading_.StoppedWithin(kFollowInterval)) {
            if (options.is_shared) {
              models.Follow();
            } else {
              models.LoadAliased();  // those that could not be loaded
            }
          }
        }) {
    if (!options.is_shared) return;
    // Datasets of servers of an earlier release, which know no ledger. The folder may hang, so apart.
    adopter_ = std::thread([this, &datasets = *storage.datasets] {
      while (!stop_adopting_.StoppedWithin(kFollowInterval)) {
        datasets.AdoptNewFolders().IgnoreError();  // tried again
      }
    });
  }

  // Waits for what is being loaded.
  ~Follower() {
    stop_loading_.Stop();
    stop_adopting_.Stop();
    loader_.join();
    if (adopter_.joinable()) adopter_.join();
  }
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

 private:
  StopLatch stop_loading_;
  StopLatch stop_adopting_;
  const std::unique_ptr<store::StoreListener> listener_;
  std::thread loader_;
  std::thread adopter_;
};

void LogShutdown(const ServerOptions& options, int signal) {
  Log(LogLevel::kInfo, "shutting down",
      {{"signal", signal == SIGTERM ? "SIGTERM" : "SIGINT"},
       {"delay_seconds", std::chrono::duration<double>(options.shutdown_delay).count()},
       {"timeout_seconds", std::chrono::duration<double>(options.shutdown_timeout).count()}});
}

// Serves until a signal comes.
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
  security::AccessControl& access = (*protection)->access();
  auto storage = OpenStorage(options, *metrics);
  if (!storage.ok()) return storage.status();
  serving::ServingTable& models = *storage->models;
  const auto job_work = JobWork::Start(options, *storage, *metrics);
  if (!job_work.ok()) return job_work.status();
  jobs::Supervisor& supervisor = (*job_work)->supervisor();
  Services services(options, *storage, **job_work, access, *metrics);
  const auto started = rpc::Server::Start(options.listen, services.ForServer(), access, *metrics,
                                          (*protection)->credentials(), options.limits);
  if (!started.ok()) return started.status();
  rpc::Server& server = **started;
  services.BoundLargeRequests(server.address().port);
  const auto pages = ServePages(options, *metrics, server);
  if (!pages.ok()) return pages.status();
  const absl::Status announced = Announce(options, server, pages->get());
  if (!announced.ok()) return announced;
  manager.TellReady([&server] { return server.IsAlive(); });

  // Health turns to SERVING with the first model; until then calls say what is missing.
  models.OnReadyChange([&server](bool ready) { server.SetPredictionsReady(ready); });
  std::optional<jobs::ReplicaReport> report;
  if (jobs::ReplicaRegistry* replicas = storage->store->Replicas()) {
    report.emplace(*replicas, [&] { return DescribeReplica(options, models, supervisor); });
  }
  {
    const Follower follower(options, *storage);
    const int signal = signals.Wait();
    signals.ExitOnNext();
    manager.TellStopping();
    ExitAfter(options.shutdown_delay + options.shutdown_timeout + PatienceWithTrainers(options) +
              kLastWork);
    LogShutdown(options, signal);
    const auto refusing = std::chrono::steady_clock::now() + options.shutdown_delay;
    server.ShowNotServing();
    supervisor.Stop();
    report.reset();  // the others no longer count on this server
    // Who balances needs a moment to see that: until then nobody is turned away.
    std::this_thread::sleep_until(refusing);
    services.Drain();
    server.Shutdown(std::chrono::system_clock::now() + options.shutdown_timeout);
    models.OnReadyChange(nullptr);
  }  // waits for what is being loaded
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
  // Else each job's program would start itself once more, which takes most of a second.
  machine::ShortenOpenMpSpinning();
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
