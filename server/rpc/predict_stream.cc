#include "server/rpc/predict_stream.h"

#include <algorithm>
#include <utility>

#include "server/errors/error_details.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

// Requests read and not yet written back; beyond that the stream is not read, and flow control
// makes the caller wait.
constexpr size_t kMaxInFlight = 64;
constexpr size_t kMaxStreamedIdLength = 128;
constexpr char kMethod[] = "/maneuver.v1.PredictionService/StreamPredict";

absl::Status ShuttingDown() {
  return errors::WithReason(
      absl::UnavailableError("the server is shutting down; open another stream"), "SHUTTING_DOWN");
}

}  // namespace

void OpenStreams::Drain() {
  std::set<std::shared_ptr<PredictStream>> streams;
  {
    const std::lock_guard lock(mutex_);
    draining_ = true;
    streams = streams_;
  }
  for (const auto& stream : streams) stream->Drain();
}

bool OpenStreams::Add(const std::shared_ptr<PredictStream>& stream) {
  const std::lock_guard lock(mutex_);
  streams_.insert(stream);
  return !draining_;
}

void OpenStreams::Remove(const std::shared_ptr<PredictStream>& stream) {
  const std::lock_guard lock(mutex_);
  streams_.erase(stream);
}

PredictionIo PredictIo(const v1::PredictRequest& request, v1::PredictResponse* response) {
  return {.model = &request.model(),
          .scenarios = &request.scenarios(),
          .query = &request.query(),
          .priority = request.priority(),
          .bytes = static_cast<int64_t>(request.ByteSizeLong()),
          .model_version = response->mutable_model_version(),
          .waypoint_times = response->mutable_waypoint_times(),
          .predictions = response->mutable_predictions()};
}

PredictStream* PredictStream::Open(PredictionContext& context, OpenStreams& streams,
                                   security::Credentials caller) {
  const std::shared_ptr<PredictStream> stream(
      new PredictStream(context, streams, std::move(caller)));
  if (!streams.Add(stream)) stream->draining_ = true;
  stream->Proceed(std::unique_lock(stream->mutex_));
  return stream.get();
}

PredictStream::PredictStream(PredictionContext& context, OpenStreams& streams,
                             security::Credentials caller)
    : context_(context), streams_(streams), caller_(std::move(caller)) {}

void PredictStream::Proceed(std::unique_lock<std::mutex> lock) {
  v1::StreamPredictRequest* read = nullptr;
  const v1::StreamPredictResponse* write = nullptr;
  bool finish = false;
  const size_t unwritten = in_flight_.size() + to_write_.size() + (writing_ != nullptr ? 1 : 0);
  const bool no_more = reads_ended_ || draining_;
  if (!read_pending_ && !no_more && unwritten < kMaxInFlight) {
    read_pending_ = true;
    reading_ = std::make_shared<Entry>();
    read = &reading_->request;
  }
  if (writing_ == nullptr && !to_write_.empty()) {
    writing_ = std::move(to_write_.front());
    to_write_.pop_front();
    write = &writing_->response;
  }
  // A read that a drain leaves pending ends with the stream.
  if (!finished_ && no_more && (!read_pending_ || draining_) && in_flight_.empty() &&
      to_write_.empty() && writing_ == nullptr) {
    finished_ = finish = true;
  }
  const absl::Status end = cancelled_     ? absl::CancelledError()
                           : reads_ended_ ? absl::OkStatus()
                                          : ShuttingDown();
  lock.unlock();
  // Outside the lock: gRPC may call back at once. Nothing follows Finish, as OnDone may come then.
  if (read != nullptr) StartRead(read);
  if (write != nullptr) StartWrite(write);
  if (finish) Finish(ToGrpcStatus(end));
}

void PredictStream::OnReadDone(bool ok) {
  std::shared_ptr<Entry> entry;
  {
    const std::lock_guard lock(mutex_);
    read_pending_ = false;
    entry = std::move(reading_);
    if (!ok) {
      reads_ended_ = true;
    } else if (finished_) {
      ok = false;  // too late: how the stream ended tells the caller that it was not answered
    } else {
      in_flight_.insert(entry);
    }
  }
  if (ok) Begin(std::move(entry));
  Proceed(std::unique_lock(mutex_));
}

absl::Status PredictStream::Admit(const v1::PredictRequest& request) {
  absl::Status status = context_.access.Admit(kMethod, caller_);
  if (status.ok()) status = AdmitTargets(context_.access, caller_, request.scenarios());
  return status;
}

void PredictStream::Begin(std::shared_ptr<Entry> entry) {
  const v1::StreamPredictRequest& request = entry->request;
  if (request.request_id().size() > kMaxStreamedIdLength) {
    return Answered(std::move(entry),
                    errors::InvalidField("request_id", "longer than 128 characters"));
  }
  entry->response.set_request_id(request.request_id());
  if (const absl::Status status = Admit(request.request()); !status.ok()) {
    return Answered(std::move(entry), status);
  }
  serving::TimePoint deadline = serving::TimePoint::max();
  // Longer than a day is as good as never.
  constexpr int64_t kNever = 24 * 3600;
  if (request.has_timeout() && request.timeout().seconds() < kNever) {
    const int64_t seconds = std::max<int64_t>(request.timeout().seconds(), 0);
    deadline = std::chrono::steady_clock::now() + std::chrono::seconds(seconds) +
               std::chrono::nanoseconds(request.timeout().nanos());
  }
  const PredictionIo io = PredictIo(entry->request.request(), entry->response.mutable_response());
  auto run = PredictionRun::Start(context_, io, deadline, entry,
                                  [this, entry](absl::Status status) { Answered(entry, status); });
  const std::lock_guard lock(mutex_);
  if (!in_flight_.contains(entry)) return;  // answered already
  entry->run = std::move(run);
  if (cancelled_) entry->run->Cancel();
}

void PredictStream::Answered(std::shared_ptr<Entry> entry, const absl::Status& status) {
  if (!status.ok()) *entry->response.mutable_error() = errors::ToProto(status);
  std::unique_lock lock(mutex_);
  in_flight_.erase(entry);
  if (!cancelled_) to_write_.push_back(std::move(entry));
  Proceed(std::move(lock));
}

void PredictStream::OnWriteDone(bool ok) {
  std::unique_lock lock(mutex_);
  writing_ = nullptr;
  if (!ok) {
    // The caller has gone.
    reads_ended_ = true;
    to_write_.clear();
  }
  Proceed(std::move(lock));
}

void PredictStream::OnCancel() {
  std::unique_lock lock(mutex_);
  cancelled_ = true;
  reads_ended_ = true;
  to_write_.clear();
  for (const auto& entry : in_flight_) {
    if (entry->run != nullptr) entry->run->Cancel();
  }
  Proceed(std::move(lock));
}

void PredictStream::Drain() {
  std::unique_lock lock(mutex_);
  draining_ = true;
  Proceed(std::move(lock));
}

void PredictStream::OnDone() { streams_.Remove(shared_from_this()); }

}  // namespace maneuver::rpc
