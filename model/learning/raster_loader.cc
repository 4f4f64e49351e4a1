#include "model/learning/raster_loader.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

#include "model/machine/thread_priority.h"
#include "model/scene/rasterizer.h"

namespace maneuver::learning {

using Clock = std::chrono::steady_clock;

namespace {

// Rasters are needed in a while, a step's threads now: one that waits for its core has all others
// wait for it. Not so nice that on a single core the step had to wait for its rasters instead.
constexpr int kNiceness = 5;

// SplitMix64: well mixed bits from a counter.
uint64_t Mix(uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

// Uniform in [0, 1).
double Uniform(uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1.0p-53; }

// Which agents a variation leaves out.
std::function<bool(int64_t)> HiddenAgents(const Variation& variation) {
  if (variation.drop_agents <= 0.0) return {};
  return [share = variation.drop_agents, seed = variation.drop_seed](int64_t agent_id) {
    return Uniform(Mix(seed ^ static_cast<uint64_t>(agent_id))) < share;
  };
}

}  // namespace

Variation DrawVariation(const v1::AugmentationSettings& settings, int history_frames, uint64_t seed,
                        int epoch, int64_t example) {
  uint64_t state =
      Mix(Mix(Mix(seed) ^ static_cast<uint64_t>(epoch)) ^ static_cast<uint64_t>(example));
  const auto draw = [&state] { return Uniform(state = Mix(state)); };
  Variation variation;
  variation.mirror = draw() < 0.5 && settings.mirror();
  variation.scale = 1.0 + settings.scale() * (2.0 * draw() - 1.0);
  variation.shift_x = settings.shift_pixels() * (2.0 * draw() - 1.0);
  variation.shift_y = settings.shift_pixels() * (2.0 * draw() - 1.0);
  variation.rotation = settings.rotation() * (2.0 * draw() - 1.0);
  variation.drop_agents = settings.drop_agents();
  variation.drop_seed = state = Mix(state);
  if (draw() < settings.drop_history()) {
    variation.frames = 1 + static_cast<int>(draw() * history_frames);
  }
  return variation;
}

void ApplyVariation(const Variation& variation, std::span<float> trajectory) {
  const float side = variation.mirror ? -1.0F : 1.0F;
  const float c = static_cast<float>(variation.scale * std::cos(variation.rotation));
  const float s = static_cast<float>(variation.scale * std::sin(variation.rotation));
  for (size_t i = 0; i + 1 < trajectory.size(); i += 2) {
    const float x = trajectory[i];
    const float y = trajectory[i + 1];
    trajectory[i] = c * x + s * y;
    trajectory[i + 1] = side * (c * y - s * x);
  }
}

scene::MotionInputs VariedMotion(const Variation& variation, const scene::MotionInputs& motion) {
  const scene::MotionInputs scaled = scene::Scaled(motion, variation.scale);
  return variation.mirror ? scene::Mirrored(scaled) : scaled;
}

RasterLoader::RasterLoader(const v1::RasterSpec& spec, const ExampleSet& set,
                           std::vector<Item> items, int64_t batch_size, int threads)
    : spec_(spec),
      set_(set),
      items_(std::move(items)),
      batch_size_(static_cast<size_t>(batch_size)),
      batches_((items_.size() + batch_size_ - 1) / batch_size_),
      ready_(kAhead) {
  const Clock::time_point begin = Clock::now();
  for (const v1::Scenario& recording : set.recordings) {
    maps_.push_back(scene::RoadMap::Over(recording.map_features()));
  }
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { Work(); });
  making_ = Clock::now() - begin;
}

RasterLoader::~RasterLoader() {
  {
    std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
}

void RasterLoader::Work() {
  machine::AddNiceness(kNiceness);
  scene::Rasterizer rasterizer(spec_);
  const size_t bytes = scene::RasterBytes(spec_);
  while (true) {
    size_t index = 0;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(
          lock, [this] { return stopping_ || claimed_ == batches_ || claimed_ < taken_ + kAhead; });
      if (stopping_ || claimed_ == batches_) return;
      index = claimed_++;
    }
    const size_t begin = index * batch_size_;
    const size_t end = std::min(begin + batch_size_, items_.size());
    Batch batch;
    batch.items.assign(items_.begin() + static_cast<std::ptrdiff_t>(begin),
                       items_.begin() + static_cast<std::ptrdiff_t>(end));
    batch.rasters.resize(batch.items.size() * bytes);
    for (size_t i = 0; i < batch.items.size(); ++i) {
      const Variation& variation = batch.items[i].variation;
      const data::Example& example = set_.examples[static_cast<size_t>(batch.items[i].example)];
      const std::span<uint8_t> raster(batch.rasters.data() + i * bytes, bytes);
      // Mirrored after it is drawn: the shift turns round with the rest.
      const scene::RasterView view{.scale = variation.scale,
                                   .shift_x = variation.shift_x,
                                   .shift_y = variation.shift_y,
                                   .frames = variation.frames,
                                   .is_hidden = HiddenAgents(variation)};
      const scene::Pose2 X_WT(example.X_WT.x(), example.X_WT.y(),
                              example.X_WT.heading() + variation.rotation);
      const auto recording = static_cast<size_t>(example.recording);
      rasterizer.Rasterize(set_.recordings[recording], maps_[recording], example.time,
                           example.target_id, X_WT, view, raster);
      if (variation.mirror) scene::MirrorRaster(spec_, raster);
    }
    {
      std::lock_guard lock(mutex_);
      ready_[index % kAhead] = std::move(batch);
    }
    changed_.notify_all();
  }
}

std::optional<RasterLoader::Batch> RasterLoader::Next() {
  std::unique_lock lock(mutex_);
  if (taken_ == batches_) return std::nullopt;
  std::optional<Batch>& slot = ready_[taken_ % kAhead];
  std::chrono::nanoseconds waited = std::exchange(making_, std::chrono::nanoseconds{0});
  if (!slot) {
    const Clock::time_point begin = Clock::now();
    changed_.wait(lock, [&slot] { return slot.has_value(); });
    waited += Clock::now() - begin;
  }
  std::optional<Batch> batch = std::exchange(slot, std::nullopt);
  batch->waited = waited;
  ++taken_;
  lock.unlock();
  changed_.notify_all();
  return batch;
}

std::vector<RasterLoader::Item> VariedItems(const v1::TrainingSettings& settings,
                                            std::span<const int64_t> order, int64_t first,
                                            int epoch) {
  constexpr int kTimeBits = 40;  // beyond the number of examples
  const int frames = settings.model().raster().history_frames();
  const uint64_t seed = static_cast<uint64_t>(settings.seed());
  std::unordered_map<int64_t, int64_t> times;
  std::vector<RasterLoader::Item> items;
  for (int64_t i = 0; i < static_cast<int64_t>(order.size()); ++i) {
    const int64_t example = order[static_cast<size_t>(i)];
    const int64_t time = times[example]++;
    if (i < first) continue;
    items.push_back({example, DrawVariation(settings.augmentation(), frames, seed, epoch,
                                            example + (time << kTimeBits))});
  }
  return items;
}

}  // namespace maneuver::learning
