#include "model/learning/provenance.h"

#include <chrono>

namespace maneuver::learning {

v1::Provenance MakeProvenance(const v1::TrainingSettings& settings, const TrainingData& data,
                              const std::vector<std::string>& dataset_names,
                              const std::string& start_from, const std::string& trainer_version) {
  v1::Provenance provenance;
  for (const std::string& name : dataset_names) provenance.add_datasets(name);
  provenance.set_start_from(start_from);
  *provenance.mutable_settings() = settings;
  provenance.mutable_train_time()->set_seconds(
      std::chrono::duration_cast<std::chrono::seconds>(
          std::chrono::system_clock::now().time_since_epoch())
          .count());
  provenance.set_trainer_version(trainer_version);
  provenance.set_training_examples(data.TrainingExamples());
  provenance.set_validation_examples(static_cast<int64_t>(data.validation.examples.size()));
  return provenance;
}

}  // namespace maneuver::learning
