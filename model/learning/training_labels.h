// Which action a training example is known to be. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_TRAINING_LABELS_H_
#define MANEUVER_MODEL_LEARNING_TRAINING_LABELS_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/example_index.h"
#include "model/evaluation/maneuver_labels.h"

namespace maneuver::learning {

// Labels label_share of the examples by their recorded manoeuvres. They are chosen by a hash, so
// that the same ones are labelled whatever else is in the datasets. Immutable.
class TrainingLabels {
 public:
  // FAILED_PRECONDITION if more manoeuvres are recorded than the model has actions.
  //   annotations: those of the training recordings;  settings: complete
  static absl::StatusOr<std::shared_ptr<const TrainingLabels>> Make(
      std::vector<v1::ManeuverAnnotation> annotations, const v1::TrainingSettings& settings);

  // Names of the manoeuvres, sorted.
  const std::vector<std::string>& names() const { return names_; }
  // Returns the index in names() of the manoeuvre that an example is known to be, or -1.
  int Of(const std::string& scenario_id, const data::Example& example) const;

 private:
  TrainingLabels(std::vector<v1::ManeuverAnnotation> annotations,
                 const v1::TrainingSettings& settings);

  const std::vector<v1::ManeuverAnnotation> annotations_;
  const evaluation::ManeuverLabels recorded_;
  const double share_;
  const double horizon_;  // seconds
  std::vector<std::string> names_;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAINING_LABELS_H_
