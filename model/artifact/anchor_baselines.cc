#include "model/artifact/anchor_baselines.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "maneuver/v1/model.pb.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/model_weights.h"
#include "model/artifact/safetensors.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/sealed_json.h"

namespace maneuver::artifact {
namespace {

namespace fs = std::filesystem;

constexpr int kBaselinesFormat = 1;
constexpr char kDescription[] = "baselines.json";
constexpr char kWeights[] = "baselines.safetensors";
constexpr char kCovernet[] = "covernet/";
constexpr char kMultipath[] = "multipath/";

bool IsAnchors(const std::string& name) {
  return absl::StartsWith(name, "anchors.") || absl::StartsWith(name, "anchor_regression.");
}

std::map<std::string, std::vector<int64_t>> AnchorShapes(const v1::ModelSpec& spec,
                                                         bool regresses) {
  const int64_t K = spec.actions();
  const int64_t T = spec.trajectory().waypoints();
  std::map<std::string, std::vector<int64_t>> shapes = {{"anchors.mean", {K, T, 2}}};
  if (!regresses) {
    shapes["anchors.covariance"] = {K, T, 3};
    return shapes;
  }
  shapes["anchors.scale"] = {T};
  int64_t inputs = SceneFeatureCount(spec);
  const v1::MlpSpec& hidden = spec.action_predictor();
  for (int i = 0; i <= hidden.hidden_size(); ++i) {
    const int64_t outputs =
        i < hidden.hidden_size() ? hidden.hidden(i) : K * T * AnchorGaussian::kNumbers;
    shapes[absl::StrCat("anchor_regression.", i, ".weight")] = {outputs, inputs};
    shapes[absl::StrCat("anchor_regression.", i, ".bias")] = {outputs};
    inputs = outputs;
  }
  return shapes;
}

// Returns the first fault of a baseline's tensors; empty if there is none.
std::string FindFault(const v1::ModelSpec& spec, const TensorMap& weights, bool regresses) {
  TensorMap scene;
  TensorMap anchors;
  for (const auto& [name, tensor] : weights) (IsAnchors(name) ? anchors : scene)[name] = tensor;
  const std::string fault = FindWeightFault(spec, scene);
  if (!fault.empty()) return fault;
  const auto shapes = AnchorShapes(spec, regresses);
  for (const auto& [name, shape] : shapes) {
    const auto found = anchors.find(name);
    if (found == anchors.end()) return absl::StrCat("tensor ", name, " is missing");
    if (found->second.shape != shape)
      return absl::StrCat("tensor ", name, " has a shape that does not fit the model");
    if (!std::all_of(found->second.values.begin(), found->second.values.end(),
                     [](float value) { return std::isfinite(value); })) {
      return absl::StrCat("tensor ", name, " holds a value that is not finite");
    }
  }
  if (anchors.size() != shapes.size()) return "there are tensors that are not part of the spec";
  if (regresses) {
    const std::vector<float>& scale = anchors.at("anchors.scale").values;
    const bool positive =
        std::all_of(scale.begin(), scale.end(), [](float value) { return value > 0; });
    return positive ? "" : "tensor anchors.scale holds a factor that is not positive";
  }
  const std::vector<float>& covariance = anchors.at("anchors.covariance").values;
  for (size_t i = 0; i + 2 < covariance.size(); i += 3) {
    const double determinant =
        double{covariance[i]} * covariance[i + 2] - double{covariance[i + 1]} * covariance[i + 1];
    if (!(covariance[i] > 0) || !(determinant > 0)) {
      return "tensor anchors.covariance holds a matrix that is not positive definite";
    }
  }
  return "";
}

std::string FindSpecFault(const v1::ModelSpec& spec) {
  const auto violations = ValidateModelSpec(spec);
  if (violations.empty()) return "";
  return absl::StrCat("spec.", violations[0].field, ": ", violations[0].description);
}

// Of weights for a valid spec.
std::string FindWeightsFault(const StoredBaselines& baselines) {
  const std::string fault = FindFault(baselines.spec, baselines.covernet, /*regresses=*/false);
  if (!fault.empty()) return absl::StrCat(kCovernet, " ", fault);
  const std::string other = FindFault(baselines.spec, baselines.multipath, /*regresses=*/true);
  return other.empty() ? "" : absl::StrCat(kMultipath, " ", other);
}

}  // namespace

v1::ModelSpec AnchorSpec(const v1::ModelSpec& model) {
  v1::ModelSpec spec = model;
  spec.set_latent_dimensions(1);
  spec.set_objective(v1::OBJECTIVE_BASE);
  spec.clear_action_geometry();
  spec.clear_mean_residual();
  spec.clear_scene_covariance();
  spec.clear_decoder_covariance();
  for (v1::MlpSpec* latent : {spec.mutable_trajectory_encoder(), spec.mutable_decoder(),
                              spec.mutable_scenario_encoder()}) {
    latent->clear_hidden();
    latent->add_hidden(1);
  }
  return spec;
}

absl::Status WriteBaselines(const fs::path& folder, const StoredBaselines& baselines) {
  std::string fault = FindSpecFault(baselines.spec);
  if (fault.empty()) fault = FindWeightsFault(baselines);
  if (!fault.empty()) return absl::InvalidArgumentError(fault);
  TensorMap both;
  for (const auto& [name, tensor] : baselines.covernet) both[kCovernet + name] = tensor;
  for (const auto& [name, tensor] : baselines.multipath) both[kMultipath + name] = tensor;
  const std::string weights = SerializeSafetensors(both);
  v1::ModelManifest description;
  description.set_format_version(kBaselinesFormat);
  *description.mutable_spec() = baselines.spec;
  description.set_weights_sha256(files::Sha256Hex(weights));
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto printed = google::protobuf::util::MessageToJsonString(description, &json, options);
  if (!printed.ok()) {
    return absl::InternalError(
        absl::StrCat("cannot write the baselines as JSON: ", std::string(printed.message())));
  }
  // Writes the description last: without it the folder has no baselines.
  if (auto status = files::WriteFileAtomically(folder / kWeights, weights); !status.ok()) {
    return status;
  }
  return files::WriteFileAtomically(folder / kDescription, files::Seal(json));
}

absl::StatusOr<StoredBaselines> ReadBaselines(const fs::path& folder) {
  const absl::StatusOr<std::string> text = files::ReadFile(folder / kDescription);
  if (absl::IsNotFound(text.status())) {
    return absl::NotFoundError("the model folder carries no baselines");
  }
  if (!text.ok()) return text.status();
  const absl::StatusOr<std::string> json = files::Unseal(*text);
  if (!json.ok()) {
    return absl::DataLossError(absl::StrCat(kDescription, " ", json.status().message()));
  }
  v1::ModelManifest description;
  const auto parsed = google::protobuf::util::JsonStringToMessage(*json, &description);
  if (!parsed.ok()) {
    return absl::DataLossError(
        absl::StrCat(kDescription, " does not parse: ", std::string(parsed.message())));
  }
  if (description.format_version() != kBaselinesFormat) {
    return absl::DataLossError(absl::StrCat(kDescription, " has format version ",
                                            description.format_version(), ", this reads version ",
                                            kBaselinesFormat));
  }
  if (const std::string fault = FindSpecFault(description.spec()); !fault.empty()) {
    return absl::DataLossError(absl::StrCat(kDescription, ": ", fault));
  }
  const absl::StatusOr<std::string> bytes = files::ReadFile(folder / kWeights);
  if (absl::IsNotFound(bytes.status())) {
    return absl::DataLossError(absl::StrCat(kWeights, " is missing"));
  }
  if (!bytes.ok()) return bytes.status();
  if (files::Sha256Hex(*bytes) != description.weights_sha256()) {
    return absl::DataLossError(absl::StrCat(kWeights, " (", bytes->size(),
                                            " bytes) is truncated or altered: its SHA-256 is not "
                                            "what ",
                                            kDescription, " says"));
  }
  absl::StatusOr<TensorMap> both = ParseSafetensors(*bytes);
  if (!both.ok()) {
    return absl::DataLossError(absl::StrCat(kWeights, ": ", both.status().message()));
  }
  StoredBaselines baselines;
  baselines.spec = description.spec();
  for (auto& [name, tensor] : *both) {
    absl::string_view rest = name;
    const bool covernet = absl::ConsumePrefix(&rest, kCovernet);
    if (!covernet && !absl::ConsumePrefix(&rest, kMultipath)) {
      return absl::DataLossError(absl::StrCat(kWeights, ": tensor ", name, " is of no baseline"));
    }
    (covernet ? baselines.covernet : baselines.multipath)[std::string(rest)] = std::move(tensor);
  }
  const std::string fault = FindWeightsFault(baselines);
  if (!fault.empty()) return absl::DataLossError(absl::StrCat(kWeights, ": ", fault));
  return baselines;
}

absl::Status CopyBaselines(const fs::path& from, const fs::path& to) {
  const absl::StatusOr<StoredBaselines> baselines = ReadBaselines(from);
  if (absl::IsNotFound(baselines.status())) return absl::OkStatus();
  return baselines.ok() ? WriteBaselines(to, *baselines) : baselines.status();
}

}  // namespace maneuver::artifact
