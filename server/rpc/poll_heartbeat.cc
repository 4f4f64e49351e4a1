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
    const MutexLock lock(mutex_);
    stopping_ = true;
  }
  changed_.NotifyAll();
  thread_.join();
}

void PollHeartbeat::AwaitBeats(int count) {
  const MutexLock lock(mutex_);
  while (beats_ < count) changed_.Wait(mutex_);
}

std::chrono::steady_clock::time_point PollHeartbeat::last_beat() const {
  const MutexLock lock(mutex_);
  return last_beat_;
}

void PollHeartbeat::Run() {
  MutexLock lock(mutex_);
  while (!stopping_) {
    under_way_ = true;
    lock.Unlock();
    auto call = std::make_shared<Call>();
    Call& started = *call;
    nowhere_.UnaryCall(&started.context, "/maneuver/heartbeat", {}, &started.request,
                       &started.response,
                       [this, call = std::move(call)](const grpc::Status&) mutable {
                         // A context holds its channel. Whoever gives up the last one waits for
                         // gRPC's threads, of which this is one: that is left to the destructor.
                         call = nullptr;
                         const MutexLock beat(mutex_);
                         ++beats_;
                         last_beat_ = std::chrono::steady_clock::now();
                         under_way_ = false;
                         changed_.NotifyAll();
                       });
    lock.Lock();
    const auto next = std::chrono::steady_clock::now() + interval_;
    while (!stopping_ && changed_.WaitUntil(mutex_, next)) {
    }
    while (under_way_) changed_.Wait(mutex_);
  }
}

}  // namespace maneuver::rpc
