// Texts that people write: settings, configuration, tokens, labels, names.

#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "model/artifact/model_cost.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/training_presets.h"
#include "model/data/dataset_folder.h"
#include "model/data/label_file.h"
#include "server/maneuverd/configuration.h"
#include "server/security/identities.h"
#include "server/security/listen_address.h"
#include "server/security/resource_name.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

bool IsLower(char c) { return c >= 'a' && c <= 'z'; }
bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// [a-z][a-z0-9-]*, or jobs' [a-z0-9][a-z0-9-]*, at most 63 characters.
void ExpectSafeId(const std::string& id, bool may_begin_with_digit = false) {
  Expect(!id.empty() && id.size() <= 63, "an id has 1 to 63 characters");
  Expect(IsLower(id.front()) || (may_begin_with_digit && IsDigit(id.front())),
         "an id begins with a letter");
  for (const char c : id) Expect(IsLower(c) || IsDigit(c) || c == '-', "an id has safe characters");
}

void ExpectVersion(const security::ModelVersionName& version) {
  ExpectSafeId(version.model);
  Expect(version.version > 0 && version.version <= 999'999'999, "versions count from 1");
}

}  // namespace

void Names(std::string_view bytes) {
  const std::string_view field = "name";
  if (const auto name = security::ParseModelName(bytes, field); name.ok()) {
    ExpectSafeId(*name);
    Expect("models/" + *name == bytes, "a name has one spelling");
  }
  if (const auto name = security::ParseDatasetName(bytes, field); name.ok()) {
    ExpectSafeId(*name);
    Expect("datasets/" + *name == bytes, "a name has one spelling");
  }
  if (const auto name = security::ParseJobName(bytes, field); name.ok()) {
    ExpectSafeId(*name, true);
    Expect("jobs/" + *name == bytes, "a name has one spelling");
  }
  if (const auto name = security::ParseModelVersionName(bytes, field); name.ok()) {
    ExpectVersion(*name);
    Expect(name->ToString() == bytes, "a name has one spelling");
  }
  if (const auto name = security::ParseModelAliasName(bytes, field); name.ok()) {
    ExpectSafeId(name->model);
    ExpectSafeId(name->alias);
    Expect(name->ToString() == bytes, "a name has one spelling");
  }
  if (const auto name = security::ParseEvaluationName(bytes, field); name.ok()) {
    ExpectVersion(name->version);
    ExpectSafeId(name->evaluation);
    Expect(name->ToString() == bytes, "a name has one spelling");
  }
  if (const auto name = security::ParseModelReference(bytes, field); name.ok()) {
    if (const auto* version = std::get_if<security::ModelVersionName>(&*name)) {
      ExpectVersion(*version);
    } else {
      ExpectSafeId(std::get<security::ModelAliasName>(*name).model);
      ExpectSafeId(std::get<security::ModelAliasName>(*name).alias);
    }
  }
  if (const int version = security::ParseVersion(bytes); version != 0) {
    Expect(std::to_string(version) == bytes, "a version has one spelling");
  }
  if (const auto address = security::ParseListenAddress(bytes); address.ok()) {
    Expect(address->port >= 0 && address->port <= 65535, "a port is one");
    const auto again = security::ParseListenAddress(address->ToString());
    Expect(again.ok() && again->host == address->host && again->port == address->port,
           "an address is printed as it was read");
  }
}

void Tokens(std::string_view bytes) {
  const auto identities = security::Identities::Parse(bytes);
  if (!identities.ok()) {
    Expect(identities.status().code() == absl::StatusCode::kInvalidArgument,
           "a file is refused by its line");
    return;
  }
  size_t lines = 0;
  for (const absl::string_view line :
       absl::StrSplit(absl::string_view(bytes.data(), bytes.size()), '\n')) {
    const auto parsed = security::ParseIdentityLine(std::string_view(line.data(), line.size()));
    Expect(parsed.ok(), "a good file has good lines");
    if (*parsed) ++lines;
  }
  Expect(lines == identities->lines().size(), "each line counts once");
  for (const security::IdentityLine& line : identities->lines()) {
    Expect(!line.identity.name.empty() && line.identity.name.size() <= 63,
           "a name has 1 to 63 characters");
    Expect(line.kind != security::IdentityLine::Kind::kToken ||
               (line.credential.size() == 64 &&
                line.credential.find_first_not_of("0123456789abcdef") == std::string::npos),
           "a token is known by its SHA-256");
    Expect(!line.credential.empty(), "a credential is not empty");
    if (line.kind == security::IdentityLine::Kind::kCommonName) {
      Expect(identities->FindCertificate({}, line.credential) != nullptr, "a common name is found");
    }
  }
  // Nobody has these, whatever the file says.
  Expect(identities->FindToken("") == nullptr || bytes.find("e3b0c442") != std::string_view::npos,
         "no token is no credential");
  Expect(identities->FindCertificate({}, "") == nullptr, "no name is no credential");
}

void Configuration(std::string_view bytes) {
  const auto settings = ParseSettings(bytes, "maneuverd.conf");
  if (!settings.ok()) {
    Expect(settings.status().code() == absl::StatusCode::kInvalidArgument,
           "a file is refused by its line");
    return;
  }
  std::string text;
  std::set<std::string> names;
  for (const Setting& setting : *settings) {
    Expect(!setting.name.empty(), "a setting has a name");
    Expect(names.insert(setting.name).second, "a setting is given once");
    std::string value;
    for (const char c : setting.value) {
      if (c == '"' || c == '\\') value += '\\';
      if (c == '\n') {
        value += "\\n";
      } else {
        value += c;
      }
    }
    absl::StrAppend(&text, setting.name, " = \"", value, "\"\n");
  }
  const auto again = ParseSettings(text, "again");
  Expect(again.ok() && again->size() == settings->size(), "settings are printed as they were read");
  for (size_t i = 0; i < settings->size(); ++i) {
    Expect((*again)[i].name == (*settings)[i].name && (*again)[i].value == (*settings)[i].value,
           "values are printed as they were read");
  }
}

void Settings(std::string_view bytes) {
  v1::TrainingSettings settings;
  if (!ParseMessage(bytes, &settings)) return;
  const v1::TrainingSettings resolved = artifact::ResolveTrainingSettings(settings);
  const auto violations = artifact::ValidateTrainingSettings(resolved);
  for (const auto& violation : violations) {
    Expect(!violation.field.empty() && !violation.description.empty(),
           "a violation names its field");
  }
  if (!violations.empty()) return;
  Expect(artifact::ValidateModelSpec(resolved.model()).empty(), "valid settings have a valid spec");
  Expect(artifact::ResolveTrainingSettings(resolved).SerializeAsString() ==
             resolved.SerializeAsString(),
         "resolving twice changes nothing");
  for (const auto& [name, shape] : artifact::TensorShapes(resolved.model())) {
    int64_t count = 1;
    for (const int64_t size : shape) {
      Expect(size > 0 && !__builtin_mul_overflow(count, size, &count), "tensors have sizes");
    }
  }
  artifact::ValidateStart(settings, resolved.model());
}

void Labels(std::string_view bytes) {
  static const auto& folder = *new std::filesystem::path([] {
    const auto made = Folder() / "labelled";
    auto writer = data::DatasetWriter::Create(made, "fuzz");
    Expect(writer.ok(), writer.status().ToString());
    v1::Scenario scenario;
    scenario.set_scenario_id("town-1");
    for (const int id : {7, 8}) {
      v1::Agent* const agent = scenario.add_agents();
      agent->set_id(id);
      agent->set_type(id == 7 ? v1::AGENT_TYPE_VEHICLE : v1::AGENT_TYPE_PEDESTRIAN);
      agent->set_length(4);
      agent->set_width(2);
      for (int i = 0; i < 20; ++i) agent->add_states()->set_time(0.1 * i);
    }
    Expect((*writer)->Add(scenario).ok() && (*writer)->Commit().ok(), "the dataset is written");
    return made;
  }());
  const auto checked = data::CheckLabels(bytes, folder, {"turn_left", "stop"});
  Expect(checked.ok(), checked.status().ToString());
  Expect(checked->problems.size() <= data::kMostLabelProblems &&
             checked->problem_count >= static_cast<int64_t>(checked->problems.size()),
         "problems are listed up to a limit and counted beyond it");
  int64_t line = 0;
  for (const data::LabelProblem& problem : checked->problems) {
    Expect(problem.line >= line && !problem.what.empty(), "problems come in the order of lines");
    line = problem.line;
  }
  std::set<std::pair<int64_t, double>> moments;
  for (const v1::ManeuverAnnotation& annotation : checked->annotations) {
    Expect(annotation.scenario_id() == "town-1" && annotation.agent_id() == 7,
           "a label is of a vehicle that is there");
    Expect(annotation.start_time() == annotation.end_time() && annotation.start_time() >= -1.0 &&
               annotation.start_time() <= 3.0,
           "a label is of a moment that was recorded");
  }
}

}  // namespace maneuver::fuzz
