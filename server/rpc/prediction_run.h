// Answers one admitted request of PredictionService. The unary methods and the stream share it. A
// request takes these steps:
//
//   guard        guarded_service       who calls, and may they?
//   admission    prediction_admission  is there time, and memory for the answer?
//   plan         prediction_plan       which targets can be answered?
//   queue        serving/batch_scheduler
//   answer       prediction_answers    in the frame that the caller asked for

#ifndef MANEUVER_SERVER_RPC_PREDICTION_RUN_H_
#define MANEUVER_SERVER_RPC_PREDICTION_RUN_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "server/rpc/prediction_plan.h"
#include "server/rpc/required_names.h"
#include "server/rpc/worker_pool.h"
#include "server/security/access_control.h"
#include "server/serving/batch_scheduler.h"
#include "server/serving/map_cache.h"
#include "server/serving/past_answers.h"
#include "server/serving/send_memory.h"
#include "server/serving/serving_table.h"
#include "server/serving/shadow.h"

namespace maneuver::rpc {

// What predictions need. Must outlive all of them.
struct PredictionContext {
  serving::ServingTable& models;
  serving::BatchScheduler& scheduler;
  serving::MapCache& maps;
  serving::SendMemory& send_memory;
  WorkerPool& blocking;  // for calls that wait for the disk
  // For models that are not in memory. Its own, because loads wait for one another: they would keep
  // every thread that other calls wait for.
  WorkerPool& loading;
  scene::ScenarioLimits limits;
  security::AccessControl& access;
  std::shared_ptr<serving::Shadow> shadow = nullptr;  // nullptr: none
  serving::PastAnswers* past_answers = nullptr;       // nullptr: no answers are kept
};

// The request, and the places for its answer. Both must outlive the run.
struct PredictionIo {
  const std::string* model = nullptr;
  const Scenarios* scenarios = nullptr;
  const v1::DistributionQuery* query = nullptr;  // nullptr: no distributions
  bool probabilities = true;
  v1::Priority priority = v1::PRIORITY_UNSPECIFIED;
  const ActionNameList* required_action_names = nullptr;  // nullptr: none
  bool strict = false;                                    // refuse scenarios that have warnings
  int64_t bytes = 0;                                      // of the request

  std::string* model_version = nullptr;
  google::protobuf::RepeatedField<double>* waypoint_times = nullptr;  // nullptr: not wanted
  ActionNameList* action_names = nullptr;                             // nullptr: not wanted
  // One of the two: predict, or classify.
  google::protobuf::RepeatedPtrField<v1::ScenarioPrediction>* predictions = nullptr;
  google::protobuf::RepeatedPtrField<v1::ScenarioClassification>* classifications = nullptr;
};

class PredictionRun : public std::enable_shared_from_this<PredictionRun> {
 public:
  // Starts a run. `done` is called once, from any thread, possibly before Start returns. It gets the
  // error of the whole request, if there is one. Errors of single items are in the answer.
  //   request: owns what `io` points to, so that the shadow can read it after the run; nullptr: the
  //     shadow gets nothing.
  static std::shared_ptr<PredictionRun> Start(PredictionContext& context, const PredictionIo& io,
                                              serving::TimePoint deadline,
                                              std::shared_ptr<const void> request,
                                              std::function<void(absl::Status)> done);

  // Returns an upper bound of the answer's size in bytes; 0 before the model is found. The bound
  // counts as send memory until the run is destroyed; once the run has finished, the actual size
  // does. So keep the run, or the result of TakeMemory, until the caller has the answer.
  int64_t answer_bytes() const { return answer_bytes_.load(std::memory_order_relaxed); }
  // Takes the answer's memory. Call only after `done` was called.
  serving::SendMemory::Share TakeMemory() { return std::move(memory_); }

  // Says that nobody waits for the answer any more; `done` is still called.
  void Cancel() { call_->cancelled.store(true, std::memory_order_relaxed); }

 private:
  PredictionRun(PredictionContext& context, const PredictionIo& io, serving::TimePoint deadline,
                std::shared_ptr<const void> request, std::function<void(absl::Status)> done);

  void FindModel();
  absl::Status Submit(serving::ModelHandle model);
  absl::Status ParseQuestion(int actions);
  // Writes the requested action names. Fails if the model lacks a required name.
  absl::Status AnswerNames(const serving::ServedModel& model);
  absl::Status ReserveMemory(const v1::ModelSpec& spec);
  int64_t MessageBytes() const;  // of the answer that was written
  void Answer(std::vector<serving::TargetAnswer> answers);
  // Keeps the answers until their outcomes are reported.
  void KeepAnswers(const std::vector<serving::TargetAnswer>& answers);
  void Finish(absl::Status status);

  PredictionContext& context_;
  const PredictionIo io_;
  std::shared_ptr<const void> request_;  // until it is finished
  std::function<void(absl::Status)> done_;
  const serving::CallPtr call_;
  PredictionPlan plan_;
  serving::SendMemory::Share memory_;
  std::atomic<int64_t> answer_bytes_ = 0;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_RUN_H_
