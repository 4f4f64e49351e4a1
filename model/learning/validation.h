// What an epoch is worth on examples that are not learned from.

#ifndef MANEUVER_MODEL_LEARNING_VALIDATION_H_
#define MANEUVER_MODEL_LEARNING_VALIDATION_H_

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "checkpoint.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"
#include "model/learning/scene_bound.h"
#include "model/learning/scene_loader.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

// Means over examples of named quantities.
class TermMeans {
 public:
  // values: [B], or one number that stands for `examples` of them.
  void Add(const std::string& name, const at::Tensor& values, int64_t examples);
  // Every term of a bound that is defined, by the names of BoundTerms.
  void Add(const BoundTerms& terms);
  void Write(google::protobuf::Map<std::string, double>* means) const;
  void Store(Checkpoint* checkpoint) const;
  void Restore(const Checkpoint& checkpoint);

 private:
  struct Sum {
    double sum = 0.0;
    int64_t count = 0;
  };
  std::map<std::string, Sum> sums_;
};

// The examples' trajectories relative to their references, [N, 2T] metres.
at::Tensor Trajectories(const std::vector<data::Example>& examples);

// At most `most` of the examples, drawn evenly, not varied.
std::vector<SceneLoader::Item> DrawItems(const ExampleSet& set, int64_t most);

// The labels of a batch's examples, [B]; -1 where there is none, and of mirrored examples: a
// mirrored left turn is not one. Undefined without any labels.
at::Tensor BatchLabels(const std::vector<int>& labels, const SceneLoader::Batch& batch);

// Smallest and largest standard deviation of the mixture's components.
void ReportMixture(const Networks& networks, v1::EpochReport* report);

// The base bound on trajectories, with the mean of q(z|x) for a sample.
void ValidateBase(const Networks& networks, const at::Tensor& trajectories, bool has_mixture,
                  v1::EpochReport* report);

// The bound of `objective` (see SceneBound) on the examples, with means for samples, and how the
// actions are used. Stops early, and then says nothing of use, when `stopped`.
void ValidateScenes(Networks& networks, const SceneSource& source, v1::Objective objective,
                    const v1::OptimizationSettings& optimization, int threads,
                    const std::function<bool()>& stopped, v1::EpochReport* report);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_VALIDATION_H_
