#include "server/serving/batch_scheduler.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/artifact/model_spec.h"
#include "model/files/digest.h"
#include "server/errors/error_details.h"
#include "server/monitoring/logging.h"
#include "server/serving/admission.h"
#include "server/serving/answer_check.h"
#include "server/serving/joint_answer.h"

namespace maneuver::serving {
namespace {

using std::chrono::duration;
using std::chrono::nanoseconds;

// Queued work of more than this time is a backlog. A patient thread may run as late as the kernel's next
// tick, 4 ms with most: that is little beside such a wait.
constexpr nanoseconds kBacklog = std::chrono::milliseconds(3);

constexpr double kFaultLinesPerSecond = 10.0;

double Seconds(nanoseconds time) { return duration<double>(time).count(); }

TargetAnswer Failure(absl::Status status) {
  TargetAnswer answer;
  answer.status = std::move(status);
  return answer;
}

// Prepares the sets of targets that are combined, if the call asks for that.
void PrepareSets(PredictionCall* call) {
  const auto* describe = std::get_if<DescribeActions>(&call->question);
  if (describe == nullptr || describe->combinations == 0) return;
  const std::vector<TargetRange> ranges = ScenariosOf(call->targets);
  call->joint.resize(ranges.size());
  call->joint_sets = std::vector<PredictionCall::JointSet>(ranges.size());
  for (size_t i = 0; i < ranges.size(); ++i) {
    call->joint_sets[i].range = ranges[i];
    call->joint_sets[i].unanswered.store(ranges[i].end - ranges[i].begin,
                                         std::memory_order_relaxed);
  }
}

// Returns the set that a target is in.
size_t SetOf(const PredictionCall& call, size_t target) {
  const auto after = std::ranges::upper_bound(call.joint_sets, target, {},
                                              [](const auto& set) { return set.range.begin; });
  return static_cast<size_t>(after - call.joint_sets.begin()) - 1;
}

}  // namespace

BatchScheduler::BatchScheduler(const SchedulerOptions& options, monitoring::MetricRegistry& metrics)
    : options_(options),
      metrics_(metrics),
      fault_lines_(kFaultLinesPerSecond),
      queue_(options.queue),
      drain_rate_(options.workers) {
  metrics.AddGauge("maneuver_workers", "Threads that evaluate models.").Set(options_.workers);
  metrics.AddGauge("maneuver_queue_limit_targets", "Most targets of each priority that may wait.")
      .Set(options_.queue.max_queue);
  for (int i = 0; i < options_.workers; ++i) workers_.emplace_back([this, i] { Work(i); });
}

BatchScheduler::~BatchScheduler() {
  std::vector<TargetQueue::Item> waiting;
  {
    const MutexLock lock(mutex_);
    stopping_ = true;
    waiting = queue_.TakeAll();
  }
  wake_.NotifyAll();
  for (std::thread& worker : workers_) worker.join();
  for (const TargetQueue::Item& item : waiting) {
    Answer(item, Failure(absl::UnavailableError("the server is shutting down; try again")),
           nullptr);
  }
}

absl::Status BatchScheduler::CheckSize(const PredictionCall& call) const {
  const QueueOptions& queue = options_.queue;
  if (call.targets.size() > static_cast<size_t>(queue.max_queue)) {
    return errors::WithReason(absl::ResourceExhaustedError(absl::StrCat(
                                  "the request has ", call.targets.size(),
                                  " targets; split it into requests of at most ", queue.max_queue)),
                              "TOO_MANY_TARGETS");
  }
  if (call.bytes > queue.max_queue_bytes) {
    return errors::WithReason(
        absl::ResourceExhaustedError(absl::StrCat("the request has ", call.bytes,
                                                  " bytes; split it into requests of at most ",
                                                  queue.max_queue_bytes)),
        "REQUEST_TOO_LARGE");
  }
  return absl::OkStatus();
}

absl::Status BatchScheduler::Submit(CallPtr call) {
  submitters_.Join();
  const size_t targets = call->targets.size();
  const TimePoint now = options_.now();
  if (auto status = call->CheckWanted(now); !status.ok()) {
    CountDead(status, Passed::kNothing, targets);
    return status;
  }
  if (auto status = CheckSize(*call); !status.ok()) {
    metrics_.refused.Increment(static_cast<double>(targets));
    return status;
  }
  call->answers.resize(targets);
  call->unanswered.store(targets, std::memory_order_relaxed);
  PrepareSets(call.get());

  absl::Status status;
  std::vector<TargetQueue::Item> dead;
  {
    const MutexLock lock(mutex_);
    if (stopping_) {
      return absl::UnavailableError("the server is shutting down; try again");
    }
    if (!queue_.HasRoom(*call)) dead = queue_.TakeDead(now);
    status = CheckWaitLocked(call->priority, targets, call->deadline, now);
    if (!status.ok()) {
      metrics_.refused.Increment(static_cast<double>(targets));
    } else if (queue_.HasRoom(*call)) {
      if (queue_.size(call->priority) == 0) {
        waiting_since_[static_cast<size_t>(call->priority)] = now;
      }
      queue_.Push(std::move(call), now);
    } else {
      metrics_.refused.Increment(static_cast<double>(targets));
      status = errors::WithRetryDelay(
          errors::WithReason(absl::ResourceExhaustedError(
                                 "the server has more to do than it can; try again a little later"),
                             "QUEUE_FULL"),
          RetryDelayLocked(call->priority, now));
    }
    ShowQueueLocked();
  }
  if (status.ok()) wake_.NotifyOne();
  Drop(dead, now, Passed::kQueue);
  return status;
}

absl::Status BatchScheduler::CheckWait(Priority priority, size_t targets, TimePoint deadline) {
  targets = std::max<size_t>(targets, 1);  // one that cannot be read counts as one
  const TimePoint now = options_.now();
  absl::Status status;
  {
    const MutexLock lock(mutex_);
    status = CheckWaitLocked(priority, targets, deadline, now);
  }
  if (!status.ok()) metrics_.refused.Increment(static_cast<double>(targets));
  return status;
}

absl::Status BatchScheduler::CheckWaitLocked(Priority priority, size_t targets, TimePoint deadline,
                                             TimePoint now) const {
  const int before = queue_.SizeBefore(priority, targets);
  const bool waits = before > 0 || drain_rate_.AllAtWork();
  if (!waits || deadline == TimePoint::max()) return absl::OkStatus();
  const nanoseconds left = std::max(nanoseconds(0), deadline - now);
  const bool standing =
      queue_.size(priority) > 0 && now - waiting_since_[static_cast<size_t>(priority)] > left;
  return CheckTimeLeft(
      {.wait = drain_rate_.TimeForWorkBegun(now) + drain_rate_.TimeFor(before, now),
       .work = drain_rate_.TimeFor(static_cast<int>(targets), now),
       .standing = standing},
      left);
}

void BatchScheduler::ShowQueueLocked() {
  waiting_.store(queue_.size(), std::memory_order_relaxed);
  for (const Priority priority : {Priority::kInteractive, Priority::kBulk}) {
    const auto i = static_cast<size_t>(priority);
    metrics_.queue_depth[i]->Set(queue_.size(priority));
    metrics_.queue_bytes[i]->Set(static_cast<double>(queue_.bytes(priority)));
  }
}

nanoseconds BatchScheduler::RetryDelayLocked(Priority priority, TimePoint now) const {
  // Whoever fills the queue is the last in it.
  const int waiting = queue_.SizeBefore(priority, static_cast<size_t>(options_.queue.max_queue));
  return RetryDelay(drain_rate_.TimeFor(waiting, now));
}

void BatchScheduler::CountDead(const absl::Status& status, Passed passed, size_t targets) {
  const auto i = static_cast<size_t>(passed);
  const auto count = static_cast<double>(targets);
  const bool cancelled = absl::IsCancelled(status);
  (cancelled ? metrics_.cancelled : metrics_.expired).Increment(count);
  (cancelled ? metrics_.cancelled_after : metrics_.expired_after)[i]->Increment(count);
}

void BatchScheduler::Drop(const std::vector<TargetQueue::Item>& items, TimePoint now,
                          Passed passed) {
  for (const TargetQueue::Item& item : items) {
    absl::Status status = item.call->CheckWanted(now);
    CountDead(status, passed, 1);
    Answer(item, Failure(std::move(status)), nullptr);
  }
}

void BatchScheduler::Answer(const TargetQueue::Item& item, TargetAnswer answer,
                            ServedModel::Lease* engine) {
  PredictionCall& call = *item.call;
  call.answers[item.target] = std::move(answer);
  // The thread that counts to zero, here and below, sees the answers of all others by acq_rel.
  if (!call.joint_sets.empty()) {
    const size_t set = SetOf(call, item.target);
    const bool last = call.joint_sets[set].unanswered.fetch_sub(1, std::memory_order_acq_rel) == 1;
    if (last && engine != nullptr) Combine(call, set, *engine);
    if (last) CountAnswered(call, call.joint_sets[set].range);
  }
  if (call.unanswered.fetch_sub(1, std::memory_order_acq_rel) == 1) {
    // What `done` holds, perhaps the call itself, is let go with it.
    const auto done = std::exchange(call.done, nullptr);
    done(std::move(call.answers));
  }
}

void BatchScheduler::CountAnswered(const PredictionCall& call, TargetRange range) {
  for (size_t i = range.begin; i < range.end; ++i) {
    if (call.answers[i].status.ok()) metrics_.answered.Increment();
  }
}

void BatchScheduler::Combine(PredictionCall& call, size_t set, ServedModel::Lease& engine) {
  const double interval = artifact::WaypointInterval(call.model->model().spec().trajectory());
  const TargetRange range = call.joint_sets[set].range;
  std::vector<bool> sound;
  for (size_t i = range.begin; i < range.end; ++i) sound.push_back(call.answers[i].status.ok());
  const absl::Status status = engine.With([&](Engine& used) {
    call.joint[set] = CombineTargets(std::get<DescribeActions>(call.question), call.targets, range,
                                     interval, used.session(), call.answers);
  });
  for (size_t i = range.begin; i < range.end; ++i) {
    if (!sound[i - range.begin]) continue;
    if (!status.ok()) call.answers[i] = Failure(status);
    if (!call.answers[i].status.ok()) NoteWithheld(call, call.targets[i], call.answers[i].status);
  }
}

void BatchScheduler::Work(int worker) {
  MutexLock lock(mutex_);
  while (true) {
    const TimePoint now = options_.now();
    if (auto dead = queue_.TakeDead(now); !dead.empty()) {
      ShowQueueLocked();
      lock.Unlock();
      Drop(dead, now, Passed::kQueue);
      lock.Lock();
      continue;
    }
    if (stopping_) return;
    const TimePoint next = queue_.NextBatchTime();
    if (next == TimePoint::max()) {
      submitters_.SetPatient(false);
      wake_.Wait(mutex_);
    } else if (next > now) {
      wake_.WaitFor(mutex_, next - now);
    } else {
      auto items = queue_.TakeBatch();
      ShowQueueLocked();
      drain_rate_.Begin(worker, items.size(), now);
      // More may be left than one worker can take.
      if (!queue_.empty()) wake_.NotifyOne();
      const bool backlog = drain_rate_.TimeFor(queue_.size(), now) > kBacklog;
      lock.Unlock();
      submitters_.SetPatient(backlog);
      RunBatch(std::move(items));
      lock.Lock();
      drain_rate_.End(worker, options_.now());
    }
  }
}

TimePoint BatchScheduler::DropDead(std::vector<Row>& rows, Passed passed) {
  const TimePoint now = options_.now();
  std::vector<TargetQueue::Item> dead;
  std::erase_if(rows, [&](const Row& row) {
    if (row.item.call->CheckWanted(now).ok()) return false;
    dead.push_back(row.item);
    return true;
  });
  Drop(dead, now, passed);
  return now;
}

TimePoint BatchScheduler::ReadScenes(Engine& engine, std::vector<Row>& rows, TimePoint start) {
  const v1::ModelSpec& spec = rows.front().item.call->model->model().spec();
  const auto read = [&](auto&& part, monitoring::Histogram& stage_time) {
    for (size_t i = 0; i < rows.size(); ++i) {
      const PredictionCall& call = *rows[i].item.call;
      if (!call.CheckWanted(options_.now()).ok()) continue;  // the caller drops it
      part(call.targets[rows[i].item.target], engine.reader(), &engine.Inputs(i));
      rows[i].scene = inference::ViewOf(engine.Inputs(i));
    }
    const TimePoint now = options_.now();
    stage_time.Observe(Seconds(now - start));
    start = now;
  };
  if (spec.has_raster()) read(ReadRaster, metrics_.raster_time);
  if (spec.has_scene_vectors()) read(ReadVectors, metrics_.vectors_time);
  return start;
}

absl::Status BatchScheduler::Describe(const TargetQueue::Item& item,
                                      inference::SceneEncoding&& encoding,
                                      ServedModel::Lease& engine, TargetAnswer* answer) {
  const PredictionCall& call = *item.call;
  const Target& target = call.targets[item.target];
  answer->encoding = std::move(encoding);
  absl::Status status = CheckProbabilities(answer->encoding.probabilities, "p(y|s)");
  if (!status.ok()) return status;
  status = engine.With([&](Engine& used) {
    if (const auto* describe = std::get_if<DescribeActions>(&call.question)) {
      const double interval = artifact::WaypointInterval(call.model->model().spec().trajectory());
      DescribeTarget(*describe, answer->encoding, interval, used.session(), answer);
    } else if (std::holds_alternative<ClassifyTrajectory>(call.question)) {
      answer->classification = used.session().Classify(answer->encoding, target.trajectory);
    }
  });
  return status.ok() ? CheckAnswer(*answer) : status;
}

void BatchScheduler::NoteWithheld(const PredictionCall& call, const Target& target,
                                  const absl::Status& status) {
  metrics_.unsound.Increment();
  if (fault_lines_.Take("", 1.0)) return;  // it says how long to wait
  monitoring::Log(monitoring::LogLevel::kError, "answer withheld",
                  {{"model_version", call.model->name().ToString()},
                   {"scenario_sha256", files::Sha256Hex(target.scenario->SerializeAsString())},
                   {"target_id", target.id},
                   {"reason", std::string(status.message())}});
}

void BatchScheduler::Withhold(const std::vector<Row>& rows, const absl::Status& status,
                              ServedModel::Lease& engine) {
  for (const Row& row : rows) {
    const PredictionCall& call = *row.item.call;
    NoteWithheld(call, call.targets[row.item.target], status);
    Answer(row.item, Failure(status), &engine);
  }
}

void BatchScheduler::RunBatch(std::vector<TargetQueue::Item> items) {
  const ModelHandle model = items.front().call->model;
  std::vector<Row> rows;
  for (TargetQueue::Item& item : items) rows.push_back({std::move(item)});

  TimePoint start = DropDead(rows, Passed::kQueue);
  if (rows.empty()) return;
  metrics_.batch_size.Observe(static_cast<double>(rows.size()));
  for (const Row& row : rows) {
    metrics_.queue_time.Observe(Seconds(start - row.item.call->submitted));
  }
  ServedModel::Lease engine(*model);
  absl::Status status = engine.With([&](Engine& used) { start = ReadScenes(used, rows, start); });
  if (!status.ok()) return Withhold(rows, status, engine);
  start = DropDead(rows, Passed::kRaster);
  if (rows.empty()) return;
  std::vector<inference::SceneEncoding> encodings(rows.size());
  status = engine.With([&](Engine& used) {
    std::vector<inference::SceneInputsView> scenes;
    for (const Row& row : rows) scenes.push_back(row.scene);
    used.session().Encode(scenes, encodings);
  });
  if (!status.ok()) return Withhold(rows, status, engine);
  metrics_.encode_time.Observe(Seconds(options_.now() - start));

  start = options_.now();
  for (size_t i = 0; i < rows.size(); ++i) {
    const PredictionCall& call = *rows[i].item.call;
    // Describing many actions takes long enough to ask again before each target.
    if (const TimePoint now = options_.now(); !call.CheckWanted(now).ok()) {
      Drop({rows[i].item}, now, Passed::kEncode);
      continue;
    }
    TargetAnswer answer;
    status = Describe(rows[i].item, std::move(encodings[i]), engine, &answer);
    // A target of a set is answered once the set is combined.
    if (status.ok() && call.joint_sets.empty()) metrics_.answered.Increment();
    if (!status.ok()) NoteWithheld(call, call.targets[rows[i].item.target], status);
    Answer(rows[i].item, status.ok() ? std::move(answer) : Failure(std::move(status)), &engine);
  }
  metrics_.describe_time.Observe(Seconds(options_.now() - start));
}

}  // namespace maneuver::serving
