#include "server/serving/send_memory.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

// A guess: how fast callers take what is theirs is not known.
constexpr std::chrono::milliseconds kRetryDelay{100};

monitoring::Counter& RefusalCounter(monitoring::MetricRegistry& metrics, const char* reason) {
  return metrics.AddCounter("maneuver_send_memory_refusals_total",
                            "Calls refused for the size of their answer, by reason: too_large (for "
                            "one answer) or full (of answers that callers have not taken).",
                            {{"reason", reason}});
}

}  // namespace

SendMemory::Share::Share(Share&& other) noexcept
    : memory_(std::exchange(other.memory_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

SendMemory::Share& SendMemory::Share::operator=(Share&& other) noexcept {
  std::swap(memory_, other.memory_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

SendMemory::Share::~Share() { ShrinkTo(0); }

void SendMemory::Share::ShrinkTo(int64_t bytes) {
  if (memory_ == nullptr || bytes >= bytes_) return;
  memory_->Release(bytes_ - bytes);
  bytes_ = bytes;
}

SendMemory::SendMemory(const SendLimits& limits, monitoring::MetricRegistry& metrics,
                       MemoryBudget* budget)
    : limits_(limits),
      budget_(budget),
      used_gauge_(metrics.AddGauge("maneuver_send_memory_bytes",
                                   "Bytes of answers that are being computed or that callers have "
                                   "not taken yet; the most that they may have until then.")),
      too_large_(RefusalCounter(metrics, "too_large")),
      full_(RefusalCounter(metrics, "full")) {
  metrics.AddGauge("maneuver_send_memory_limit_bytes", "Most bytes of maneuver_send_memory_bytes.")
      .Set(static_cast<double>(limits_.max_send_memory));
}

absl::StatusOr<SendMemory::Share> SendMemory::Reserve(int64_t bytes, int64_t targets) {
  if (budget_ != nullptr) {
    if (absl::Status status = budget_->Admit(); !status.ok()) return status;
  }
  if (bytes > limits_.max_response_bytes) {
    const int64_t fitting = limits_.max_response_bytes / std::max<int64_t>(1, bytes / targets);
    return RefuseAsTooLarge(absl::StrCat(
        "the answer could have ", bytes, " bytes, and one answer may have ",
        limits_.max_response_bytes,
        "; set omit_sigma_trajectories, ask for fewer actions (top_k), or split the request "
        "into requests of at most ",
        std::max<int64_t>(1, fitting), " targets"));
  }
  return TakeIfRoom(bytes);
}

absl::StatusOr<SendMemory::Share> SendMemory::TakeIfRoom(int64_t bytes) {
  if (bytes > limits_.max_response_bytes) {
    return RefuseAsTooLarge(absl::StrCat(
        "the answer has ", bytes, " bytes, and one answer may have ", limits_.max_response_bytes,
        " (--max-response-bytes); ask for a smaller page (page_size)"));
  }
  {
    const MutexLock lock(mutex_);
    if (bytes == 0 || used_ + bytes <= limits_.max_send_memory) {
      used_ += bytes;
      used_gauge_.Set(static_cast<double>(used_));
      return Share(this, bytes);
    }
  }
  return RefuseAsFull();
}

absl::Status SendMemory::CheckRoom() {
  {
    const MutexLock lock(mutex_);
    if (used_ < limits_.max_send_memory) return absl::OkStatus();
  }
  return RefuseAsFull();
}

SendMemory::Share SendMemory::Take(int64_t bytes) {
  const MutexLock lock(mutex_);
  used_ += bytes;
  used_gauge_.Set(static_cast<double>(used_));
  return Share(this, bytes);
}

absl::Status SendMemory::RefuseAsTooLarge(const std::string& message) {
  too_large_.Increment();
  return errors::WithReason(absl::ResourceExhaustedError(message), "RESPONSE_TOO_LARGE");
}

absl::Status SendMemory::RefuseAsFull() {
  full_.Increment();
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError(
                             "answers that their callers have not taken yet fill the server's "
                             "memory for them; try again a little later, or ask for less at once"),
                         "SEND_MEMORY_FULL"),
      kRetryDelay);
}

absl::StatusOr<std::shared_ptr<const void>> SendMemory::AdmitRequest(int64_t bytes) {
  if (budget_ == nullptr) return std::shared_ptr<const void>();
  return budget_->AdmitRequest(bytes);
}

void SendMemory::Release(int64_t bytes) {
  const MutexLock lock(mutex_);
  used_ -= bytes;
  used_gauge_.Set(static_cast<double>(used_));
}

}  // namespace maneuver::serving
