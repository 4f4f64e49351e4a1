#include "model/learning/phases/scene_batches.h"

#include <chrono>
#include <utility>

#include "model/learning/recording_windows.h"
#include "model/learning/validation.h"
#include "model/machine/thread_priority.h"

namespace maneuver::learning {
namespace {

// The next window is needed in a while, the batches of this one now (SceneLoader).
constexpr int kReaderNiceness = 10;

}  // namespace

// A window in memory, with its maps indexed.
struct SceneBatches::OpenWindow {
  OpenWindow(LoadedWindow read, const v1::ModelSpec& spec, int threads)
      : window(std::move(read)), source(spec, window.set, threads) {}

  const LoadedWindow window;
  const SceneSource source;
};

SceneBatches::SceneBatches(const v1::ModelSpec& spec, const LearningState& state,
                           const MicroBatchRange& range)
    : spec_(spec), state_(state), range_(range) {}

SceneBatches::~SceneBatches() { EndEpoch(); }

absl::Status SceneBatches::BeginEpoch(const EpochStart& start) {
  if (state_.data.windows == nullptr) {
    BeginReading(state_.training,
                 EpochItems(state_.settings, start.order, start.step, start.epoch));
    return absl::OkStatus();
  }
  epoch_ = start.epoch;
  windows_ = state_.data.windows->Plan(start.steps, start.epoch);
  next_ = 0;
  while (next_ + 1 < windows_.size() && windows_[next_ + 1].first_step <= start.step) ++next_;
  ReadAhead(windows_[next_]);
  return OpenNext(start.step - windows_[next_].first_step);
}

absl::StatusOr<SceneBatches::LabelledBatch> SceneBatches::Next() {
  std::optional<SceneLoader::Batch> batch = loader_->Next();
  if (!batch) {  // the window is over
    const auto begin = std::chrono::steady_clock::now();
    const absl::Status status = OpenNext(0);
    if (!status.ok()) return status;
    batch = loader_->Next();
    batch->waited = std::chrono::steady_clock::now() - begin;
  }
  const std::vector<int>& labels = open_ ? open_->window.labels : state_.data.labels;
  const at::Tensor of_batch = BatchLabels(labels, *batch);
  const double share = shares_[taken_++];
  return LabelledBatch{*std::move(batch), of_batch, share};
}

void SceneBatches::BeginReading(const SceneSource& source, std::vector<SceneLoader::Item> items) {
  const auto batch_size = static_cast<size_t>(state_.settings.optimization().batch_size());
  const auto of = static_cast<size_t>(range_.of);
  const auto first = static_cast<size_t>(range_.first);
  const auto count = static_cast<size_t>(range_.count);
  std::vector<SceneLoader::Item> mine;
  std::vector<size_t> ends;
  shares_.clear();
  taken_ = 0;
  for (size_t begin = 0; begin < items.size(); begin += batch_size) {
    const size_t size = std::min(batch_size, items.size() - begin);
    for (size_t i = first; i < first + count; ++i) {
      const size_t from = size * i / of;
      const size_t to = size * (i + 1) / of;
      for (size_t j = from; j < to; ++j) mine.push_back(items[begin + j]);
      ends.push_back(mine.size());
      shares_.push_back(static_cast<double>(to - from) / static_cast<double>(size));
    }
  }
  loader_.emplace(spec_, source, std::move(mine), std::move(ends), SceneLoader::kAhead * count,
                  state_.threads);
}

void SceneBatches::EndEpoch() {
  loader_.reset();
  ending_ = true;
  if (ahead_.valid()) ahead_.wait();
  ahead_ = {};
  ending_ = false;
  open_.reset();
}

absl::Status SceneBatches::OpenNext(int64_t step) {
  loader_.reset();
  open_.reset();
  absl::StatusOr<std::unique_ptr<OpenWindow>> read = ahead_.get();
  if (!read.ok()) return read.status();
  open_ = *std::move(read);
  const auto examples = static_cast<int64_t>(open_->window.set.examples.size());
  BeginReading(open_->source,
               WindowItems(state_.settings, examples, windows_[next_], step, epoch_));
  if (++next_ < windows_.size()) ReadAhead(windows_[next_]);
  return absl::OkStatus();
}

void SceneBatches::ReadAhead(const EpochWindow& window) {
  ahead_ = std::async(
      std::launch::async, [this, &window]() -> absl::StatusOr<std::unique_ptr<OpenWindow>> {
        machine::AddNiceness(kReaderNiceness);  // the threads that this one starts have it too
        absl::StatusOr<LoadedWindow> read =
            state_.data.windows->Load(window, [this] { return !ending_; });
        if (!read.ok()) return read.status();
        return std::make_unique<OpenWindow>(*std::move(read), spec_, state_.threads);
      });
}

}  // namespace maneuver::learning
