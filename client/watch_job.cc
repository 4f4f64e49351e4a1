#include <algorithm>

#include "absl/time/clock.h"
#include "client/client.h"
#include "client/connection.h"
#include "client/error_details.h"

namespace maneuver::client {
namespace {

// A stream that stands for so long after the server accepted it is a sign of life, also if it
// stays silent. gRPC does not tell one that is refused from one that is accepted, but for its time.
constexpr absl::Duration kStanding = absl::Milliseconds(100);

}  // namespace

absl::StatusOr<v1::Job> Client::WatchJob(const v1::WatchJobRequest& request,
                                         const std::function<bool(const v1::Job&)>& on_event,
                                         const CallOptions& call) {
  const ClientOptions& options = connection_->options;
  const absl::Time deadline = call.timeout ? absl::Now() + *call.timeout : absl::InfiniteFuture();
  v1::WatchJobRequest cursor = request;
  v1::Job job;
  bool seen = false;     // a sign of life
  bool stood = false;    // the last stream, for kStanding
  bool stopped = false;  // by on_event

  // Follows one stream to its end. UNAVAILABLE if it broke before the job ended.
  const auto follow = [&]() -> absl::Status {
    grpc::ClientContext context;
    connection_->Introduce(context);
    if (deadline != absl::InfiniteFuture()) context.set_deadline(absl::ToChronoTime(deadline));
    const Cancellation::Registration registration(call.cancellation,
                                                  [&context] { context.TryCancel(); });
    const auto reader = connection_->training->WatchJob(&context, cursor);
    reader->WaitForInitialMetadata();  // comes at once if the server accepts
    const absl::Time accepted = absl::Now();
    v1::WatchJobResponse event;
    while (reader->Read(&event)) {
      seen = true;
      job = std::move(*event.mutable_job());
      cursor.set_after_sequence(std::max(cursor.after_sequence(), job.progress().sequence()));
      if (on_event && !on_event(job)) {
        stopped = true;
        context.TryCancel();
        break;
      }
    }
    const bool has_stood = absl::Now() - accepted >= kStanding;
    absl::Status status = ToRetriable(reader->Finish(), call.cancellation);
    // A server that refuses says why, which may take it a while; a broken stream says nothing.
    stood = has_stood && ErrorDetailsOf(status).reason.empty();
    seen = seen || stood;
    if (stopped || (status.ok() && HasEnded(job))) return absl::OkStatus();
    if (status.ok()) return absl::UnavailableError("the server stopped telling of the job");
    return status;
  };

  // Before the first sign of life, the call has the retries of any call; afterwards, those of a
  // watch.
  absl::Status status =
      RetryUnavailable(options.retry, deadline, call.cancellation, options.on_retry, [&] {
        absl::Status result = follow();
        return seen && absl::IsUnavailable(result) ? absl::OkStatus() : result;
      });
  if (!status.ok()) return status;
  while (!stopped && !HasEnded(job)) {
    const auto patience = [&] { return std::min(deadline, absl::Now() + options.watch_patience); };
    absl::Time give_up = patience();
    RetryPolicy patient = options.retry;
    patient.max_attempts = 1'000'000;
    const int64_t before = cursor.after_sequence();
    status = RetryUnavailable(patient, give_up, call.cancellation, options.on_retry, [&] {
      absl::Status result = follow();
      // A silent stream that stood earns more patience, but the next one comes after a wait.
      if (stood) give_up = patience();
      const bool has_news = cursor.after_sequence() > before;
      return has_news && absl::IsUnavailable(result) ? absl::OkStatus() : result;
    });
    if (!status.ok()) return status;
  }
  return job;
}

}  // namespace maneuver::client
