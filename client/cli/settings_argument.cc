#include "client/cli/settings_argument.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/json_files.h"
#include "client/cli/text_format.h"
#include "model/artifact/training_presets.h"

namespace maneuver::cli {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

bool IsDuration(const FieldDescriptor& field) {
  return field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE &&
         field.message_type()->full_name() == "google.protobuf.Duration";
}

std::string FieldNames(const Descriptor& descriptor) {
  std::vector<std::string> names;
  for (int i = 0; i < descriptor.field_count(); ++i) names.push_back(descriptor.field(i)->name());
  return absl::StrJoin(names, ", ");
}

// What the names of an enumeration's values begin with: that of Objective, with OBJECTIVE_BASE, is
// "OBJECTIVE_".
std::string ValuePrefix(const google::protobuf::EnumDescriptor& enumeration) {
  return std::string(absl::StripSuffix(enumeration.value(0)->name(), "UNSPECIFIED"));
}

// "base, dual or unified" of Objective.
std::string ValueNames(const google::protobuf::EnumDescriptor& enumeration) {
  const std::string prefix = ValuePrefix(enumeration);
  std::string names;
  for (int i = 1; i < enumeration.value_count(); ++i) {
    absl::StrAppend(&names,
                    i == 1                               ? ""
                    : i + 1 == enumeration.value_count() ? " or "
                                                         : ", ",
                    absl::AsciiStrToLower(absl::StripPrefix(enumeration.value(i)->name(), prefix)));
  }
  return names;
}

// What a field takes, for people.
std::string Kind(const FieldDescriptor& field) {
  std::string kind = IsDuration(field) ? "a duration such as 0.5s"
                     : field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE
                         ? absl::StrCat(field.message_type()->name(), " as JSON with ",
                                        FieldNames(*field.message_type()))
                     : field.cpp_type() == FieldDescriptor::CPPTYPE_STRING ? "text"
                     : field.cpp_type() == FieldDescriptor::CPPTYPE_ENUM
                         ? ValueNames(*field.enum_type())
                     : field.cpp_type() == FieldDescriptor::CPPTYPE_BOOL   ? "true or false"
                     : field.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE ? "a number"
                                                                           : "a whole number";
  return field.is_repeated() ? absl::StrCat("a list, each ", kind) : kind;
}

// "dual" and "OBJECTIVE_DUAL" alike.
std::string EnumJson(const google::protobuf::EnumDescriptor& enumeration,
                     const std::string& value) {
  const std::string prefix = ValuePrefix(enumeration);
  const std::string name = absl::AsciiStrToUpper(value);
  return absl::StrCat("\"", absl::StartsWith(name, prefix) ? "" : prefix, name, "\"");
}

// The value as JSON of the field's type.
std::string JsonValue(const FieldDescriptor& field, const std::string& value) {
  if (field.is_repeated()) {
    if (value.rfind('[', 0) == 0) return value;
    if (field.cpp_type() != FieldDescriptor::CPPTYPE_ENUM) return absl::StrCat("[", value, "]");
    std::vector<std::string> names;
    for (const auto name : absl::StrSplit(value, ',')) {
      names.push_back(EnumJson(*field.enum_type(), std::string(absl::StripAsciiWhitespace(name))));
    }
    return absl::StrCat("[", absl::StrJoin(names, ","), "]");
  }
  if (field.cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
    return absl::StrCat("\"", absl::StrReplaceAll(value, {{"\\", "\\\\"}, {"\"", "\\\""}}), "\"");
  }
  if (field.cpp_type() == FieldDescriptor::CPPTYPE_ENUM) {
    return EnumJson(*field.enum_type(), value);
  }
  if (IsDuration(field)) {
    return absl::StrCat("\"", absl::StripSuffix(value, "s"), "s\"");
  }
  return value;
}

// Adds "path.name=0" for each number in `fields` that is 0. Of 64 bits, JSON has them as text.
void AddZeros(const google::protobuf::Struct& fields, const std::string& path,
              std::vector<std::string>* zeros) {
  for (const auto& [name, value] : fields.fields()) {
    if (value.has_struct_value()) {
      AddZeros(value.struct_value(), absl::StrCat(path, name, "."), zeros);
      continue;
    }
    double number = 1.0;
    if (value.has_number_value()) number = value.number_value();
    if (value.has_string_value() && !absl::SimpleAtod(value.string_value(), &number)) continue;
    if (number == 0.0) zeros->push_back(absl::StrCat(path, name, "=0"));
  }
}

// By its name in the contract or in JSON; null if there is none.
const FieldDescriptor* FindField(const Descriptor& descriptor, const std::string& name) {
  const FieldDescriptor* field = descriptor.FindFieldByName(name);
  return field != nullptr ? field : descriptor.FindFieldByCamelcaseName(name);
}

}  // namespace

absl::Status SetField(const std::string& assignment, Message* message) {
  const std::pair<std::string, std::string> parts =
      absl::StrSplit(assignment, absl::MaxSplits('=', 1));
  const auto& [path, value] = parts;
  if (path.empty() || assignment.find('=') == std::string::npos || value.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", assignment, "' is not FIELD=VALUE, such as optimization.joint_epochs=20"));
  }
  const std::vector<std::string> names = absl::StrSplit(path, '.');
  for (size_t i = 0; i < names.size(); ++i) {
    const Descriptor& descriptor = *message->GetDescriptor();
    const FieldDescriptor* field = FindField(descriptor, names[i]);
    if (field == nullptr) {
      return absl::InvalidArgumentError(absl::StrCat(
          "there is no field ", path, "; ", descriptor.name(), " has ", FieldNames(descriptor)));
    }
    if (i + 1 < names.size()) {
      if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || field->is_repeated() ||
          IsDuration(*field)) {
        return absl::InvalidArgumentError(
            absl::StrCat(path, ": ", names[i], " has no fields; it takes ", Kind(*field)));
      }
      message = message->GetReflection()->MutableMessage(message, field);
      continue;
    }
    const std::unique_ptr<Message> parsed(message->New());
    const auto status = google::protobuf::util::JsonStringToMessage(
        absl::StrCat("{\"", field->name(), "\": ", JsonValue(*field, value), "}"), parsed.get());
    if (!status.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, " cannot be ", value, "; it takes ", Kind(*field)));
    }
    message->GetReflection()->SwapFields(message, parsed.get(), {field});
  }
  return absl::OkStatus();
}

absl::Status SetExampleField(const std::string& assignment, v1::ExampleSettings* examples) {
  return SetField(std::string(absl::StripPrefix(assignment, "examples.")), examples);
}

std::vector<std::string> ZerosOfSettings(const std::string& json) {
  google::protobuf::Struct fields;
  std::vector<std::string> zeros;
  if (google::protobuf::util::JsonStringToMessage(json, &fields).ok()) AddZeros(fields, "", &zeros);
  std::sort(zeros.begin(), zeros.end());
  return zeros;
}

absl::StatusOr<v1::TrainingSettings> ReadSettings(const std::optional<std::string>& file,
                                                  std::vector<std::string> assignments,
                                                  Environment& environment) {
  v1::TrainingSettings settings;
  std::vector<std::string> zeros;
  if (file) {
    const auto text = ReadText(*file, environment);
    if (!text.ok()) return text.status();
    absl::Status status = ParseJson(*text, *file, &settings);
    if (!status.ok()) return status;
    zeros = ZerosOfSettings(*text);
  }
  for (const std::string& assignment : assignments) {
    absl::Status status = SetField(assignment, &settings);
    if (!status.ok()) return status;
  }
  assignments.insert(assignments.end(), zeros.begin(), zeros.end());
  absl::Status heard = RefuseUnheardZeros(assignments, settings);
  if (!heard.ok()) return heard;
  return settings;
}

absl::StatusOr<v1::TrainingSettings> ResolveExamples(const v1::ExampleSettings& examples) {
  v1::TrainingSettings settings;
  *settings.mutable_examples() = examples;
  settings = artifact::ResolveTrainingSettings(settings);
  const auto violations = artifact::ValidateTrainingSettings(settings);
  if (violations.empty()) return settings;
  return absl::InvalidArgumentError(
      absl::StrCat(violations.front().field, " ", violations.front().description));
}

absl::Status RefuseUnheardZeros(const std::vector<std::string>& assignments,
                                const v1::TrainingSettings& settings) {
  const v1::TrainingSettings resolved = artifact::ResolveTrainingSettings(settings);
  for (const std::string& assignment : assignments) {
    const std::string path = assignment.substr(0, assignment.find('='));
    const Message* given = &settings;
    const Message* used = &resolved;
    const std::vector<std::string> names = absl::StrSplit(path, '.');
    for (size_t i = 0; i < names.size(); ++i) {
      const FieldDescriptor* field = FindField(*given->GetDescriptor(), names[i]);
      if (i + 1 < names.size()) {
        given = &given->GetReflection()->GetMessage(*given, field);
        used = &used->GetReflection()->GetMessage(*used, field);
        continue;
      }
      // Of a field without presence HasField says whether the value is another than 0.
      if (field->is_repeated() || field->has_presence() ||
          given->GetReflection()->HasField(*given, field) ||
          !used->GetReflection()->HasField(*used, field)) {
        continue;
      }
      std::string value;
      google::protobuf::TextFormat::PrintFieldValueToString(*used, field, -1, &value);
      return absl::InvalidArgumentError(
          absl::StrCat(path, " cannot be ", assignment.substr(path.size() + 1),
                       ": that value means the preset's own, ", value));
    }
  }
  return absl::OkStatus();
}

absl::Status SetHorizon(const std::string& horizon, v1::TrainingSettings* settings) {
  double seconds = 0.0;
  if (!absl::SimpleAtod(absl::StripSuffix(horizon, "s"), &seconds) || !(seconds > 0.0) ||
      !std::isfinite(seconds)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--horizon cannot be ", horizon, "; it takes seconds, such as 5s"));
  }
  const v1::TrainingSettings resolved = artifact::ResolveTrainingSettings(*settings);
  double interval = ToSeconds(resolved.model().trajectory().waypoint_interval());
  if (!(interval > 0.0)) interval = 0.1;  // of a preset that the server will refuse
  const double waypoints = std::round(seconds / interval);
  if (!(waypoints >= 1.0 && waypoints <= 1e6) || std::abs(waypoints * interval - seconds) > 1e-6) {
    return absl::InvalidArgumentError(
        absl::StrCat("--horizon ", horizon, " is not a whole number of waypoints, which are ",
                     interval, " s apart"));
  }
  settings->mutable_model()->mutable_trajectory()->set_waypoints(static_cast<int32_t>(waypoints));
  return absl::OkStatus();
}

}  // namespace maneuver::cli
