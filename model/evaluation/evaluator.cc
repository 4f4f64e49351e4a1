#include "model/evaluation/evaluator.h"

#include <algorithm>
#include <atomic>
#include <iterator>
#include <mutex>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "model/data/example_index.h"
#include "model/evaluation/measurement.h"
#include "model/evaluation/report.h"

namespace maneuver::evaluation {
namespace {

constexpr int64_t kReportEvery = 64;  // examples

std::vector<data::Example> EnumerateAll(const EvaluationInput& input, const v1::ModelSpec& spec) {
  std::vector<data::Example> examples;
  for (size_t i = 0; i < input.recordings.size(); ++i) {
    std::vector<data::Example> found =
        data::EnumerateExamples(input.recordings[i], static_cast<int>(i), spec, input.examples);
    std::move(found.begin(), found.end(), std::back_inserter(examples));
  }
  return examples;
}

// Measures the examples on the input's threads; false if its `progress` stopped it.
bool MeasureAll(const MeasuringContext& context, const EvaluationInput& input,
                std::span<const data::Example> examples, std::span<Measurement> measured) {
  std::mutex mutex;  // guards the calls of progress
  std::atomic<size_t> next = 0;
  std::atomic<int64_t> done = 0;
  std::atomic<bool> stopped = false;
  const auto work = [&] {
    Measurer measurer(context);
    while (!stopped) {
      const size_t begin = next.fetch_add(Measurer::kBatch);
      if (begin >= examples.size()) break;
      const size_t count = std::min<size_t>(Measurer::kBatch, examples.size() - begin);
      measurer.Measure(examples.subspan(begin, count), measured.subspan(begin, count));
      const int64_t before = done.fetch_add(static_cast<int64_t>(count));
      const int64_t after = before + static_cast<int64_t>(count);
      if (input.progress && before / kReportEvery != after / kReportEvery) {
        std::lock_guard lock(mutex);
        if (!input.progress(after, static_cast<int64_t>(examples.size()))) stopped = true;
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    for (int i = 1; i < input.threads; ++i) threads.emplace_back(work);
    work();
  }
  return !stopped;
}

}  // namespace

absl::StatusOr<v1::EvaluationReport> Evaluate(const inference::ActionModel& model,
                                              const EvaluationInput& input) {
  const std::vector<data::Example> examples = EnumerateAll(input, model.spec());
  if (examples.empty()) {
    return absl::FailedPreconditionError(
        "the recordings hold no example: none has a vehicle with a second of past and a whole "
        "horizon of future; use longer recordings or a model with a shorter horizon");
  }
  const MeasuringContext context(model, input.recordings, input.annotations);
  std::vector<Measurement> measured(examples.size());
  if (!MeasureAll(context, input, examples, measured)) {
    return absl::CancelledError("the evaluation was stopped");
  }
  return MakeReport(measured, !context.waymo.measured_times().empty());
}

}  // namespace maneuver::evaluation
