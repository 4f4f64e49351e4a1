// Compares the answers of a candidate version, the one that a model's alias `candidate` points to,
// with the answers that callers got. For a fraction of the answered requests it computes the
// candidate's answer and measures how far the two differ (model/evaluation/answer_difference.h).
//
// Callers never notice. A request comes here once its answer is complete. What does not fit into
// the shadow's queue is dropped and counted. One thread of the lowest priority does the work. It
// runs only while no target waits for the scheduler's workers, and rests for most of the time.

#ifndef MANEUVER_SERVER_SERVING_SHADOW_H_
#define MANEUVER_SERVER_SERVING_SHADOW_H_

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "server/monitoring/metrics.h"
#include "server/serving/prediction_call.h"
#include "server/serving/serving_table.h"
#include "server/serving/shadow_comparison.h"

namespace maneuver::serving {

struct ShadowOptions {
  double fraction = 0.0;  // of the requests, 0 to 1
  // Limits of the queue, including the request in progress: targets, and bytes of the requests that
  // they keep in memory.
  int max_targets = 64;
  int64_t max_bytes = int64_t{64} << 20;
  // The largest share of time that the thread works, in (0, 1].
  double max_share = 0.25;
  // Metrics are kept for each model, up to this many models.
  int max_models = 32;
  // How many times Offer tries to take the queue's lock before it drops the request.
  int max_tries = 16;
  // The time; replaced in tests.
  std::function<TimePoint()> now = [] { return std::chrono::steady_clock::now(); };
};

// Safe to use from any thread.
class Shadow {
 public:
  // Starts the thread.
  //   models, metrics: must outlive the shadow.
  //   busy: whether the server has more urgent work. Called very often, so it should take no lock.
  Shadow(const ShadowOptions& options, ServingTable& models, std::function<bool()> busy,
         monitoring::MetricRegistry& metrics);
  // Waits for the step in progress, then ends.
  ~Shadow();
  Shadow(const Shadow&) = delete;
  Shadow& operator=(const Shadow&) = delete;

  // Returns whether a request for these targets belongs to the sampled fraction. A hash of its
  // scenarios' names and times, its targets and their positions decides, so the same request gets
  // the same result on any server.
  bool Samples(std::span<const Target> targets) const;

  // Takes a request that has been answered. Never blocks.
  //   answers: in the order of call.targets; failed ones are skipped.
  //   kept: owns what the targets point to; released once they are compared or dropped.
  void Offer(const PredictionCall& call, std::vector<TargetAnswer> answers,
             std::shared_ptr<const void> kept);

 private:
  struct AnsweredTarget {
    Target target;
    inference::SceneEncoding encoding;
  };
  struct AnsweredRequest {
    ModelHandle answered;
    ModelHandle candidate;
    std::vector<AnsweredTarget> targets;
    int64_t bytes = 0;
    std::shared_ptr<const void> kept;
  };
  // The metrics of one model.
  struct Differences {
    Differences(monitoring::MetricRegistry& metrics, const std::string& model);
    void Observe(const evaluation::AnswerDifference& difference);

    monitoring::Histogram& expected;
    monitoring::Histogram& likeliest;
    monitoring::Histogram& energy;
    monitoring::Histogram& divergence;
    monitoring::Histogram& answered_entropy;
    monitoring::Histogram& candidate_entropy;
  };
  struct Comparison {
    ModelHandle answered;
    ModelHandle candidate;
    std::unique_ptr<ShadowComparison> versions;  // nullptr: the two cannot be compared
    TimePoint last_used;
  };

  // Returns how many of the request's targets were queued. The others are dropped.
  size_t Push(AnsweredRequest& request) ABSL_LOCKS_EXCLUDED(mutex_);
  size_t PushLocked(AnsweredRequest& request) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Work();
  void Compare(AnsweredRequest& request);
  // Compares one target, step by step (InTurn). Returns false if the shadow ends.
  bool CompareTarget(ShadowComparison& versions, Differences& differences,
                     const AnsweredTarget& target);
  // Runs a step as soon as the server is idle and the thread has rested. Returns false, without
  // running it, if the shadow ends.
  bool InTurn(const std::function<void()>& step);
  // Returns the comparison of the two versions, or nullptr if they cannot be compared.
  ShadowComparison* ComparisonOf(const AnsweredRequest& request);
  // Releases versions that have not been compared for a while.
  void ForgetComparisons();
  Differences& DifferencesOf(const std::string& model);

  const ShadowOptions options_;
  ServingTable& models_;
  const std::function<bool()> busy_;
  monitoring::MetricRegistry& metrics_;
  monitoring::Counter& compared_;
  monitoring::Counter& dropped_;
  monitoring::Counter& failed_;
  monitoring::Counter& seconds_;

  Mutex mutex_;
  CondVar wake_;
  std::deque<AnsweredRequest> waiting_ ABSL_GUARDED_BY(mutex_);
  size_t held_targets_ ABSL_GUARDED_BY(mutex_) = 0;  // waiting or being compared
  int64_t held_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;

  // Used by the thread alone.
  TimePoint rests_until_;
  std::map<std::string, Comparison> comparisons_;  // by model
  std::map<std::string, Differences> differences_;
  std::thread thread_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SHADOW_H_
