#include "tests/bench/worker_scaling.h"

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <latch>
#include <memory>

#include "model/machine/usable_cores.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/prediction_plan.h"
#include "server/serving/batch_scheduler.h"
#include "tests/bench/bench_scenes.h"

namespace maneuver::bench {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kDescribed = 4;  // actions of each target
constexpr int kCalls = 64;     // that wait at once, so that no worker is ever without

double SecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// Calls that are made repeatedly.
class Calls {
 public:
  Calls(const BenchModel& model, const std::vector<v1::Scenario>& scenes)
      : model_(std::make_shared<serving::ServedModel>(security::ModelVersionName{"bench", 1},
                                                      model.model)) {
    for (const v1::Scenario& scene : scenes) {
      requests_.push_back(std::make_unique<v1::PredictRequest>(RequestFor({scene}, kDescribed)));
      plans_.push_back(
          rpc::PlanPrediction(requests_.back()->scenarios(), model.model->spec(), {}, false));
    }
  }

  // Submits all calls to the scheduler and waits for the answers. Returns targets per second.
  double Ask(serving::BatchScheduler& scheduler) const {
    size_t targets = 0;
    std::latch unanswered(kCalls);
    const Clock::time_point begin = Clock::now();
    for (size_t i = 0; i < kCalls; ++i) {
      auto call = std::make_shared<serving::PredictionCall>();
      call->model = model_;
      call->question = serving::DescribeActions{serving::TopK{kDescribed}};
      call->targets = plans_[i % plans_.size()].targets;
      call->done = [&unanswered](const std::vector<serving::TargetAnswer>&) {
        unanswered.count_down();
      };
      targets += call->targets.size();
      if (const absl::Status status = scheduler.Submit(std::move(call)); !status.ok()) {
        std::cerr << "maneuver-bench: " << status << "\n";
        std::exit(EXIT_FAILURE);
      }
    }
    unanswered.wait();
    return static_cast<double>(targets) / SecondsSince(begin);
  }

 private:
  const serving::ModelHandle model_;
  std::vector<std::unique_ptr<v1::PredictRequest>> requests_;  // the plans point into them
  std::vector<rpc::PredictionPlan> plans_;
};

}  // namespace

std::vector<WorkerSpeed> MeasureWorkers(const BenchModel& model,
                                        const std::vector<v1::Scenario>& scenes, double seconds,
                                        int least_rounds) {
  const Calls calls(model, scenes);
  const auto metrics = monitoring::PrometheusMetrics::Create();
  std::vector<std::unique_ptr<serving::BatchScheduler>> schedulers;
  std::vector<WorkerSpeed> speeds;
  for (int workers = 1; workers <= machine::UsableCores(); ++workers) {
    schedulers.push_back(std::make_unique<serving::BatchScheduler>(
        serving::SchedulerOptions{.workers = workers, .queue = {}}, *metrics));
    speeds.push_back({workers, {}});
    calls.Ask(*schedulers.back());  // fills caches and buffers
  }
  const Clock::time_point begin = Clock::now();
  for (int round = 0; round < least_rounds || SecondsSince(begin) < seconds; ++round) {
    for (size_t i = 0; i < schedulers.size(); ++i) {
      speeds[i].targets_per_second.push_back(calls.Ask(*schedulers[i]));
    }
  }
  return speeds;
}

}  // namespace maneuver::bench
