#include "tests/bench/pipeline.h"

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <span>
#include <utility>

#include "model/probability/responsibilities.h"

namespace maneuver::bench {
namespace {

[[noreturn]] void Fail(const char* what) {
  std::cerr << "maneuver-bench: " << what << "\n";
  std::exit(EXIT_FAILURE);
}

constexpr size_t kBatch = static_cast<size_t>(kLargestBatch);

}  // namespace

const char* StageName(Stage stage) {
  switch (stage) {
    case Stage::kParse:
      return "parse";
    case Stage::kValidate:
      return "validate";
    case Stage::kRasterize:
      return "rasterise";
    case Stage::kBackbone:
      return "backbone";
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
                   int actions)
    : model_(model),
      networks_(*model.networks),
      actions_(actions),
      engine_(*model.model),
      scratch_(networks_.backbone.NewScratch()) {
  for (const v1::PredictRequest& request : requests) {
    bytes_.push_back(request.SerializeAsString());
    arenas_.push_back(std::make_unique<google::protobuf::Arena>());
    response_arenas_.push_back(std::make_unique<google::protobuf::Arena>());
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
  EvaluateBackbone();  // on its own: a session keeps it to itself
}

void Pipeline::Run(Stage stage) {
  switch (stage) {
    case Stage::kParse:
      return Parse();
    case Stage::kValidate:
      return Validate();
    case Stage::kRasterize:
      return Rasterize(0, work_.size());
    case Stage::kBackbone:
      return EvaluateBackbone();
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
    Rasterize(begin, std::min(kBatch, work_.size() - begin));
    encodings_.resize(scenes_.size());
    engine_.session().Encode(scenes_, encodings_);
    Describe(begin);
  }
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

void Pipeline::Rasterize(size_t begin, size_t count) {
  scenes_.resize(count);
  for (size_t i = 0; i < count; ++i) {
    scene::Raster* const raster = &engine_.Raster(i);
    const serving::Target& target = *work_[begin + i].target;
    serving::Draw(target, engine_.rasterizer(), raster);
    scenes_[i] = {raster, target.motion};
  }
}

void Pipeline::EvaluateBackbone() {
  const size_t size = static_cast<size_t>(networks_.projection.inputs());
  grids_.resize(scenes_.size() * size);
  for (size_t i = 0; i < scenes_.size(); ++i) {
    networks_.backbone.Evaluate(*scenes_[i].raster, scratch_.get(), grids_.data() + i * size);
  }
}

void Pipeline::EvaluateHeads() {
  const int rows = static_cast<int>(scenes_.size());
  const size_t projected = static_cast<size_t>(networks_.projection.outputs());
  const size_t features = static_cast<size_t>(networks_.action_predictor.inputs());
  const size_t actions = static_cast<size_t>(networks_.action_predictor.outputs());
  outputs_.resize(scenes_.size() * projected);
  networks_.projection.Apply(grids_.data(), rows, inference::Activation::kRelu, &mlp_scratch_.dense,
                             outputs_.data());
  features_.resize(scenes_.size() * features);
  for (size_t i = 0; i < scenes_.size(); ++i) {
    float* row = features_.data() + i * features;
    std::copy_n(outputs_.data() + i * projected, projected, row);
    std::copy_n(scenes_[i].motion.data(), features - projected, row + projected);
  }
  logits_.resize(scenes_.size() * actions);
  networks_.action_predictor.Apply(features_.data(), rows, &mlp_scratch_, logits_.data());
  encodings_.resize(scenes_.size());
  for (size_t i = 0; i < scenes_.size(); ++i) {
    encodings_[i].features = Eigen::Map<const Eigen::VectorXf>(features_.data() + i * features,
                                                               static_cast<Eigen::Index>(features));
    encodings_[i].probabilities =
        probability::Softmax(Eigen::Map<const Eigen::VectorXf>(logits_.data() + i * actions,
                                                               static_cast<Eigen::Index>(actions))
                                 .cast<double>());
  }
}

void Pipeline::Describe(size_t begin) {
  for (size_t i = 0; i < encodings_.size(); ++i) {
    serving::TargetAnswer& answer = *work_[begin + i].answer;
    const auto actions =
        serving::SelectActions(encodings_[i].probabilities, serving::TopK{actions_});
    answer.distributions =
        engine_.session().Describe(encodings_[i], actions, inference::LatentSource::kPosterior);
    answer.probabilities = encodings_[i].probabilities;
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
                          written_.back()->mutable_predictions());
  }
}

void Pipeline::Serialize() {
  for (size_t i = 0; i < written_.size(); ++i) written_[i]->SerializeToString(&responses_[i]);
}

}  // namespace maneuver::bench
