#include "model/evaluation/finite_report.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <cmath>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

namespace maneuver::evaluation {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

// Returns the path of the first number in `message` that is not finite; empty if there is none.
std::string FirstNotFinite(const Message& message, const std::string& prefix);

std::string FirstIn(const Message& message, const FieldDescriptor& field, const std::string& path) {
  const Reflection& reflection = *message.GetReflection();
  const int count = field.is_repeated() ? reflection.FieldSize(message, &field) : 1;
  for (int i = 0; i < count; ++i) {
    std::string element = field.is_repeated() ? absl::StrCat(path, "[", i, "]") : path;
    if (field.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE) {
      const double value = field.is_repeated() ? reflection.GetRepeatedDouble(message, &field, i)
                                               : reflection.GetDouble(message, &field);
      if (!std::isfinite(value)) return element;
      continue;
    }
    const Message& part = field.is_repeated() ? reflection.GetRepeatedMessage(message, &field, i)
                                              : reflection.GetMessage(message, &field);
    if (field.is_map()) {
      // A map whose keys are names: its entries have a key and a value.
      const FieldDescriptor& key = *part.GetDescriptor()->map_key();
      const FieldDescriptor& value = *part.GetDescriptor()->map_value();
      if (key.cpp_type() != FieldDescriptor::CPPTYPE_STRING) continue;
      const std::string place =
          absl::StrCat(path, "[\"", part.GetReflection()->GetString(part, &key), "\"]");
      if (value.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
        const Message& within = part.GetReflection()->GetMessage(part, &value);
        if (std::string found = FirstNotFinite(within, place + "."); !found.empty()) return found;
      }
      if (value.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE &&
          !std::isfinite(part.GetReflection()->GetDouble(part, &value))) {
        return place;
      }
      continue;
    }
    element += ".";
    if (std::string found = FirstNotFinite(part, element); !found.empty()) return found;
  }
  return "";
}

std::string FirstNotFinite(const Message& message, const std::string& prefix) {
  std::vector<const FieldDescriptor*> fields;
  message.GetReflection()->ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    const bool has_numbers = field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE ||
                             field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
    if (!has_numbers) continue;
    std::string found = FirstIn(message, *field, prefix + field->name());
    if (!found.empty()) return found;
  }
  return "";
}

}  // namespace

absl::Status CheckFinite(const v1::EvaluationReport& report) {
  const std::string path = FirstNotFinite(report, "");
  if (path.empty()) return absl::OkStatus();
  return absl::OutOfRangeError(absl::StrCat("the evaluation's ", path, " is not finite"));
}

}  // namespace maneuver::evaluation
