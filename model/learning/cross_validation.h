// Cross-validation: every recording is measured by a model that learned from no recording of its
// group. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_CROSS_VALIDATION_H_
#define MANEUVER_MODEL_LEARNING_CROSS_VALIDATION_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/cross_validation.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_blocks.h"

namespace maneuver::learning {

// A dataset that every model is measured on and none learns from.
struct NamedDataset {
  std::string name;
  std::filesystem::path folder;
};

struct CrossValidation {
  // Complete and valid (artifact/training_presets.h). `seeds` replaces its seed.
  v1::TrainingSettings settings;
  // Dataset folders to learn from and to measure.
  std::vector<std::filesystem::path> datasets;
  // Their names, for the report and the models' provenance; as many.
  std::vector<std::string> dataset_names;
  std::vector<NamedDataset> test_datasets;
  int folds = 5;
  int64_t fold_seed = 1;
  std::vector<int64_t> seeds = {1};  // of the trainings, each once
  std::optional<int> only_fold;      // counted from 0; empty: all of them
  // Seed and fold of each model to skip, because it was measured before.
  std::set<std::pair<int64_t, int>> finished;
  // Also train the anchor baselines in each fold.
  bool baselines = false;
  // Bytes of memory that recordings may take, about, while a model learns or is measured.
  int64_t data_memory = data::kDefaultDataMemory;
  // Existing folder for the models. A model is named seed-1-fold-2 (folds counted from 1) and must
  // not exist there yet.
  std::filesystem::path models;
  std::string trainer_version;
  // Called on the calling thread while a model learns. May be empty.
  std::function<void(const v1::JobProgress&)> progress;
  // Called before a model learns, with its seed and fold, and after it was measured. May be empty.
  std::function<void(int64_t seed, int fold)> began;
  std::function<void(const v1::FoldRun& run)> measured;
  // Asked often, from several threads; true ends it with CANCELLED. May be empty.
  std::function<bool()> stopped;
};

// Returns which recording belongs to which fold (data/recording_groups.h). Folds depend only on
// `datasets`, `folds` and `fold_seed`. A recording of a test dataset is left out if it shares a
// group with a recording of `datasets`.
// Reads the datasets once, or several times if the hashes of their places and drives take more than
// half of `data_memory`.
// Errors: those of data::ForEachScenario and data::AssignFolds; FAILED_PRECONDITION if all
// recordings of a test dataset are left out; CANCELLED.
absl::StatusOr<v1::CrossValidationPlan> PlanCrossValidation(const CrossValidation& run);

// Trains and measures the models of all seeds and folds that are not finished, one after the other.
// Each learns from the other folds, of which `validation_share` is held out for calibration, as in
// any training. The engine then loads the written model in f32 and measures it on the recordings of
// its fold and on the test datasets. The result does not depend on `data_memory` as long as the
// recordings that a model learns from fit. Besides that memory, the measurements of all examples
// are kept, some 1.3 kB each.
//   plan: what PlanCrossValidation returned for `run`
// Errors: those of Train and of evaluation::BlockMeasurer, with the seed and the fold; CANCELLED.
absl::StatusOr<v1::CrossValidationPart> CrossValidate(const CrossValidation& run,
                                                      const v1::CrossValidationPlan& plan);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CROSS_VALIDATION_H_
