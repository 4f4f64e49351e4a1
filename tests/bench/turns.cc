#include "tests/bench/turns.h"

#include <fstream>
#include <istream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/scene/action_geometry.h"
#include "tests/bench/bench_scenes.h"
#include "tests/bench/interleaved.h"
#include "tests/bench/pipeline.h"

namespace maneuver::bench {
namespace {

// Appends the raster as [C, H, W] numbers from 0 to 1.
void AppendChannelsFirst(const scene::Raster& raster, std::vector<float>* values) {
  for (int channel = 0; channel < raster.channels(); ++channel) {
    for (int row = 0; row < raster.height(); ++row) {
      const uint8_t* const pixels = raster.Row(channel, row);
      for (int column = 0; column < raster.width(); ++column) {
        values->push_back(static_cast<float>(pixels[column]) / 255.0f);
      }
    }
  }
}

// An input of the exported networks (model/onnx/onnx_export.h).
struct Input {
  std::string name;
  std::vector<int64_t> sizes;
  std::vector<float> values;
};

void AddRasterInputs(const v1::ModelSpec& spec, std::span<const inference::SceneInputsView> scenes,
                     std::vector<Input>* inputs) {
  const auto N = static_cast<int64_t>(scenes.size());
  if (spec.has_raster()) {
    const artifact::GridSize size = artifact::RasterGrid(spec.raster());
    Input& raster =
        inputs->emplace_back(Input{"raster", {N, size.channels, size.height, size.width}, {}});
    for (const auto& scene : scenes) AppendChannelsFirst(*scene.raster, &raster.values);
  }
  if (spec.target_motion()) {
    Input& motion = inputs->emplace_back(Input{"motion", {N, scene::kMotionInputs}, {}});
    for (const auto& scene : scenes) {
      motion.values.insert(motion.values.end(), scene.motion.begin(), scene.motion.end());
    }
  }
}

// Adds `name`, [N, size, numbers], and `mask`, [N, size].
//   set: scene::SceneVectors's member, scene::LanePathInputs or scene::AgentInputs
template <typename Set>
void AddSetInputs(const std::string& name, const std::string& mask_name, int64_t size,
                  std::span<const inference::SceneInputsView> scenes, Set scene::SceneVectors::*set,
                  std::vector<Input>* inputs) {
  const auto N = static_cast<int64_t>(scenes.size());
  const auto numbers = static_cast<int64_t>(Set{}.values.size()) / size;
  Input elements{name, {N, size, numbers}, {}};
  Input mask{mask_name, {N, size}, {}};
  for (const auto& scene : scenes) {
    const Set& read = scene.vectors->*set;
    elements.values.insert(elements.values.end(), read.values.begin(), read.values.end());
    for (int64_t i = 0; i < size; ++i) mask.values.push_back(i < read.count ? 1.0f : 0.0f);
  }
  inputs->push_back(std::move(elements));
  inputs->push_back(std::move(mask));
}

void AddVectorInputs(const v1::ModelSpec& spec, std::span<const inference::SceneInputsView> scenes,
                     std::vector<Input>* inputs) {
  Input history{"history", {static_cast<int64_t>(scenes.size()), scene::kHistoryInputs}, {}};
  for (const auto& scene : scenes) {
    const scene::HistoryInputs& read = scene.vectors->history;
    history.values.insert(history.values.end(), read.begin(), read.end());
  }
  inputs->push_back(std::move(history));
  if (artifact::ReadsLanePaths(spec)) {
    AddSetInputs("lane_paths", "lane_path_mask", scene::kMostLanePaths, scenes,
                 &scene::SceneVectors::paths, inputs);
  }
  if (artifact::ReadsAgents(spec)) {
    AddSetInputs("agents", "agent_mask", scene::kMostNearAgents, scenes,
                 &scene::SceneVectors::agents, inputs);
  }
}

// Returns the mean trajectories of p(z|y), without a reference: at rest it is 0.
std::vector<inference::Trajectory> GenericTrajectories(const inference::ActionModel& model) {
  std::vector<int> actions(static_cast<size_t>(model.spec().actions()));
  std::iota(actions.begin(), actions.end(), 0);
  std::vector<inference::Trajectory> means;
  for (const auto& action :
       model.NewSession()->Describe(inference::DrivingStraight(model.spec(), 0.0), actions,
                                    inference::LatentSource::kPrior)) {
    means.emplace_back(action.mean());
  }
  return means;
}

// Compares the actions of a model with the lane paths of scenes: the inputs of the networks that
// only such models have.
class LaneComparison {
 public:
  //   scenes: must outlive this;  encodings: of the scenes, for their references
  LaneComparison(const inference::ActionModel& model,
                 std::span<const inference::SceneInputsView> scenes,
                 std::span<const inference::SceneEncoding> encodings)
      : scenes_(scenes),
        waypoints_(
            scene::FindGeometryWaypoints(artifact::WaypointTimes(model.spec().trajectory()))),
        inputs_version_(model.spec().inputs_version()),
        actions_(static_cast<size_t>(model.spec().actions())),
        paths_(scenes.size() * PathsOfScene()),
        numbers_(scenes.size() * NumbersOfScene()) {
    const auto generic = GenericTrajectories(model);
    for (const auto& encoding : encodings) {
      auto& points = points_.emplace_back();
      for (inference::Trajectory trajectory : generic) {
        if (encoding.reference.size() > 0) trajectory += encoding.reference;
        points.push_back(PointsOf(trajectory));
      }
    }
  }

  void Compare() {
    for (size_t n = 0; n < scenes_.size(); ++n) {
      scene::DescribeActions(points_[n], waypoints_, scenes_[n].vectors->paths,
                             scenes_[n].vectors->motion.speed, inputs_version_,
                             std::span(paths_).subspan(n * PathsOfScene(), PathsOfScene()),
                             std::span(numbers_).subspan(n * NumbersOfScene(), NumbersOfScene()));
    }
  }

  std::vector<Input> Inputs() const {
    const auto N = static_cast<int64_t>(scenes_.size());
    const auto K = static_cast<int64_t>(actions_);
    return {{"action_paths", {N, K, scene::kMostLanePaths, scene::kPairNumbers}, paths_},
            {"action_numbers", {N, K, scene::kActionNumbers}, numbers_}};
  }

 private:
  size_t PathsOfScene() const { return actions_ * scene::kMostLanePaths * scene::kPairNumbers; }
  size_t NumbersOfScene() const { return actions_ * scene::kActionNumbers; }

  scene::ActionPoints PointsOf(const inference::Trajectory& trajectory) const {
    scene::ActionPoints points;
    for (size_t t = 0; t < scene::kGeometryTimes; ++t) {
      for (size_t axis = 0; axis < 2; ++axis) {
        const auto at = [&](int waypoint) {
          return waypoint < 0
                     ? 0.0f
                     : static_cast<float>(trajectory(waypoint, static_cast<Eigen::Index>(axis)));
        };
        points.at[t][axis] = at(waypoints_.at[t]);
        points.before[t][axis] = at(waypoints_.before[t]);
      }
    }
    return points;
  }

  std::span<const inference::SceneInputsView> scenes_;
  scene::GeometryWaypoints waypoints_;
  int inputs_version_;
  size_t actions_;
  std::vector<std::vector<scene::ActionPoints>> points_;  // [scenes, actions]
  std::vector<float> paths_;                              // [scenes, K, paths, numbers]
  std::vector<float> numbers_;                            // [scenes, K, numbers]
};

std::vector<Input> InputsOf(const v1::ModelSpec& spec, const Pipeline& pipeline,
                            const LaneComparison* comparison) {
  std::vector<Input> inputs;
  AddRasterInputs(spec, pipeline.scenes(), &inputs);
  if (spec.has_scene_vectors()) AddVectorInputs(spec, pipeline.scenes(), &inputs);
  if (comparison != nullptr) {
    for (Input& input : comparison->Inputs()) inputs.push_back(std::move(input));
  }
  return inputs;
}

void Write(const std::vector<float>& values, std::ostream& out) {
  out.write(reinterpret_cast<const char*>(values.data()),
            static_cast<std::streamsize>(sizeof(float) * values.size()));
}

}  // namespace

absl::Status TakeTurns(const BenchModel& model, const std::vector<v1::Scenario>& scenes,
                       const std::filesystem::path& file, std::istream& in, std::ostream& out) {
  Pipeline pipeline(model, {RequestFor({scenes.front()}, 1)}, 1);
  nlohmann::ordered_json sizes = {{"model", model.name},
                                  {"precision", model.model->precision()},
                                  {"scenes", pipeline.targets()},
                                  {"actions", model.model->spec().actions()},
                                  {"inputs", nlohmann::ordered_json::array()}};
  const v1::ModelSpec& spec = model.model->spec();
  std::optional<LaneComparison> comparison;
  if (spec.has_action_geometry()) {
    comparison.emplace(*model.model, pipeline.scenes(), pipeline.encodings()).Compare();
  }
  std::ofstream written(file, std::ios::binary);
  for (const Input& input : InputsOf(spec, pipeline, comparison ? &*comparison : nullptr)) {
    sizes["inputs"].push_back({{"name", input.name}, {"sizes", input.sizes}});
    Write(input.values, written);
  }
  for (const auto& encoding : pipeline.encodings()) {
    const Eigen::VectorXf probabilities = encoding.probabilities.cast<float>();
    Write({probabilities.begin(), probabilities.end()}, written);
  }
  written.close();
  if (!written) return absl::UnavailableError(absl::StrCat("cannot write ", file.string()));
  out << sizes.dump() << std::endl;

  const auto session = model.model->NewSession();
  std::vector<inference::SceneEncoding> encodings(pipeline.scenes().size());
  std::string word;
  for (int repeats = 0; in >> word >> repeats && (word == "encode" || word == "compare");) {
    const double begin = ThreadSeconds();
    for (int i = 0; i < repeats; ++i) {
      if (word == "encode") session->Encode(pipeline.scenes(), encodings);
      if (word == "compare" && comparison) comparison->Compare();
    }
    out << ThreadSeconds() - begin << std::endl;
  }
  return absl::OkStatus();
}

}  // namespace maneuver::bench
