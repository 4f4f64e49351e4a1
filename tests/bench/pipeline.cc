#include "tests/bench/pipeline.h"

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <span>
#include <utility>

#include "model/artifact/model_spec.h"
#include "model/probability/responsibilities.h"
#include "model/scene/motion_reference.h"
#include "server/rpc/arena_messages.h"
#include "server/serving/joint_answer.h"

namespace maneuver::bench {
namespace {

[[noreturn]] void Fail(const char* what) {
  std::cerr << "maneuver-bench: " << what << "\n";
  std::exit(EXIT_FAILURE);
}

constexpr size_t kBatch = static_cast<size_t>(kLargestBatch);

// Returns the reference; empty for a model without one.
inference::Trajectory RollOut(const v1::ModelSpec& spec, const scene::MotionEstimate& motion) {
  inference::Trajectory reference;
  if (!artifact::HasReference(spec)) return reference;
  const std::vector<double> times = artifact::WaypointTimes(spec.trajectory());
  reference.resize(static_cast<Eigen::Index>(times.size()), 2);
  scene::RollOut(spec.reference(), spec.inputs_version(), motion, times,
                 {reference.data(), static_cast<size_t>(reference.size())});
  return reference;
}

}  // namespace

const char* StageName(Stage stage, const v1::ModelSpec& spec) {
  switch (stage) {
    case Stage::kParse:
      return "parse";
    case Stage::kValidate:
      return "validate";
    case Stage::kReadScene:
      return spec.has_scene_vectors() ? "read scene" : "rasterise";
    case Stage::kSceneNetwork:
      return spec.has_scene_vectors() ? "scene network" : "backbone";
    case Stage::kHeads:
      return "heads";
    case Stage::kDistributions:
      return "distributions";
    case Stage::kAnswer:
      return "answer";
    case Stage::kSerialize:
      return "serialise";
  }
  return "";
}

Pipeline::Pipeline(const BenchModel& model, const std::vector<v1::PredictRequest>& requests,
                   int actions, int representatives, int combinations)
    : model_(model),
      networks_(*model.networks),
      actions_(actions),
      representatives_(representatives),
      combinations_(combinations),
      engine_(*model.model),
      scratch_(networks_.backbone ? networks_.backbone->NewScratch() : nullptr) {
  for (const v1::PredictRequest& request : requests) {
    bytes_.push_back(request.SerializeAsString());
    arenas_.push_back(std::make_unique<google::protobuf::Arena>(rpc::CallArenaOptions()));
    response_arenas_.push_back(std::make_unique<google::protobuf::Arena>(rpc::CallArenaOptions()));
  }
  responses_.resize(bytes_.size());
  Parse();
  Validate();
  targets_ = static_cast<int>(work_.size());
  int named = 0;
  for (const v1::PredictRequest* request : received_) {
    for (const v1::Scenario& scenario : request->scenarios()) named += scenario.target_ids_size();
  }
  if (targets_ == 0 || targets_ != named) Fail("a scene to measure with is not valid");
  RunAll();
  EvaluateSceneNetwork();  // on its own: a session keeps it to itself
}

void Pipeline::Run(Stage stage) {
  switch (stage) {
    case Stage::kParse:
      return Parse();
    case Stage::kValidate:
      return Validate();
    case Stage::kReadScene:
      return ReadScenes(0, work_.size());
    case Stage::kSceneNetwork:
      return EvaluateSceneNetwork();
    case Stage::kHeads:
      return EvaluateHeads();
    case Stage::kDistributions:
      return Describe(0);
    case Stage::kAnswer:
      return WriteAnswers();
    case Stage::kSerialize:
      return Serialize();
  }
}

void Pipeline::RunAll() {
  Parse();
  Validate();
  for (size_t begin = 0; begin < work_.size(); begin += kBatch) {
    ReadScenes(begin, std::min(kBatch, work_.size() - begin));
    encodings_.resize(scenes_.size());
    engine_.session().Encode(scenes_, encodings_);
    Describe(begin);
  }
  Combine();
  WriteAnswers();
  Serialize();
}

void Pipeline::Parse() {
  received_.clear();
  for (size_t i = 0; i < bytes_.size(); ++i) {
    arenas_[i]->Reset();
    received_.push_back(
        google::protobuf::Arena::CreateMessage<v1::PredictRequest>(arenas_[i].get()));
    if (!received_.back()->ParseFromString(bytes_[i])) Fail("a request does not parse");
  }
}

void Pipeline::Validate() {
  plans_.clear();
  work_.clear();
  answers_.resize(received_.size());
  for (size_t i = 0; i < received_.size(); ++i) {
    plans_.push_back(
        rpc::PlanPrediction(received_[i]->scenarios(), model_.model->spec(), {}, false));
    const std::vector<serving::Target>& targets = plans_.back().targets;
    answers_[i].resize(targets.size());
    for (size_t t = 0; t < targets.size(); ++t) work_.push_back({&targets[t], &answers_[i][t]});
  }
}

void Pipeline::ReadScenes(size_t begin, size_t count) {
  scenes_.resize(count);
  for (size_t i = 0; i < count; ++i) {
    scene::SceneInputs& inputs = engine_.Inputs(i);
    serving::ReadScene(*work_[begin + i].target, engine_.reader(), &inputs);
    scenes_[i] = inference::ViewOf(inputs);
  }
}

void Pipeline::EvaluateSceneNetwork() {
  if (networks_.backbone) EvaluateBackbone();
  if (networks_.scene) EvaluateVectors();
}

void Pipeline::EvaluateBackbone() {
  const size_t size = static_cast<size_t>(networks_.projection->inputs());
  grids_.resize(scenes_.size() * size);
  for (size_t i = 0; i < scenes_.size(); ++i) {
    networks_.backbone->Evaluate(*scenes_[i].raster, scratch_.get(), grids_.data() + i * size);
  }
}

void Pipeline::ProjectGrids() {
  features_.resize(scenes_.size() * static_cast<size_t>(networks_.projection->outputs()));
  networks_.projection->Apply(grids_.data(), static_cast<int>(scenes_.size()),
                              inference::Activation::kRelu, &mlp_scratch_.dense, features_.data());
}

void Pipeline::EvaluateVectors() {
  if (networks_.backbone) ProjectGrids();
  vectors_.clear();
  for (const inference::SceneInputsView& scene : scenes_) vectors_.push_back(scene.vectors);
  networks_.scene->Evaluate(vectors_, networks_.backbone ? features_.data() : nullptr,
                            &vector_features_);
}

void Pipeline::EvaluateHeads() {
  encodings_.resize(scenes_.size());
  if (networks_.scene) {
    features_ = vector_features_.features;
    return PredictActions();
  }
  ProjectGrids();
  // Appends the targets' motion to the features if the model reads it.
  const size_t projected = static_cast<size_t>(networks_.projection->outputs());
  const size_t features = static_cast<size_t>(networks_.action_predictor.inputs());
  outputs_.swap(features_);
  features_.resize(scenes_.size() * features);
  for (size_t i = 0; i < scenes_.size(); ++i) {
    float* row = features_.data() + i * features;
    std::copy_n(outputs_.data() + i * projected, projected, row);
    std::copy_n(scenes_[i].motion.data(), features - projected, row + projected);
  }
  PredictActions();
}

void Pipeline::PredictActions() {
  const size_t features = static_cast<size_t>(networks_.action_predictor.inputs());
  const size_t actions = static_cast<size_t>(networks_.action_predictor.outputs());
  logits_.resize(scenes_.size() * actions);
  networks_.action_predictor.Apply(features_.data(), static_cast<int>(scenes_.size()),
                                   &mlp_scratch_, logits_.data());
  if (networks_.scene) EncodeActionGeometry();
  for (size_t i = 0; i < scenes_.size(); ++i) {
    encodings_[i].features = Eigen::Map<const Eigen::VectorXf>(features_.data() + i * features,
                                                               static_cast<Eigen::Index>(features));
    encodings_[i].probabilities =
        probability::Softmax(Eigen::Map<const Eigen::VectorXf>(logits_.data() + i * actions,
                                                               static_cast<Eigen::Index>(actions))
                                 .cast<double>());
  }
}

void Pipeline::EncodeActionGeometry() {
  std::vector<const inference::Trajectory*> references;
  for (size_t i = 0; i < scenes_.size(); ++i) {
    const scene::MotionEstimate& motion = vectors_[i]->motion;
    encodings_[i].speed = motion.speed;
    encodings_[i].reference = RollOut(model_.model->spec(), motion);
    references.push_back(&encodings_[i].reference);
  }
  if (!networks_.actions) return;
  networks_.actions->Evaluate(vectors_, references, vector_features_, &action_features_);
  for (size_t i = 0; i < logits_.size(); ++i) logits_[i] += action_features_.logits[i];
  const Eigen::Index actions = networks_.action_predictor.outputs();
  const Eigen::Index features = networks_.actions->features();
  for (size_t i = 0; i < scenes_.size(); ++i) {
    auto& geometry = encodings_[i].geometry;
    geometry.resize(actions, features);
    std::copy_n(action_features_.geometry.data() + static_cast<Eigen::Index>(i) * geometry.size(),
                geometry.size(), geometry.data());
  }
}

void Pipeline::Describe(size_t begin) {
  const serving::DescribeActions question{.selection = serving::TopK{actions_},
                                          .representatives = representatives_,
                                          .combinations = combinations_};
  const double waypoint_interval = artifact::WaypointInterval(model_.model->spec().trajectory());
  for (size_t i = 0; i < encodings_.size(); ++i) {
    serving::TargetAnswer& answer = *work_[begin + i].answer;
    serving::DescribeTarget(question, encodings_[i], waypoint_interval, engine_.session(), &answer);
    answer.encoding.probabilities = encodings_[i].probabilities;
    if (combinations_ > 0) answer.encoding = encodings_[i];
  }
}

void Pipeline::Combine() {
  joint_.assign(received_.size(), {});
  if (combinations_ == 0) return;
  const double waypoint_interval = artifact::WaypointInterval(model_.model->spec().trajectory());
  const serving::DescribeActions question{.combinations = combinations_};
  for (size_t i = 0; i < received_.size(); ++i) {
    for (const serving::TargetRange& range : serving::ScenariosOf(plans_[i].targets)) {
      joint_[i].push_back(serving::CombineTargets(
          question, plans_[i].targets, range, waypoint_interval, engine_.session(), answers_[i]));
    }
  }
}

void Pipeline::RunScenarioEncoders() {
  outputs_.resize(static_cast<size_t>(networks_.scenario_encoders.front().outputs()));
  for (const inference::SceneEncoding& encoding : encodings_) {
    for (const int action :
         serving::SelectActions(encoding.probabilities, serving::TopK{actions_})) {
      networks_.scenario_encoders[static_cast<size_t>(action)].Apply(
          encoding.features.data(), 1, &mlp_scratch_, outputs_.data());
    }
  }
}

void Pipeline::RunDecoder() {
  const int rows = actions_ * (2 * networks_.decoder.inputs() + 1);
  outputs_.resize(static_cast<size_t>(rows) * static_cast<size_t>(networks_.decoder.outputs()));
  const std::vector<float> latents(
      static_cast<size_t>(rows) * static_cast<size_t>(networks_.decoder.inputs()), 0.5f);
  for (size_t i = 0; i < encodings_.size(); ++i) {
    networks_.decoder.Apply(latents.data(), rows, &mlp_scratch_, outputs_.data());
  }
}

void Pipeline::WriteAnswers() {
  written_.clear();
  for (size_t i = 0; i < received_.size(); ++i) {
    google::protobuf::Arena* arena = response_arenas_[i].get();
    arena->Reset();
    written_.push_back(google::protobuf::Arena::CreateMessage<v1::PredictResponse>(arena));
    rpc::WritePredictions(received_[i]->scenarios(), plans_[i], answers_[i], {},
                          written_.back()->mutable_predictions(), joint_[i]);
  }
}

void Pipeline::Serialize() {
  for (size_t i = 0; i < written_.size(); ++i) written_[i]->SerializeToString(&responses_[i]);
}

}  // namespace maneuver::bench
