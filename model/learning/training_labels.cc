#include "model/learning/training_labels.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/data/stable_hash.h"

namespace maneuver::learning {

absl::StatusOr<std::shared_ptr<const TrainingLabels>> TrainingLabels::Make(
    std::vector<v1::ManeuverAnnotation> annotations, const v1::TrainingSettings& settings) {
  std::shared_ptr<const TrainingLabels> labels(
      new TrainingLabels(std::move(annotations), settings));
  if (static_cast<int>(labels->names().size()) <= settings.model().actions()) return labels;
  return absl::FailedPreconditionError(
      absl::StrCat("the recordings are labelled with ", labels->names().size(),
                   " different manoeuvres; raise model.actions (", settings.model().actions(),
                   ") to as many, or set examples.label_share to 0"));
}

TrainingLabels::TrainingLabels(std::vector<v1::ManeuverAnnotation> annotations,
                               const v1::TrainingSettings& settings)
    : annotations_(std::move(annotations)),
      recorded_(annotations_),
      share_(settings.examples().label_share()),
      horizon_(artifact::WaypointTimes(settings.model().trajectory()).back()),
      names_(recorded_.names()) {
  std::ranges::sort(names_);
}

int TrainingLabels::Of(const std::string& scenario_id, const data::Example& example) const {
  const uint64_t hash = data::MixHash(
      data::MixHash(data::StableHash(scenario_id), static_cast<uint64_t>(example.target_id)),
      static_cast<uint64_t>(std::llround(example.time * 1000.0)));
  // Once more, so that it does not choose as the drawing of standing vehicles does.
  if (data::UnitInterval(data::MixHash(hash, 1)) >= share_) return -1;
  const std::optional<int> found =
      recorded_.Over(scenario_id, example.target_id, example.time, example.time + horizon_);
  if (!found) return -1;
  const std::string& name = recorded_.names()[static_cast<size_t>(*found)];
  return static_cast<int>(std::ranges::lower_bound(names_, name) - names_.begin());
}

}  // namespace maneuver::learning
