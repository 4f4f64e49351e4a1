#include "server/rpc/health.h"

#include <utility>

namespace maneuver::rpc {
namespace {

using grpc::health::v1::HealthCheckRequest;
using grpc::health::v1::HealthCheckResponse;

HealthCheckResponse::ServingStatus StatusOf(std::optional<bool> is_serving) {
  if (!is_serving) return HealthCheckResponse::SERVICE_UNKNOWN;
  return *is_serving ? HealthCheckResponse::SERVING : HealthCheckResponse::NOT_SERVING;
}

}  // namespace

// One call of Watch. A caller who does not read gets only the newest status later. Deletes itself.
class HealthService::WatchCall final : public grpc::ServerWriteReactor<HealthCheckResponse> {
 public:
  WatchCall(HealthService& health, std::string service)
      : service_(std::move(service)), health_(health) {
    const MutexLock lock(health_.mutex_);
    health_.watchers_.insert(this);
    Tell(StatusOf(health_.Find(service_)));
  }

  // Sends `status` if it is news.
  void Tell(HealthCheckResponse::ServingStatus status) {
    const MutexLock lock(mutex_);
    newest_ = status;
    if (!is_writing_) WriteNews();
  }

  void OnWriteDone(bool ok) override {
    const MutexLock lock(mutex_);
    is_writing_ = false;
    if (ok) {
      WriteNews();
    } else {
      End();
    }
  }
  void OnCancel() override {
    const MutexLock lock(mutex_);
    End();
  }
  void OnDone() override {
    {
      const MutexLock lock(health_.mutex_);
      health_.watchers_.erase(this);
    }
    delete this;
  }

  const std::string service_;

 private:
  void WriteNews() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (has_ended_ || newest_ == message_.status()) return;
    message_.set_status(newest_);
    is_writing_ = true;
    StartWrite(&message_);
  }
  void End() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!std::exchange(has_ended_, true)) Finish(grpc::Status::CANCELLED);
  }

  HealthService& health_;
  Mutex mutex_;  // taken after that of health_
  HealthCheckResponse::ServingStatus newest_ ABSL_GUARDED_BY(mutex_) = HealthCheckResponse::UNKNOWN;
  HealthCheckResponse message_ ABSL_GUARDED_BY(mutex_);  // the last that was sent
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
};

void HealthService::Set(std::string_view service, bool is_serving) {
  const MutexLock lock(mutex_);
  serving_.insert_or_assign(std::string(service), is_serving);
  TellWatchers();
}

void HealthService::ShowNotServing() {
  const MutexLock lock(mutex_);
  is_turned_ = true;
  TellWatchers();
}

std::optional<bool> HealthService::IsServing(std::string_view service) const {
  const MutexLock lock(mutex_);
  return Find(service);
}

std::optional<bool> HealthService::Find(std::string_view service) const {
  const auto found = serving_.find(service);
  if (found == serving_.end()) return std::nullopt;
  return found->second && !is_turned_;
}

void HealthService::TellWatchers() {
  for (WatchCall* const watcher : watchers_) watcher->Tell(StatusOf(Find(watcher->service_)));
}

grpc::ServerUnaryReactor* HealthService::Check(grpc::CallbackServerContext* rpc,
                                               const HealthCheckRequest* request,
                                               HealthCheckResponse* response) {
  grpc::ServerUnaryReactor* const reactor = rpc->DefaultReactor();
  const auto is_serving = IsServing(request->service());
  response->set_status(StatusOf(is_serving));
  reactor->Finish(is_serving ? grpc::Status::OK
                             : grpc::Status(grpc::StatusCode::NOT_FOUND, "service name unknown"));
  return reactor;
}

grpc::ServerWriteReactor<HealthCheckResponse>* HealthService::Watch(
    grpc::CallbackServerContext*, const HealthCheckRequest* request) {
  return new WatchCall(*this, request->service());
}

}  // namespace maneuver::rpc
