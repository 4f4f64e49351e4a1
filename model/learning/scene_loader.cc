#include "model/learning/scene_loader.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

#include "model/artifact/model_spec.h"
#include "model/data/stable_hash.h"
#include "model/machine/thread_priority.h"
#include "model/scene/agent_inputs.h"
#include "model/scene/lane_paths.h"
#include "model/scene/motion_reference.h"
#include "model/scene/nonzero_search.h"
#include "model/scene/observation_window.h"
#include "model/scene/rasterizer.h"
#include "model/scene/target_frame.h"

namespace maneuver::learning {

using Clock = std::chrono::steady_clock;

namespace {

// Loader threads yield to the training step, whose threads all wait for the slowest one. A higher
// value would starve the loader on a single core.
constexpr int kNiceness = 5;

// Frames of the past that a model looks at, the present included.
int HistoryFrames(const v1::ModelSpec& spec) {
  const scene::ObservationWindow window = scene::WindowOf(spec);
  return static_cast<int>(std::lround(window.past / window.frame_interval)) + 1;
}

// The ends of batches of `batch_size` among `count` items.
std::vector<size_t> EndsOf(size_t count, size_t batch_size) {
  std::vector<size_t> ends;
  for (size_t begin = 0; begin < count; begin += batch_size) {
    ends.push_back(std::min(begin + batch_size, count));
  }
  return ends;
}

// What one thread reads scenes with.
class Reader {
 public:
  Reader(const v1::ModelSpec& spec, const SceneSource& source)
      : spec_(spec),
        source_(source),
        set_(source.set()),
        waypoint_times_(artifact::WaypointTimes(spec.trajectory())),
        frame_interval_(scene::WindowOf(spec).frame_interval) {
    if (!spec.has_raster()) return;
    rasterizer_.emplace(spec.raster());
    raster_.emplace(scene::NewRaster(spec.raster()));
  }

  // The scenes and trajectories of the batch's items.
  void Read(SceneLoader::Batch* batch) {
    const auto count = static_cast<int64_t>(batch->items.size());
    const auto coordinates = static_cast<int64_t>(2 * waypoint_times_.size());
    SceneTensors& scenes = batch->scenes;
    batch->trajectories = at::empty({count, coordinates}, at::kFloat);
    scenes.motions = at::empty({count, scene::kMotionInputs}, at::kFloat);
    scenes.references = at::zeros({count, coordinates}, at::kFloat);
    scenes.speeds = at::zeros({count}, at::kFloat);
    if (spec_.has_scene_vectors()) {
      scenes.histories = at::empty({count, scene::kHistoryInputs}, at::kFloat);
    }
    if (artifact::ReadsLanePaths(spec_)) {
      scenes.lane_paths =
          at::empty({count, scene::kMostLanePaths, scene::kLanePathInputs}, at::kFloat);
      scenes.path_mask = at::zeros({count, scene::kMostLanePaths}, at::kFloat);
    }
    if (artifact::ReadsAgents(spec_)) {
      scenes.agents = at::empty({count, scene::kMostNearAgents, scene::kAgentInputs}, at::kFloat);
      scenes.agent_mask = at::zeros({count, scene::kMostNearAgents}, at::kFloat);
    }
    std::vector<kernels::NonzeroValues> rasters;
    for (int64_t i = 0; i < count; ++i) {
      const SceneLoader::Item& item = batch->items[static_cast<size_t>(i)];
      ReadOne(set_.examples[static_cast<size_t>(item.example)], item.variation, i, batch, &rasters);
    }
    if (spec_.has_raster()) {
      scenes.rasters =
          RasterBatch(raster_->height(), raster_->width(), raster_->channels(), std::move(rasters));
    }
  }

 private:
  // Row `i` of a tensor of floats.
  static std::span<float> Row(const at::Tensor& rows, int64_t i) {
    const int64_t size = rows.numel() / rows.size(0);
    return {rows.data_ptr<float>() + i * size, static_cast<size_t>(size)};
  }

  void ReadOne(const data::Example& example, Variation variation, int64_t i,
               SceneLoader::Batch* batch, std::vector<kernels::NonzeroValues>* rasters) {
    const SceneTensors& scenes = batch->scenes;
    std::ranges::copy(VariedMotion(variation, example.motion), Row(scenes.motions, i).begin());
    if (spec_.has_scene_vectors()) variation.rotation += ReadVectors(example, variation, i, scenes);
    if (spec_.has_raster()) rasters->push_back(DrawRaster(example, variation));
    const std::span<float> trajectory = Row(batch->trajectories, i);
    std::ranges::copy(example.trajectory, trajectory.begin());
    ApplyVariation(variation, trajectory);
    const std::span<const float> reference = Row(scenes.references, i);
    for (size_t t = 0; t < trajectory.size(); ++t) trajectory[t] -= reference[t];
  }

  // Returns by how much the sensor's noise turns the target's frame, radians.
  double ReadVectors(const data::Example& example, const Variation& variation, int64_t i,
                     const SceneTensors& scenes) {
    const auto recording = static_cast<size_t>(example.recording);
    const v1::Agent& agent = *scene::FindAgent(set_.recordings[recording], example.target_id);
    const scene::Pose2 X_WT(example.X_WT.x(), example.X_WT.y(),
                            example.X_WT.heading() + variation.rotation);
    const double oldest = std::min<double>(1.0, (variation.frames - 0.5) * frame_interval_);
    const scene::NoisyHistory noisy = scene::WithNoise(
        scene::ResampleHistory(agent, example.time, X_WT, oldest), variation.noise);
    scene::TargetHistory varied = scene::Scaled(noisy.history, variation.scale);
    if (variation.mirror) varied = scene::Mirrored(varied);
    const scene::MotionEstimate motion = scene::EstimateMotion(varied);
    std::ranges::copy(scene::DescribeHistory(varied, motion), Row(scenes.histories, i).begin());
    scenes.speeds.data_ptr<float>()[i] = static_cast<float>(motion.speed);
    reference_.resize(2 * waypoint_times_.size());
    scene::RollOut(spec_.reference(), spec_.inputs_version(), motion, waypoint_times_, reference_);
    std::ranges::copy(reference_, Row(scenes.references, i).begin());
    const scene::Pose2 turned(X_WT.x(), X_WT.y(), X_WT.heading() + noisy.heading_error);
    ReadSets(example, turned, motion.speed / variation.scale, variation, i, scenes);
    return noisy.heading_error;
  }

  // The lane paths and the agents nearby, whichever the model reads.
  //   speed: the target's, m/s, in the recorded world
  void ReadSets(const data::Example& example, const scene::Pose2& X_WT, double speed,
                const Variation& variation, int64_t i, const SceneTensors& scenes) {
    const scene::WorldView view{.scale = variation.scale, .mirror = variation.mirror};
    const auto index = static_cast<size_t>(example.recording);
    const v1::Scenario& recording = set_.recordings[index];
    if (artifact::ReadsLanePaths(spec_)) {
      lane_paths_.Find(recording, source_.map(example.recording).lanes(), example.time,
                       example.target_id, X_WT, speed, view, &paths_);
      std::ranges::copy(paths_.values, Row(scenes.lane_paths, i).begin());
      std::ranges::fill(Row(scenes.path_mask, i).first(static_cast<size_t>(paths_.count)), 1.0F);
    }
    if (artifact::ReadsAgents(spec_)) {
      scene::DescribeAgents(recording, example.time, example.target_id, X_WT, speed, view,
                            spec_.inputs_version(), &agents_);
      std::ranges::copy(agents_.values, Row(scenes.agents, i).begin());
      const std::span<float> mask = Row(scenes.agent_mask, i);
      for (int k = 0; k < agents_.count; ++k) {
        mask[static_cast<size_t>(k)] = IsLeftOut(variation, k) ? 0.0F : 1.0F;
      }
    }
  }

  kernels::NonzeroValues DrawRaster(const data::Example& example, const Variation& variation) {
    // Mirrored after it is drawn: the shift turns round with the rest.
    const scene::RasterView view{.scale = variation.scale,
                                 .shift_x = variation.shift_x,
                                 .shift_y = variation.shift_y,
                                 .frames = variation.frames,
                                 .is_hidden = HiddenAgents(variation)};
    const scene::Pose2 X_WT(example.X_WT.x(), example.X_WT.y(),
                            example.X_WT.heading() + variation.rotation);
    const auto recording = static_cast<size_t>(example.recording);
    rasterizer_->Rasterize(set_.recordings[recording], source_.map(example.recording), example.time,
                           example.target_id, X_WT, view, &*raster_);
    if (variation.mirror) raster_->Mirror();
    search_.Find(*raster_, 0, static_cast<int64_t>(raster_->values()), &values_);
    return values_.Trimmed();
  }

  const v1::ModelSpec& spec_;
  const SceneSource& source_;
  const ExampleSet& set_;
  const std::vector<double> waypoint_times_;
  const double frame_interval_;  // seconds
  std::optional<scene::Rasterizer> rasterizer_;
  std::optional<scene::Raster> raster_;
  scene::NonzeroSearch search_;
  kernels::NonzeroValues values_;
  scene::LanePathFinder lane_paths_{spec_.inputs_version()};
  scene::LanePathInputs paths_;
  scene::AgentInputs agents_;
  std::vector<double> reference_;  // [T, 2]
};

}  // namespace

SceneLoader::SceneLoader(const v1::ModelSpec& spec, const SceneSource& source,
                         std::vector<Item> items, int64_t batch_size, int threads)
    : SceneLoader(spec, source, items, EndsOf(items.size(), static_cast<size_t>(batch_size)),
                  kAhead, threads) {}

SceneLoader::SceneLoader(const v1::ModelSpec& spec, const SceneSource& source,
                         std::vector<Item> items, std::vector<size_t> ends, size_t ahead,
                         int threads)
    : spec_(spec),
      source_(source),
      items_(std::move(items)),
      ends_(std::move(ends)),
      work_(ends_.size(), ahead) {
  const Clock::time_point begin = Clock::now();
  for (int i = 0; i < threads; ++i) work_.Start([this] { Work(); });
  making_ = Clock::now() - begin;
}

void SceneLoader::Work() {
  machine::AddNiceness(kNiceness);
  Reader reader(spec_, source_);
  while (const std::optional<size_t> index = work_.Claim()) {
    const size_t begin = *index == 0 ? 0 : ends_[*index - 1];
    Batch batch;
    batch.items.assign(items_.begin() + static_cast<std::ptrdiff_t>(begin),
                       items_.begin() + static_cast<std::ptrdiff_t>(ends_[*index]));
    reader.Read(&batch);
    work_.Put(*index, std::move(batch));
  }
}

std::optional<SceneLoader::Batch> SceneLoader::Next() {
  const bool waits = !work_.IsReady();
  const Clock::time_point begin = Clock::now();
  std::optional<Batch> batch = work_.Take();
  if (!batch) return std::nullopt;
  batch->waited = std::exchange(making_, std::chrono::nanoseconds{0});
  if (waits) batch->waited += Clock::now() - begin;
  return batch;
}

std::vector<SceneLoader::Item> VariedItems(const v1::TrainingSettings& settings,
                                           std::span<const int64_t> order, int64_t first,
                                           int epoch) {
  constexpr int kTimeBits = 40;  // beyond the number of examples
  const int frames = HistoryFrames(settings.model());
  const uint64_t seed = static_cast<uint64_t>(settings.seed());
  std::unordered_map<int64_t, int64_t> times;
  std::vector<SceneLoader::Item> items;
  for (int64_t i = 0; i < static_cast<int64_t>(order.size()); ++i) {
    const int64_t example = order[static_cast<size_t>(i)];
    const int64_t time = times[example]++;
    if (i < first) continue;
    items.push_back({example, DrawVariation(settings.augmentation(), frames, seed, epoch,
                                            example + (time << kTimeBits))});
  }
  return items;
}

std::vector<SceneLoader::Item> EpochItems(const v1::TrainingSettings& settings,
                                          std::span<const int64_t> order, int64_t first_step,
                                          int epoch) {
  const int64_t batch_size = settings.optimization().batch_size();
  std::vector<SceneLoader::Item> items =
      VariedItems(settings, order, first_step * batch_size, epoch + 1);
  if (static_cast<int64_t>(order.size()) % batch_size == 1) items.pop_back();
  return items;
}

std::vector<SceneLoader::Item> WindowItems(const v1::TrainingSettings& settings, int64_t examples,
                                           const EpochWindow& window, int64_t first_step,
                                           int epoch) {
  const int64_t batch_size = settings.optimization().batch_size();
  const uint64_t seed = static_cast<uint64_t>(settings.seed());
  const uint64_t hash =
      data::MixHash(data::MixHash(data::SplitMix64(seed), static_cast<uint64_t>(epoch)),
                    static_cast<uint64_t>(window.first_step));
  std::vector<std::pair<uint64_t, int64_t>> order;
  for (int64_t i = 0; i < examples; ++i) {
    order.emplace_back(data::MixHash(hash, static_cast<uint64_t>(i)), i);
  }
  std::ranges::sort(order);
  const int frames = HistoryFrames(settings.model());
  std::vector<SceneLoader::Item> items;
  for (int64_t i = first_step * batch_size; i < window.steps * batch_size; ++i) {
    items.push_back({order[static_cast<size_t>(i)].second,
                     DrawVariation(settings.augmentation(), frames, seed, epoch + 1,
                                   window.first_step * batch_size + i)});
  }
  return items;
}

}  // namespace maneuver::learning
