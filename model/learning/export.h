// From learned weights to a model folder.

#ifndef MANEUVER_MODEL_LEARNING_EXPORT_H_
#define MANEUVER_MODEL_LEARNING_EXPORT_H_

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

struct ExportOptions {
  std::filesystem::path output;
  int threads = 1;
  std::vector<std::string> labels;  // of the first actions
  // Derived names of the actions, which then are not made anew; empty: they are. [K]
  std::vector<std::string> names;
  // Goes into the folder with the model and is measured with it.
  std::optional<artifact::StoredBaselines> baselines;
  int least_effective_actions = 0;  // see TrainingRun
  // Called with examples measured and in all; false stops. May be empty.
  std::function<bool(int64_t done, int64_t total)> progress;
};

// Writes a model whose manifest has no actions yet to `output`, whole or not at all. Before it
// appears there it is loaded by the engine that will serve it, which decodes the generic action set
// and measures it on the held-out examples: actions and metrics are what the server would answer.
// Actions are named by evaluation::NameActions.
absl::StatusOr<v1::ModelManifest> ExportModel(artifact::StoredModel model, const TrainingData& data,
                                              const v1::ExampleSettings& examples,
                                              const ExportOptions& options);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EXPORT_H_
