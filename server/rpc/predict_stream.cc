#include "server/rpc/predict_stream.h"

#include <grpcpp/impl/codegen/proto_utils.h>

#include <algorithm>
#include <utility>

#include "model/files/utf8.h"
#include "server/errors/error_details.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/prediction_admission.h"
#include "server/rpc/request_outline.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

// Requests read and not yet written back; beyond that the stream is not read, and flow control
// makes the caller wait.
constexpr size_t kMaxInFlight = 64;
constexpr size_t kMaxBytesInFlight = size_t{8} << 20;
// Of answers that are being computed, at most.
constexpr int64_t kMaxExpectedBytes = int64_t{64} << 20;
constexpr size_t kMaxStreamedIdLength = 128;
constexpr char kMethod[] = "/maneuver.v1.PredictionService/StreamPredict";

// Returns whether the parts of a Duration fit each other, as its contract demands.
bool IsValid(const google::protobuf::Duration& duration) {
  constexpr int32_t kNanosOfSecond = 1'000'000'000;
  const bool has_two_signs = (duration.seconds() > 0 && duration.nanos() < 0) ||
                             (duration.seconds() < 0 && duration.nanos() > 0);
  return !has_two_signs && duration.nanos() > -kNanosOfSecond && duration.nanos() < kNanosOfSecond;
}

serving::TimePoint StreamDeadline(const StreamOutline& outline) {
  // Longer than a day is as good as never.
  constexpr int64_t kNever = 24 * 3600;
  if (!outline.timeout || outline.timeout->seconds() >= kNever) return serving::TimePoint::max();
  const int64_t seconds = std::max<int64_t>(outline.timeout->seconds(), 0);
  return std::chrono::steady_clock::now() + std::chrono::seconds(seconds) +
         std::chrono::nanoseconds(outline.timeout->nanos());
}

}  // namespace

PredictionIo PredictIo(const v1::PredictRequest& request, v1::PredictResponse* response) {
  return {.model = &request.model(),
          .scenarios = &request.scenarios(),
          .query = &request.query(),
          .priority = request.priority(),
          .required_action_names = &request.required_action_names(),
          .strict = request.strict(),
          .bytes = static_cast<int64_t>(request.ByteSizeLong()),
          .model_version = response->mutable_model_version(),
          .waypoint_times = response->mutable_waypoint_times(),
          .action_names = NamesIfWanted(request, response),
          .predictions = response->mutable_predictions()};
}

PredictStream* PredictStream::Open(PredictionContext& context, OpenStreams& streams,
                                   grpc::CallbackServerContext* rpc) {
  const std::shared_ptr<PredictStream> stream(new PredictStream(context, streams, rpc));
  const bool may_stay = streams.Add(stream);
  PredictStream* const opened = stream.get();
  opened->admission_ =
      context.access.Watch(kMethod, opened->caller_,
                           [opened](const absl::Status& refusal) { opened->OnRefused(refusal); });
  Step step;
  {
    const MutexLock lock(opened->mutex_);
    if (!may_stay) opened->draining_ = true;
    step = opened->NextStep();
  }
  opened->Take(step);
  return opened;
}

PredictStream::PredictStream(PredictionContext& context, OpenStreams& streams,
                             grpc::CallbackServerContext* rpc)
    : context_(context), streams_(streams), rpc_(rpc), caller_(CredentialsOf(*rpc)) {}

PredictStream::Step PredictStream::NextStep() {
  Step step;
  const size_t unwritten = in_flight_.size() + to_write_.size() + (writing_ != nullptr ? 1 : 0);
  const bool ends_early = draining_ || !refusal_.ok();
  const bool no_more = reads_ended_ || ends_early;
  if (!read_pending_ && !no_more && unwritten < kMaxInFlight && bytes_ < kMaxBytesInFlight &&
      expected_bytes_ < kMaxExpectedBytes) {
    read_pending_ = true;
    reading_ = std::make_shared<Entry>();
    // Begun under the lock: otherwise Drain or OnRefused, which do not wait for a pending read, could
    // finish the stream before.
    StartRead(&reading_->bytes);
  }
  if (writing_ == nullptr && !to_write_.empty()) {
    writing_ = std::move(to_write_.front());
    to_write_.pop_front();
    step.write = &writing_->bytes;
  }
  // A read that an early end leaves pending ends with the stream.
  if (!finished_ && no_more && (!read_pending_ || ends_early) && in_flight_.empty() &&
      to_write_.empty() && writing_ == nullptr) {
    finished_ = true;
    step.finish = cancelled_       ? absl::CancelledError()
                  : !refusal_.ok() ? refusal_
                  : reads_ended_   ? absl::OkStatus()
                                   : ShuttingDown();
  }
  return step;
}

void PredictStream::Take(const Step& step) {
  if (step.write != nullptr) StartWrite(step.write);
  // Nothing follows Finish, as OnDone may come then.
  if (step.finish) Finish(ToGrpcStatus(*step.finish));
}

void PredictStream::OnReadDone(bool ok) {
  std::shared_ptr<Entry> entry;
  {
    const MutexLock lock(mutex_);
    read_pending_ = false;
    entry = std::move(reading_);
    if (!ok) {
      reads_ended_ = true;
    } else if (finished_) {
      ok = false;  // too late: how the stream ended tells the caller that it was not answered
    } else {
      entry->size = entry->bytes.Length();
      bytes_ += entry->size;
      in_flight_.insert(entry);
    }
  }
  if (ok) Begin(std::move(entry));
  Step step;
  {
    const MutexLock lock(mutex_);
    step = NextStep();
  }
  Take(step);
}

void PredictStream::Begin(std::shared_ptr<Entry> entry) {
  if (const absl::Status status = Start(entry); !status.ok()) Answered(std::move(entry), status);
}

absl::Status PredictStream::Start(const std::shared_ptr<Entry>& entry) {
  const auto outline = ReadStreamOutline(entry->bytes);
  if (!outline) return errors::MalformedMessage();
  if (files::IsLongerThan(outline->request_id, kMaxStreamedIdLength)) {
    return errors::InvalidField("request_id", "longer than 128 characters");
  }
  auto& [request, response] = *entry->messages;
  response.set_request_id(outline->request_id);
  if (outline->timeout && !IsValid(*outline->timeout)) {
    return errors::InvalidField(
        "timeout", "seconds and nanos must have one sign, and nanos be less than a second");
  }
  if (absl::Status status = context_.access.Admit(kMethod, caller_); !status.ok()) return status;
  const serving::TimePoint deadline = StreamDeadline(*outline);
  // As for other calls, before the request is parsed.
  absl::Status status =
      context_.scheduler.CheckWait(serving::Priority::kInteractive, outline->targets, deadline);
  if (!status.ok()) return status;
  status = CheckDensity(*v1::StreamPredictRequest::descriptor(), entry->bytes);
  if (!status.ok()) return status;
  // Kept until it is parsed.
  const auto room = context_.send_memory.AdmitRequest(static_cast<int64_t>(entry->size));
  if (!room.ok()) return room.status();
  if (!grpc::SerializationTraits<v1::StreamPredictRequest>::Deserialize(&entry->bytes, &request)
           .ok()) {
    return errors::MalformedMessage();
  }
  status = AdmitTargets(context_.access, caller_, request.request().scenarios());
  if (!status.ok()) return status;
  const PredictionIo io = PredictIo(request.request(), response.mutable_response());
  auto run = PredictionRun::Start(context_, io, deadline, entry->messages,
                                  [this, entry](absl::Status end) { Answered(entry, end); });
  const MutexLock lock(mutex_);
  if (!in_flight_.contains(entry)) {  // answered already
    entry->memory = run->TakeMemory();
    return absl::OkStatus();
  }
  entry->run = std::move(run);
  entry->expected = entry->run->answer_bytes();
  expected_bytes_ += entry->expected;
  if (cancelled_ || !refusal_.ok()) entry->run->Cancel();
  return absl::OkStatus();
}

void PredictStream::Answered(std::shared_ptr<Entry> entry, const absl::Status& status) {
  // This may be the last request of the stream, which gRPC can finish as soon as the lock is released.
  const std::shared_ptr<PredictStream> self = shared_from_this();
  v1::StreamPredictResponse& response = entry->messages->response;
  if (!status.ok()) *response.mutable_error() = errors::ToProto(status);
  grpc::ByteBuffer bytes;
  bool own = false;
  const bool serialised =
      grpc::SerializationTraits<v1::StreamPredictResponse>::Serialize(response, &bytes, &own).ok();
  // What waits for its caller to read it is the answer alone.
  entry->messages.reset();
  std::shared_ptr<PredictionRun> run;  // let go of without the lock
  Step step;
  {
    const MutexLock lock(mutex_);
    in_flight_.erase(entry);
    if (entry->run != nullptr) {
      entry->memory = entry->run->TakeMemory();
      run = std::move(entry->run);
    }
    bytes_ -= entry->size;
    expected_bytes_ -= entry->expected;
    if (serialised && !cancelled_ && refusal_.ok()) {
      entry->bytes.Swap(&bytes);
      entry->size = entry->bytes.Length();
      bytes_ += entry->size;
      to_write_.push_back(std::move(entry));
    }
    step = NextStep();
  }
  Take(step);
}

void PredictStream::OnWriteDone(bool ok) {
  Step step;
  {
    const MutexLock lock(mutex_);
    bytes_ -= writing_->size;
    writing_ = nullptr;
    if (!ok) {
      // The caller has gone.
      reads_ended_ = true;
      to_write_.clear();
    }
    step = NextStep();
  }
  Take(step);
}

void PredictStream::OnCancel() {
  Step step;
  {
    const MutexLock lock(mutex_);
    cancelled_ = true;
    reads_ended_ = true;
    to_write_.clear();
    for (const auto& entry : in_flight_) {
      if (entry->run != nullptr) entry->run->Cancel();
    }
    step = NextStep();
  }
  Take(step);
}

void PredictStream::Drain() {
  Step step;
  {
    const MutexLock lock(mutex_);
    draining_ = true;
    step = NextStep();
  }
  Take(step);
}

void PredictStream::OnRefused(const absl::Status& refusal) {
  Step step;
  bool cut_off = false;
  {
    const MutexLock lock(mutex_);
    const bool again = !refusal_.ok();
    refusal_ = refusal;
    to_write_.clear();
    for (const auto& entry : in_flight_) {
      if (entry->run != nullptr) entry->run->Cancel();
    }
    cut_off = again && writing_ != nullptr;
    if (!cut_off) step = NextStep();
  }
  if (cut_off) rpc_->TryCancel();
  Take(step);
}

void PredictStream::OnDone() {
  admission_.reset();
  streams_.Remove(shared_from_this());
}

}  // namespace maneuver::rpc
