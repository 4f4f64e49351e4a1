// Limits the memory of answers, each and all together, from the admission of their calls until
// their callers have read them. A caller that asks for much and reads slowly therefore cannot fill
// the memory.

#ifndef MANEUVER_SERVER_SERVING_SEND_MEMORY_H_
#define MANEUVER_SERVER_SERVING_SEND_MEMORY_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "server/monitoring/metrics.h"
#include "server/serving/memory_budget.h"

namespace maneuver::serving {

// Bytes as they go over the wire. While an answer is written it takes up to three times as many.
struct SendLimits {
  int64_t max_response_bytes = int64_t{256} << 20;  // of one answer
  int64_t max_send_memory = int64_t{1} << 30;       // of all
};

// Safe to use from any thread. Outlives its shares.
class SendMemory {
 public:
  // A reserved part of the memory. The destructor releases it.
  class Share {
   public:
    Share() = default;
    Share(Share&& other) noexcept;
    Share& operator=(Share&& other) noexcept;
    ~Share();

    int64_t bytes() const { return bytes_; }
    // Releases all but `bytes`, once the answer is known to be smaller.
    void ShrinkTo(int64_t bytes);

   private:
    friend class SendMemory;
    Share(SendMemory* memory, int64_t bytes) : memory_(memory), bytes_(bytes) {}

    SendMemory* memory_ = nullptr;
    int64_t bytes_ = 0;
  };

  //   budget: of the whole process, is asked first; must outlive this object; nullptr: none
  SendMemory(const SendLimits& limits, monitoring::MetricRegistry& metrics,
             MemoryBudget* budget = nullptr);

  // Reserves memory for an answer of at most `bytes`, about `targets` > 0 targets.
  // RESOURCE_EXHAUSTED:
  //   MEMORY_FULL: the whole process has too little left; has a retry delay.
  //   RESPONSE_TOO_LARGE: more than max_response_bytes; the message says what to request instead.
  //   SEND_MEMORY_FULL: answers that callers have not read leave no room; has a retry delay.
  absl::StatusOr<Share> Reserve(int64_t bytes, int64_t targets);

  // The following are for answers whose size is known only once they are there.

  // Call it before the work for an answer: returns SEND_MEMORY_FULL, as Reserve does, while unread
  // answers fill the memory.
  absl::Status CheckRoom();
  // Counts an answer. RESOURCE_EXHAUSTED, as Reserve: RESPONSE_TOO_LARGE, SEND_MEMORY_FULL.
  absl::StatusOr<Share> TakeIfRoom(int64_t bytes);
  // Counts an answer even if it does not fit.
  Share Take(int64_t bytes);

  // MemoryBudget::AdmitRequest of the budget; OK without one.
  absl::StatusOr<std::shared_ptr<const void>> AdmitRequest(int64_t bytes);

 private:
  absl::Status RefuseAsFull();
  absl::Status RefuseAsTooLarge(const std::string& message);
  void Release(int64_t bytes);

  const SendLimits limits_;
  MemoryBudget* const budget_;
  monitoring::Gauge& used_gauge_;
  monitoring::Counter& too_large_;
  monitoring::Counter& full_;
  Mutex mutex_;
  int64_t used_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SEND_MEMORY_H_
