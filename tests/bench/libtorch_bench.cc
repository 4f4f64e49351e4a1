// Measures LibTorch's forward pass of the same networks with the same weights, on one thread,
// without gradients, channels last, with only its own operations.

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/learning/networks.h"
#include "model/scene/target_motion.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {
namespace {

// Returns the backbone and the action predictor of a stored model.
learning::Networks MakeNetworks(const artifact::StoredModel& model) {
  at::NoGradGuard no_grad;
  at::Generator generator = learning::MakeGenerator(1);
  learning::Networks networks(model.manifest.spec(), at::Device(at::kCPU), generator);
  for (const auto& [name, tensor] : model.weights) {
    if (!name.starts_with("backbone.") && !name.starts_with("action_predictor.")) continue;
    networks[name].copy_(
        at::from_blob(const_cast<float*>(tensor.values.data()), tensor.shape, at::kFloat));
  }
  return networks;
}

at::Tensor RasterBatch(const artifact::StoredModel& model,
                       std::span<const inference::SceneInputsView> scenes) {
  const artifact::GridSize size = artifact::RasterGrid(model.manifest.spec().raster());
  std::vector<at::Tensor> rasters;
  for (const auto& scene : scenes) {
    rasters.push_back(at::empty({size.height, size.width, size.channels}, at::kByte));
    scene.raster->WriteInterleaved(
        {rasters.back().data_ptr<uint8_t>(), static_cast<size_t>(rasters.back().numel())});
  }
  return at::stack(rasters);
}

// Does the same as Networks::EncodeScenes without the kernels of model/learning.
//   rasters: [B, H, W, C] bytes; returns features [B, F']
at::Tensor EncodeScenes(learning::Networks& networks, const at::Tensor& rasters,
                        const at::Tensor& motions) {
  using Kind = artifact::BackboneLayer::Kind;
  const std::vector<artifact::BackboneLayer> layers = artifact::BackboneLayers(networks.spec());
  at::Tensor grids[artifact::kBackboneRegisters] = {
      rasters.permute({0, 3, 1, 2}).to(at::kFloat).mul_(1.0 / 255.0)};
  for (const artifact::BackboneLayer& layer : layers) {
    at::Tensor grid = grids[layer.source];
    if (layer.kind == Kind::kAveragePool) {
      grid = grid.mean({2, 3}, /*keepdim=*/true);
    } else if (layer.kind == Kind::kMaxPool) {
      grid = at::max_pool2d(grid, layer.kernel, layer.stride, layer.kernel / 2);
    } else {
      const std::string& norm = layer.normalization;
      grid = at::conv2d(grid, networks[layer.convolution + ".weight"], {}, layer.stride,
                        layer.kernel / 2);
      grid = at::batch_norm(grid, networks[norm + ".weight"], networks[norm + ".bias"],
                            networks[norm + ".running_mean"], networks[norm + ".running_var"],
                            /*training=*/false, 0.1, 1e-5, /*cudnn_enabled=*/false);
    }
    if (layer.adds) grid = grid + grids[layer.destination];
    grids[layer.destination] = layer.relu ? grid.relu() : grid;
  }
  const at::Tensor grid = grids[layers.back().destination].contiguous().flatten(1);
  const at::Tensor features =
      at::linear(grid, networks["backbone.projection.weight"], networks["backbone.projection.bias"])
          .relu();
  return networks.spec().target_motion() ? at::cat({features, motions}, 1) : features;
}

// Returns the largest difference of p(y|s) from the engine's, to check that both do the same.
double Difference(const std::string& preset, int batch, const at::Tensor& log_probabilities) {
  std::vector<inference::SceneEncoding> encodings(static_cast<size_t>(batch));
  LoadPreset(preset, inference::Precision::kF32)
      ->NewSession()
      ->Encode(Scenes(preset).first(encodings.size()), encodings);
  double largest = 0.0;
  for (size_t i = 0; i < encodings.size(); ++i) {
    const at::Tensor ours = at::from_blob(encodings[i].probabilities.data(),
                                          {encodings[i].probabilities.size()}, at::kDouble);
    const at::Tensor theirs = log_probabilities[static_cast<int64_t>(i)].exp().to(at::kDouble);
    largest = std::max(largest, (ours - theirs).abs().max().item<double>());
  }
  return largest;
}

at::Tensor MotionBatch(std::span<const inference::SceneInputsView> scenes) {
  const at::Tensor motions =
      at::empty({static_cast<int64_t>(scenes.size()), scene::kMotionInputs}, at::kFloat);
  for (size_t i = 0; i < scenes.size(); ++i) {
    std::copy_n(scenes[i].motion.data(), scene::kMotionInputs,
                motions.data_ptr<float>() + i * scene::kMotionInputs);
  }
  return motions;
}

void Encode(benchmark::State& state, const std::string& preset, int batch) {
  at::NoGradGuard no_grad;
  at::set_num_threads(1);
  learning::Networks networks = MakeNetworks(StoredPreset(preset));
  const at::Tensor rasters =
      RasterBatch(StoredPreset(preset), Scenes(preset).first(static_cast<size_t>(batch)));
  const at::Tensor motions = at::zeros({batch, scene::kMotionInputs});
  at::Tensor log_probabilities;
  for (auto _ : state) {
    log_probabilities = networks.PredictActions({EncodeScenes(networks, rasters, motions)});
  }
  CountTargets(state, batch);
  state.counters["difference"] = Difference(preset, batch, log_probabilities);
}

}  // namespace

PeerEncode LibTorchEncode(const artifact::StoredModel& model,
                          std::span<const inference::SceneInputsView> scenes) {
  const auto networks = std::make_shared<learning::Networks>(MakeNetworks(model));
  return [networks, rasters = RasterBatch(model, scenes), motions = MotionBatch(scenes)] {
    at::NoGradGuard no_grad;
    const int threads = at::get_num_threads();
    at::set_num_threads(1);
    networks->PredictActions({EncodeScenes(*networks, rasters, motions)});
    at::set_num_threads(threads);
  };
}

void RegisterLibTorchBenchmarks() {
  for (const char* preset : kPresets) {
    if (StoredPreset(preset).manifest.spec().has_scene_vectors()) continue;
    for (const int batch : kBatches) {
      const std::string name =
          "libtorch/encode/" + std::string(preset) + "/f32/batch:" + std::to_string(batch);
      benchmark::RegisterBenchmark(name.c_str(), Encode, std::string(preset), batch)
          ->Unit(benchmark::kMillisecond);
    }
  }
}

}  // namespace maneuver::bench
