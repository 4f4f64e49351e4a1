#include "server/rpc/server.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/resource_quota.h>

#include <algorithm>
#include <climits>
#include <cstdint>
#include <future>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/monitoring/listening.h"
#include "server/rpc/call_observer.h"
#include "server/rpc/health.h"
#include "server/rpc/library_logs.h"
#include "server/rpc/message_gate.h"
#include "server/rpc/open_calls.h"
#include "server/rpc/open_connections.h"
#include "server/rpc/reflection.h"
#include "server/rpc/small_messages.h"

namespace maneuver::rpc {
namespace {

constexpr std::chrono::milliseconds kPatience{500};  // with callers who do not read

// Beats come three times a second; under full load some are late.
constexpr std::chrono::seconds kLongestSilence{10};

// A peer with more than so many times --max-streams old calls ignores the limit.
constexpr int kFarTooMany = 2;

constexpr std::string_view kPredictionService = "maneuver.v1.PredictionService";

int Milliseconds(std::chrono::milliseconds time) {
  const int64_t milliseconds = time.count();
  return static_cast<int>(std::min<int64_t>(milliseconds, INT_MAX));
}

void Limit(grpc::ServerBuilder& builder, const ConnectionLimits& limits) {
  builder.SetMaxReceiveMessageSize(limits.max_message_bytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, limits.max_streams);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, Milliseconds(limits.max_idle));
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, Milliseconds(limits.max_age));
  // Who connects and says nothing is not waited for, and who went without a word is found out, also
  // when nothing else was said for long (gRPC would stop to ask after two times).
  const std::chrono::milliseconds keepalive = limits.keepalive;
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, Milliseconds(limits.handshake));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, Milliseconds(keepalive));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, Milliseconds(keepalive / 3));
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.SetResourceQuota(
      grpc::ResourceQuota("connections").Resize(static_cast<size_t>(limits.max_receive_bytes)));
  // A client may do the same.
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10'000);
}

// What gRPC does for each call that nobody here has any use for.
void SpareWork(grpc::ServerBuilder& builder) {
  // A timer for the deadline. Callers give up by themselves, and tell; the scheduler looks at the
  // deadline wherever there is work to spare.
  builder.AddChannelArgument(GRPC_ARG_ENABLE_DEADLINE_CHECKS, 0);
  // Counts for a service that is not offered.
  builder.AddChannelArgument(GRPC_ARG_ENABLE_CHANNELZ, 0);
}

// gRPC checks the size of a message after it was decompressed, which is too late: a few kilobytes
// can become gigabytes. Callers who compress get UNIMPLEMENTED.
void RefuseCompression(grpc::ServerBuilder& builder) {
  for (const grpc_compression_algorithm algorithm : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP}) {
    builder.SetCompressionAlgorithmSupportStatus(algorithm, false);
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<Server>> Server::Start(
    const security::ListenAddress& address, const std::vector<NamedService>& services,
    security::AccessControl& access, monitoring::MetricRegistry& metrics,
    std::shared_ptr<grpc::ServerCredentials> credentials, const ConnectionLimits& limits) {
  if (credentials == nullptr) credentials = grpc::InsecureServerCredentials();
  grpc::ServerBuilder builder;
  // Two servers on one port would share its calls: a taken port is an error instead.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  int port = 0;
  builder.AddListeningPort(address.ToString(), credentials, &port);
  Limit(builder, limits);
  RefuseCompression(builder);
  SpareWork(builder);
  auto gate = std::make_unique<MessageGate>(/*most_waiting=*/0);  // nobody looks: none waits
  std::set<MessageGate*> gates{gate.get()};
  std::vector<std::unique_ptr<GuardedService>> guarded;
  std::vector<std::string> methods;
  for (const NamedService& service : services) {
    auto guard = GuardedService::Create(service, access, *gate);
    if (service.message_gate != nullptr) gates.insert(service.message_gate);
    if (!guard.ok()) return guard.status();
    const auto names = (*guard)->MethodNames();
    methods.insert(methods.end(), names.begin(), names.end());
    builder.RegisterService(guarded.emplace_back(*std::move(guard)).get());
  }
  auto small = std::make_unique<SmallMessages>();
  auto health = std::make_unique<HealthService>();
  std::vector<std::string> names;
  health->Set("", true);
  for (const NamedService& service : services) {
    names.emplace_back(service.name);
    health->Set(service.name, service.refusal.ok() && service.name != kPredictionService);
  }
  const NamedService open{.name = grpc::health::v1::Health::service_full_name(),
                          .service = health.get(),
                          .small_messages = small.get()};
  auto guard = GuardedService::Create(open, access, *gate);
  if (!guard.ok()) return guard.status();
  std::vector<std::string> others = (*guard)->MethodNames();
  for (const std::string& name : ReflectionService::MethodNames()) others.push_back(name);
  builder.RegisterService(guarded.emplace_back(*std::move(guard)).get());
  names.emplace_back(open.name);
  auto reflection = std::make_unique<ReflectionService>(std::move(names), *small);
  builder.RegisterService(reflection.get());
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
  auto calls = std::make_unique<OpenCalls>();
  interceptors.push_back(ObserveCalls(metrics, methods, others, *calls));
  builder.experimental().SetInterceptorCreators(std::move(interceptors));

  std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (server == nullptr || port == 0) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", address.ToString(), ": ",
                                               monitoring::WhyNotListening(address.ToString())));
  }
  small->Watch([bytes = ReceivedByPeer(port)](const std::string& peer) mutable {
    return bytes.Bytes(peer);
  });
  const bool refuses_predictions = std::ranges::any_of(services, [](const NamedService& service) {
    return service.name == kPredictionService && !service.refusal.ok();
  });
  std::unique_ptr<Server> started(
      new Server(std::move(server), {address.host, port}, refuses_predictions, std::move(gate),
                 std::move(calls), std::move(small), std::move(health), std::move(guarded),
                 std::move(reflection), std::move(credentials)));
  started->KeepLimits(limits, metrics, std::move(gates));
  return started;
}

void Server::KeepLimits(const ConnectionLimits& limits, monitoring::MetricRegistry& metrics,
                        std::set<MessageGate*> gates) {
  monitoring::Counter& refused =
      metrics.AddCounter("maneuver_refused_connections_total",
                         "Connections closed because there were more than --max-connections.");
  monitoring::Counter& crowded =
      metrics.AddCounter("maneuver_crowded_connections_total",
                         "Connections closed because their peers ignored --max-streams.");
  limiter_ = std::thread([this, limits, &refused, &crowded, gates = std::move(gates)]() {
    ConnectionLimit connections(address_.port, AffordableConnections(limits.max_connections));
    while (!stop_.StoppedWithin(std::chrono::milliseconds(250))) {
      refused.Increment(connections.Enforce());
      crowded.Increment(
          CutOffConnections(address_.port, calls_->FindCrowded(kFarTooMany * limits.max_streams)));
      const auto now = std::chrono::steady_clock::now();
      for (MessageGate* const gate : gates) gate->StopLate(now, limits.request);
    }
  });
}

Server::Server(std::unique_ptr<grpc::Server> server, security::ListenAddress address,
               bool refuses_predictions, std::unique_ptr<MessageGate> gate,
               std::unique_ptr<OpenCalls> calls, std::unique_ptr<SmallMessages> small,
               std::unique_ptr<HealthService> health,
               std::vector<std::unique_ptr<GuardedService>> services,
               std::unique_ptr<ReflectionService> reflection,
               std::shared_ptr<grpc::ServerCredentials> credentials)
    : address_(std::move(address)),
      refuses_predictions_(refuses_predictions),
      gate_(std::move(gate)),
      calls_(std::move(calls)),
      small_(std::move(small)),
      health_(std::move(health)),
      services_(std::move(services)),
      reflection_(std::move(reflection)),
      credentials_(std::move(credentials)),
      server_(std::move(server)) {}

Server::~Server() {
  stop_.Stop();
  limiter_.join();
  server_->Shutdown(std::chrono::system_clock::now());
}

void Server::SetPredictionsReady(bool ready) {
  health_->Set(kPredictionService, ready && !refuses_predictions_);
}

void Server::ShowNotServing() { health_->ShowNotServing(); }

std::optional<bool> Server::IsServing(std::string_view service) const {
  return health_->IsServing(service);
}

bool Server::IsAlive() const {
  return std::chrono::steady_clock::now() - heartbeat_.last_beat() < kLongestSilence &&
         !LostListener();
}

void Server::Shutdown(std::chrono::system_clock::time_point deadline) {
  // gRPC waits for what it has begun to write, until the keepalive gives a caller up who does not
  // read.
  std::promise<void> ended;
  std::thread cutter([this, deadline, end = ended.get_future()] {
    auto next = deadline + kPatience;
    while (end.wait_until(next) == std::future_status::timeout) {
      CutOffConnections(address_.port);
      next = std::chrono::system_clock::now() + kPatience;
    }
  });
  server_->Shutdown(deadline);
  ended.set_value();
  cutter.join();
}

}  // namespace maneuver::rpc
