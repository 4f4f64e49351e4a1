// Exports learned weights as a model folder.

#ifndef MANEUVER_MODEL_LEARNING_EXPORT_H_
#define MANEUVER_MODEL_LEARNING_EXPORT_H_

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/model.pb.h"
#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/learning/training_data.h"
#include "model/learning/training_progress.h"

namespace maneuver::learning {

// The approximate number of held-out examples that a model is measured on. Recordings are measured
// completely, so the number may be a little larger.
inline constexpr int64_t kMostMeasured = 2048;

struct ExportOptions {
  std::filesystem::path output;
  int threads = 1;
  std::vector<std::string> labels;  // labels of the first actions
  // Derived names of the actions, [K]; empty: names are derived anew.
  std::vector<std::string> names;
  // How each action is used, [K]; empty: as the held-out examples use it.
  std::vector<v1::ActionUse> uses;
  // Baselines that are written to the folder and measured with the model.
  std::optional<artifact::StoredBaselines> baselines;
  int least_effective_actions = 0;  // see TrainingRun
  // Called with the numbers of measured and of all examples; returning false stops. May be empty.
  std::function<bool(int64_t done, int64_t total)> progress;
};

// Writes a model whose manifest has no actions yet to `output`, completely or not at all. First the
// engine that will serve the model loads it, decodes the generic action set, and measures it on the
// held-out examples. So actions and metrics are those that the server would answer.
// evaluation::NameActions names the actions. Without a held-out example there are no metrics, p(y)
// over the training examples is the usage, and all actions count as effective. Errors:
// FAILED_PRECONDITION with TrainingFailure::kCollapsed if fewer actions are effective, by at least
// 100 examples; those of evaluation::Evaluate but FAILED_PRECONDITION; those of writing and loading
// the folder.
absl::StatusOr<v1::ModelManifest> ExportModel(artifact::StoredModel model, const TrainingData& data,
                                              const v1::ExampleSettings& examples,
                                              const ExportOptions& options);

// Seconds that the parts of an export take.
struct ExportSeconds {
  double write = 0.0;    // writes the model, loads it and prepares the examples
  double measure = 0.0;  // measures all held-out examples
  double finish = 0.0;   // makes the report, names the actions and writes the manifest
};

// Exports a model as ExportModel does, but measures it on about a tenth of the examples, publishes
// nothing and leaves nothing behind. Returns how long a whole export takes. Returns nothing if
// there are too few held-out examples for that, if it fails, or if the progress of the options
// stops it.
//   clock: measures the time
std::optional<ExportSeconds> RehearseExport(artifact::StoredModel model, const TrainingData& data,
                                            const v1::ExampleSettings& examples,
                                            const ExportOptions& options,
                                            const TrainingProgress::Clock& clock);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EXPORT_H_
