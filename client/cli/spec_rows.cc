#include "client/cli/spec_rows.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/evaluation/cost_text.h"

namespace maneuver::cli {
namespace {

std::string ReferenceText(v1::TrajectoryReference reference) {
  switch (reference) {
    case v1::TRAJECTORY_REFERENCE_CONSTANT_VELOCITY:
      return "relative to constant velocity";
    case v1::TRAJECTORY_REFERENCE_FADING_MOTION:
      return "relative to the present motion as it fades out";
    default:
      return "in metres from where the target is";
  }
}

std::string VectorsText(const v1::ModelSpec& spec) {
  std::string text = "the target's past second";
  if (artifact::ReadsLanePaths(spec)) text += ", lane paths";
  if (artifact::ReadsAgents(spec)) text += ", agents nearby";
  return text;
}

}  // namespace

void AddSpecRows(const v1::ModelSpec& spec, const v1::ModelCost& cost, Table* table) {
  table->Add({"predicts", artifact::TargetTypesText(spec)});
  table->Add({"trajectories", ReferenceText(spec.reference())});
  if (spec.has_raster()) {
    table->Add({"raster", absl::StrCat(spec.raster().width(), " x ", spec.raster().height(), " at ",
                                       spec.raster().meters_per_pixel(), " m a pixel")});
    table->Add({"backbone", evaluation::BackboneCostText(cost)});
  }
  if (spec.has_scene_vectors()) table->Add({"vectors", VectorsText(spec)});
  if (spec.has_action_geometry()) {
    table->Add({"actions look at", "the lane paths, each along its own trajectory"});
  }
  if (spec.mean_residual()) table->Add({"means", "also depend on the scene directly"});
  if (spec.has_scene_covariance()) {
    table->Add({"covariance", "predicted from the scene"});
  } else if (spec.has_decoder_covariance()) {
    table->Add({"covariance", "predicted from the latent"});
  }
  table->Add({"whole model", evaluation::ModelCostText(cost)});
}

}  // namespace maneuver::cli
