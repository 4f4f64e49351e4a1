#include "client/cli/json_files.h"

#include <google/protobuf/util/json_util.h>

#include <fstream>
#include <istream>
#include <sstream>

#include "absl/strings/str_cat.h"

namespace maneuver::cli {

absl::Status ReadJson(const std::string& path, Environment& environment,
                      google::protobuf::Message* message) {
  std::ostringstream text;
  if (path == "-") {
    text << environment.in.rdbuf();
  } else {
    std::ifstream file(path, std::ios::binary);
    if (!file) return absl::NotFoundError(absl::StrCat("cannot read ", path));
    text << file.rdbuf();
  }
  const auto status = google::protobuf::util::JsonStringToMessage(text.str(), message);
  if (status.ok()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      path == "-" ? "standard input" : path, " is not a ", message->GetDescriptor()->name(),
      " in proto3 JSON: ", std::string(status.message())));
}

std::string ToCompactJson(const google::protobuf::Message& message) {
  std::string text;
  // Cannot fail for messages without Any.
  (void)google::protobuf::util::MessageToJsonString(message, &text);
  text += '\n';
  return text;
}

absl::Status WriteFile(const std::string& path, const std::string& content) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (!file) return absl::UnavailableError(absl::StrCat("cannot write ", path));
  return absl::OkStatus();
}

}  // namespace maneuver::cli
