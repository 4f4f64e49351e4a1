// Exchanges numbers among the ranks of a training. Its .cc is the only source that sees c10d.

#ifndef MANEUVER_MODEL_LEARNING_RANKS_RANK_GROUP_H_
#define MANEUVER_MODEL_LEARNING_RANKS_RANK_GROUP_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/learning/ranks/rank_place.h"
#include "model/learning/tensors.h"
#include "rank_note.pb.h"

namespace maneuver::learning {

// The ranks of one training, as one of them sees them: over c10d's TCPStore and Gloo, whose traffic
// is not encrypted. All ranks call the same functions in the same order. A group of one exchanges
// nothing. Not thread-safe, except for StopRequested and HeardStop.
//
// Every function that exchanges something fails with UNAVAILABLE and kRankLost
// (training_failure.h) if another rank ends, or does not answer within the time-out. If this rank
// was asked to stop, the error is CANCELLED instead. After an error the group cannot be used any
// more.
class RankGroup {
 public:
  // Makes a group of one rank.
  explicit RankGroup(std::function<bool()> stopped);
  ~RankGroup();
  RankGroup(const RankGroup&) = delete;
  RankGroup& operator=(const RankGroup&) = delete;

  // Joins the ranks at the store of `place`; waits for all of them, at most for `join_timeout`.
  //   timeout: the longest that a rank waits for another one, later on
  //   stopped: whether this process was asked to stop; called from several threads
  static absl::StatusOr<std::unique_ptr<RankGroup>> Join(const RankPlace& place,
                                                         std::chrono::milliseconds timeout,
                                                         std::chrono::milliseconds join_timeout,
                                                         std::function<bool()> stopped);

  int rank() const { return rank_; }
  int size() const { return size_; }

  // Returns whether this rank was asked to stop, or HeardStop.
  bool StopRequested() const { return heard_stop_ || stopped_(); }
  // Returns true once some rank was asked to stop before an Exchange, or once a rank is lost. All
  // ranks learn it from the same Exchange.
  bool HeardStop() const { return heard_stop_; }

  // Replaces `bytes` of each rank by those of rank 0.
  absl::Status Broadcast(std::string* bytes);
  // Returns the notes of all ranks, in their order. A note has at most some 3 KiB.
  absl::StatusOr<std::vector<RankNote>> Exchange(const RankNote& note);
  // Adds up the ranks' values and leaves the sum on each rank. The additions form a tree of pairs:
  // (0 + 1) + (2 + 3). So four ranks get the same bits as eight, if each of the four adds up the
  // values of two of the eight first.
  //   values: [N] floats, N a multiple of kSumMultiple, the same on all ranks
  absl::Status SumByTree(at::Tensor* values);
  static constexpr int64_t kSumMultiple = 1024;

  // Runs `work` on rank 0 alone; see Apart.
  absl::Status OnRankZero(const std::function<absl::Status()>& work);
  // Runs `work` on each rank, without a limit on its time. Meanwhile the ranks tell each other that
  // they are alive. Returns once all are done: OK, or the error of the lowest rank that failed.
  // `work` must call StopRequested now and then, and must exchange nothing. An exception of `work`
  // is thrown on here; the other ranks get INTERNAL.
  absl::Status Apart(const std::function<absl::Status()>& work);

 private:
  class Connection;  // of c10d

  // Tells the other ranks that this one is alive until `work` is set and they are done too. Returns
  // the error of the lowest rank that failed.
  absl::Status Assure(std::future<absl::Status> work);
  // Runs an exchange. Turns an exception of c10d into an error.
  absl::Status Guard(const std::function<void()>& exchange);

  int rank_ = 0;
  int size_ = 1;
  std::chrono::milliseconds timeout_{0};
  const std::function<bool()> stopped_;
  std::atomic<bool> heard_stop_ = false;
  absl::Status lost_;  // the error of the first exchange that failed
  std::unique_ptr<Connection> connection_;
};

// Writes an error into a note; OK changes nothing.
void WriteStatus(const absl::Status& status, RankNote* note);
// Returns the first error in the notes of all ranks: of the lowest rank that has one.
absl::Status FirstError(const std::vector<RankNote>& notes);

// Serves the store that ranks on this machine meet at, for their launcher.
class RankStore {
 public:
  // Serves the store on a free port of 127.0.0.1. UNAVAILABLE if that fails.
  static absl::StatusOr<std::unique_ptr<RankStore>> Serve();
  virtual ~RankStore() = default;
  virtual int port() const = 0;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RANKS_RANK_GROUP_H_
