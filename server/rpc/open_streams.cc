#include "server/rpc/open_streams.h"

#include "server/errors/error_details.h"

namespace maneuver::rpc {

absl::Status ShuttingDown() {
  return errors::WithReason(
      absl::UnavailableError("the server is shutting down; open another stream"), "SHUTTING_DOWN");
}

void OpenStreams::Drain() {
  std::set<std::shared_ptr<OpenStream>> streams;
  {
    const MutexLock lock(mutex_);
    draining_ = true;
    streams = streams_;
  }
  for (const auto& stream : streams) stream->Drain();
}

bool OpenStreams::Add(const std::shared_ptr<OpenStream>& stream) {
  const MutexLock lock(mutex_);
  streams_.insert(stream);
  return !draining_;
}

void OpenStreams::Remove(const std::shared_ptr<OpenStream>& stream) {
  const MutexLock lock(mutex_);
  streams_.erase(stream);
}

}  // namespace maneuver::rpc
