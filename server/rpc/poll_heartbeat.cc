#include "server/rpc/poll_heartbeat.h"

#include <grpcpp/create_channel.h>

#include <memory>

namespace maneuver::rpc {
namespace {

struct Call {
  grpc::ClientContext context;
  const grpc::Slice nothing;
  const grpc::ByteBuffer request{&nothing, 1};
  grpc::ByteBuffer response;
};

}  // namespace

// A channel without credentials is one on which every call fails at once.
PollHeartbeat::PollHeartbeat(std::chrono::milliseconds interval)
    : interval_(interval),
      nowhere_(grpc::CreateChannel("", nullptr)),
      thread_(&PollHeartbeat::Run, this) {}

PollHeartbeat::~PollHeartbeat() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void PollHeartbeat::AwaitBeats(int count) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return beats_ >= count; });
}

std::chrono::steady_clock::time_point PollHeartbeat::last_beat() const {
  const std::lock_guard lock(mutex_);
  return last_beat_;
}

void PollHeartbeat::Run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    under_way_ = true;
    lock.unlock();
    auto call = std::make_shared<Call>();
    Call& started = *call;
    nowhere_.UnaryCall(&started.context, "/maneuver/heartbeat", {}, &started.request,
                       &started.response,
                       [this, call = std::move(call)](const grpc::Status&) mutable {
                         // A context holds its channel. Whoever gives up the last one waits for
                         // gRPC's threads, of which this is one: that is left to the destructor.
                         call = nullptr;
                         const std::lock_guard beat(mutex_);
                         ++beats_;
                         last_beat_ = std::chrono::steady_clock::now();
                         under_way_ = false;
                         changed_.notify_all();
                       });
    lock.lock();
    changed_.wait_for(lock, interval_, [this] { return stopping_; });
    changed_.wait(lock, [this] { return !under_way_; });
  }
}

}  // namespace maneuver::rpc
