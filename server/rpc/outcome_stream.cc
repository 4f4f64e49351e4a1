#include "server/rpc/outcome_stream.h"

#include <grpcpp/impl/codegen/proto_utils.h>

#include <utility>

#include "maneuver/v1/outcome_service.pb.h"
#include "server/errors/error_details.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/request_outline.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

constexpr char kStreamMethod[] = "/maneuver.v1.OutcomeService/StreamOutcomes";

// The answer to a report that is not scored, with its name.
v1::StreamOutcomesResponse ErrorAnswer(const std::string& request_id, const absl::Status& status) {
  v1::StreamOutcomesResponse answer;
  answer.set_request_id(request_id);
  *answer.mutable_error() = errors::ToProto(status);
  return answer;
}

}  // namespace

OutcomeStream* OutcomeStream::Open(OutcomeScorer& scorer, OpenStreams& streams,
                                   grpc::CallbackServerContext* rpc) {
  const std::shared_ptr<OutcomeStream> stream(new OutcomeStream(scorer, streams, rpc));
  OutcomeStream* const opened = stream.get();
  if (!streams.Add(stream)) opened->Drain();
  opened->admission_ =
      scorer.access().Watch(kStreamMethod, opened->caller_,
                            [opened](const absl::Status& refusal) { opened->OnRefused(refusal); });
  opened->ReadOn();
  return opened;
}

OutcomeStream::OutcomeStream(OutcomeScorer& scorer, OpenStreams& streams,
                             grpc::CallbackServerContext* rpc)
    : scorer_(scorer), streams_(streams), rpc_(rpc), caller_(CredentialsOf(*rpc)) {}

void OutcomeStream::ReadOn() {
  absl::Status end;
  {
    // Drain and OnRefused end a read. The lock makes them wait until it has begun.
    const MutexLock lock(mutex_);
    end = early_end_;
    if (end.ok()) {
      reading_ = true;
      StartRead(&message_);
    }
  }
  if (!end.ok()) End(end);
}

void OutcomeStream::OnReadDone(bool ok) {
  if (!reading_.exchange(false)) return;  // the stream has ended meanwhile
  if (!ok) return End(rpc_->IsCancelled() ? absl::CancelledError() : absl::OkStatus());
  memory_ = scorer_.Reserve(static_cast<int64_t>(message_.Length()));
  const auto step = [this] { ScoreReport(); };
  if (memory_ == nullptr) {
    Answer(ErrorAnswer(ReportId(), TooManyWait()));
  } else if (has_place_) {
    scorer_.pool().Continue(step);
  } else if (!scorer_.pool().Post(step)) {
    Answer(ErrorAnswer(ReportId(), TooManyWait()));
  }
}

std::string OutcomeStream::ReportId() const {
  return ReadReportId(message_, 4 * OutcomeScorer::kMostRequestIdLength);
}

absl::Status OutcomeStream::ParseReport(v1::StreamOutcomesRequest* request) {
  absl::Status status = CheckDensity(*v1::StreamOutcomesRequest::descriptor(), message_);
  if (!status.ok()) return status;
  // Kept until it is parsed.
  const auto room = scorer_.send_memory().AdmitRequest(static_cast<int64_t>(message_.Length()));
  if (!room.ok()) return room.status();
  if (!grpc::SerializationTraits<v1::StreamOutcomesRequest>::Deserialize(&message_, request).ok()) {
    return errors::MalformedMessage();
  }
  return absl::OkStatus();
}

void OutcomeStream::ScoreReport() {
  has_place_ = true;
  const std::string request_id = ReportId();
  v1::StreamOutcomesResponse answer;
  {
    v1::StreamOutcomesRequest request;
    absl::Status status = scorer_.access().Admit(kStreamMethod, caller_);
    if (status.ok()) status = scorer_.send_memory().CheckRoom();
    if (status.ok()) status = ParseReport(&request);
    if (status.ok()) status = scorer_.Admit(caller_, request.report());
    if (status.ok()) status = scorer_.Score(*rpc_, request.report(), answer.mutable_response());
    answer.set_request_id(request_id);
    if (!status.ok()) answer = ErrorAnswer(request_id, status);
  }
  Answer(answer);
}

void OutcomeStream::Answer(const v1::StreamOutcomesResponse& answer) {
  message_.Clear();
  memory_ = nullptr;
  bool own = false;
  const bool written =
      grpc::SerializationTraits<v1::StreamOutcomesResponse>::Serialize(answer, &message_, &own)
          .ok();
  absl::Status end;
  {
    const MutexLock lock(mutex_);
    // A caller that is refused gets no answer any more; one whose server stops gets this last one.
    if (refused_) end = early_end_;
    if (!written) end = absl::InternalError("the answer cannot be written");
    writing_ = end.ok();
  }
  if (end.ok()) {
    share_ = scorer_.send_memory().Take(static_cast<int64_t>(message_.Length()));
    StartWrite(&message_);
  } else {
    End(end);
  }
}

void OutcomeStream::OnWriteDone(bool ok) {
  {
    const MutexLock lock(mutex_);
    writing_ = false;
  }
  message_.Clear();
  share_ = {};
  if (ok) {
    ReadOn();
  } else {
    End(absl::CancelledError("the caller has gone"));
  }
}

void OutcomeStream::Drain() {
  {
    const MutexLock lock(mutex_);
    if (early_end_.ok()) early_end_ = ShuttingDown();
    if (!reading_.exchange(false)) return;  // the step in progress sees it
  }
  // The read that is left pending ends with the stream.
  End(ShuttingDown());
}

void OutcomeStream::OnRefused(const absl::Status& refusal) {
  {
    const MutexLock lock(mutex_);
    early_end_ = refusal;
    if (std::exchange(refused_, true) && writing_) rpc_->TryCancel();
    if (!reading_.exchange(false)) return;
  }
  End(refusal);
}

void OutcomeStream::End(const absl::Status& status) { Finish(ToGrpcStatus(status)); }

void OutcomeStream::OnDone() {
  admission_.reset();
  streams_.Remove(shared_from_this());
}

}  // namespace maneuver::rpc
