// Measures an epoch on held-out examples.

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
  // Adds values of a quantity.
  //   values: [B], or one mean that stands for `examples` values
  void Add(const std::string& name, const at::Tensor& values, int64_t examples);
  // Adds every defined term of a bound, under the names of BoundTerms.
  void Add(const BoundTerms& terms);
  // Writes the mean of each quantity.
  void Write(google::protobuf::Map<std::string, double>* means) const;
  using StoredSums = google::protobuf::Map<std::string, StoredMean>;
  // Writes the sums, for a checkpoint or for the other ranks. Add adds what Store wrote.
  void Store(StoredSums* sums) const;
  void Add(const StoredSums& sums);

 private:
  struct Sum {
    double sum = 0.0;
    int64_t count = 0;
  };
  std::map<std::string, Sum> sums_;
};

// Returns the examples' trajectories relative to their references, [N, 2T] metres.
at::Tensor Trajectories(const std::vector<data::Example>& examples);

// Returns at most `most` of the examples, drawn evenly and not varied.
std::vector<SceneLoader::Item> DrawItems(const ExampleSet& set, int64_t most);

// Returns the labels of a batch's examples, [B]; undefined if there are no labels. It is -1 for an
// example without a label, and for a mirrored one, because a mirrored left turn is not a left turn.
at::Tensor BatchLabels(const std::vector<int>& labels, const SceneLoader::Batch& batch);

// Reports the smallest and largest standard deviation of the mixture's components.
void ReportMixture(const Networks& networks, v1::EpochReport* report);

// Reports the base bound on trajectories, with the mean of q(z|x) in place of a sample.
//   has_mixture: false: the mixture has not been placed yet, and p(z) is N(0, I)
void ValidateBase(const Networks& networks, const at::Tensor& trajectories, bool has_mixture,
                  v1::EpochReport* report);

// Reports the bound of `objective` (see SceneBound) on at most 2,048 of the examples, with means in
// place of samples, and how often the actions are used; on a quarter of these also the
// log-likelihood of the mixture at a waypoint. If `stopped`, ends early and reports only the
// mixture.
void ValidateScenes(Networks& networks, const SceneSource& source, v1::Objective objective,
                    const v1::OptimizationSettings& optimization, int threads,
                    const std::function<bool()>& stopped, v1::EpochReport* report);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_VALIDATION_H_
