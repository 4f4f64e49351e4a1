// Computes one answer in process, from the bytes of a request to the bytes of its response, stage
// by stage. Makes the same calls as the server, without gRPC, queue and threads.

#ifndef MANEUVER_TESTS_BENCH_PIPELINE_H_
#define MANEUVER_TESTS_BENCH_PIPELINE_H_

#include <google/protobuf/arena.h>

#include <memory>
#include <string>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"
#include "model/inference/packed_networks.h"
#include "server/rpc/prediction_answers.h"
#include "server/serving/served_model.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {

enum class Stage {
  kParse,
  kValidate,       // and the targets' frames and motion
  kReadScene,      // raster, history, lane paths and agents, whichever the model reads
  kSceneNetwork,   // the backbone's last grid; of a model with scene vectors, its features
  kHeads,          // what is left to p(y|s)
  kDistributions,  // of the most probable actions
  kAnswer,         // the response's messages, in the world's frame
  kSerialize,
};
inline constexpr int kStages = 8;
// Returns the name of a stage for a table about a model.
const char* StageName(Stage stage, const v1::ModelSpec& spec);

class Pipeline {
 public:
  // Prepares the pipeline. `requests` and all their targets must be valid.
  //   actions: how many of the most probable actions are described for each target
  //   representatives: how many are chosen for each target, and described as well
  //   combinations: how many are found for each scenario; its targets must fit into a batch
  Pipeline(const BenchModel& model, const std::vector<v1::PredictRequest>& requests, int actions,
           int representatives = 0, int combinations = 0);

  // Runs a stage for all requests. The stages before it must have been run once. There may be at
  // most kLargestBatch targets, the most that a worker takes at once.
  void Run(Stage stage);
  // Run the two parts of the distributions: the scenario encoders, and the decoding of the sigma
  // points.
  void RunScenarioEncoders();
  void RunDecoder();
  // Runs everything as a worker does: batch by batch, backbone and heads by
  // InferenceSession::Encode.
  void RunAll();

  int targets() const { return targets_; }
  const std::vector<std::string>& responses() const { return responses_; }  // serialised
  // Return the results of the last batch.
  const std::vector<inference::SceneEncoding>& encodings() const { return encodings_; }
  const std::vector<inference::SceneInputsView>& scenes() const { return scenes_; }

 private:
  struct Work {
    const serving::Target* target;
    serving::TargetAnswer* answer;
  };

  void Parse();
  void Validate();
  void ReadScenes(size_t begin, size_t count);
  void EvaluateSceneNetwork();
  void EvaluateBackbone();
  void EvaluateVectors();
  void EvaluateHeads();
  // Writes features_.
  void ProjectGrids();
  // Reads features_ and, if actions look at the lanes, the results of EvaluateVectors.
  void PredictActions();
  // Computes the references, and the lanes' contribution to logits_.
  void EncodeActionGeometry();
  void Describe(size_t begin);
  void Combine();
  void WriteAnswers();
  void Serialize();

  const BenchModel& model_;
  const inference::PackedNetworks& networks_;
  const int actions_;
  const int representatives_;
  const int combinations_;
  serving::Engine engine_;
  inference::Backbone::ScratchPointer scratch_;
  inference::MlpScratch mlp_scratch_;
  int targets_ = 0;

  std::vector<std::string> bytes_;  // of the requests
  std::vector<std::unique_ptr<google::protobuf::Arena>> arenas_;
  std::vector<v1::PredictRequest*> received_;
  std::vector<rpc::PredictionPlan> plans_;
  std::vector<std::vector<serving::TargetAnswer>> answers_;  // of each request
  std::vector<std::vector<serving::JointAnswer>> joint_;     // of each request
  std::vector<Work> work_;                                   // of all requests
  std::vector<inference::SceneInputsView> scenes_;
  std::vector<float> grids_;
  std::vector<float> features_;  // [targets, F']
  std::vector<const scene::SceneVectors*> vectors_;
  inference::SceneVectorFeatures vector_features_;
  inference::ActionFeatures action_features_;
  std::vector<float> logits_;  // [targets, K]
  std::vector<float> outputs_;
  std::vector<inference::SceneEncoding> encodings_;
  std::vector<std::unique_ptr<google::protobuf::Arena>> response_arenas_;
  std::vector<v1::PredictResponse*> written_;
  std::vector<std::string> responses_;
};

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_PIPELINE_H_
