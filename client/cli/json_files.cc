#include "client/cli/json_files.h"

#include <fcntl.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace maneuver::cli {
namespace {

// FAILED_PRECONDITION whatever the reason is: UNAVAILABLE and its like would blame the server.
absl::Status CannotWrite(const std::string& path, int error) {
  return absl::FailedPreconditionError(
      absl::StrCat("cannot write ", path, ": ", std::generic_category().message(error)));
}

// Returns the values of the enum that a message of protobuf names, such as "invalid value "car" for
// type type.googleapis.com/maneuver.v1.AgentType"; empty if it names none.
std::string ValuesOfEnum(std::string_view message) {
  constexpr std::string_view kBefore = "type.googleapis.com/";
  const size_t at = message.find(kBefore);
  if (at == std::string_view::npos) return "";
  const auto* type = google::protobuf::DescriptorPool::generated_pool()->FindEnumTypeByName(
      std::string(message.substr(at + kBefore.size())));
  if (type == nullptr) return "";
  std::vector<std::string> values;
  for (int i = 0; i < type->value_count(); ++i) {
    if (type->value(i)->number() != 0) values.push_back(type->value(i)->name());
  }
  return absl::StrCat("; the values are ", absl::StrJoin(values, ", "));
}

absl::Status CannotRead(const std::string& name, int error) {
  return absl::NotFoundError(
      absl::StrCat("cannot read ", name, ": ", std::generic_category().message(error)));
}

absl::StatusOr<std::string> ReadAll(std::istream& stream, const std::string& name) {
  constexpr size_t kMostBytes = size_t{1} << 30;  // as long as the longest message
  std::string text;
  std::vector<char> block(1 << 16);
  errno = 0;
  do {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto count = static_cast<size_t>(stream.gcount());
    if (text.size() + count > kMostBytes) {
      return absl::InvalidArgumentError(absl::StrCat(name, " has more than 1 GiB"));
    }
    text.append(block.data(), count);
  } while (stream.good());
  // std::cin takes a failure for the end; the C library's stream behind it does not.
  const bool failed = stream.bad() || (&stream == &std::cin && std::ferror(stdin) != 0);
  if (failed) return CannotRead(name, errno);
  // Some editors begin a file with this mark.
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (text.starts_with(kByteOrderMark)) text.erase(0, kByteOrderMark.size());
  return text;
}

}  // namespace

absl::StatusOr<std::string> ReadText(const std::string& path, Environment& environment) {
  if (path == "-") return ReadAll(environment.in, "standard input");
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return absl::NotFoundError(absl::StrCat("cannot read ", path, ": it is a folder"));
  }
  return file ? ReadAll(file, path) : CannotRead(path, errno);
}

absl::Status ParseJson(const std::string& text, const std::string& path,
                       google::protobuf::Message* message) {
  const auto status = google::protobuf::util::JsonStringToMessage(text, message);
  if (status.ok()) return absl::OkStatus();
  std::string_view why(status.message().data(), status.message().size());
  if (why.starts_with(": ")) why.remove_prefix(2);
  return absl::InvalidArgumentError(absl::StrCat(
      path == "-" ? "standard input" : path, " is not a ", message->GetDescriptor()->name(),
      " in proto3 JSON: ", std::string(why), ValuesOfEnum(why)));
}

absl::Status ReadJson(const std::string& path, Environment& environment,
                      google::protobuf::Message* message) {
  const absl::StatusOr<std::string> text = ReadText(path, environment);
  return text.ok() ? ParseJson(*text, path, message) : text.status();
}

std::string ToCompactJson(const google::protobuf::Message& message) {
  std::string text;
  // Cannot fail for messages without Any.
  (void)google::protobuf::util::MessageToJsonString(message, &text);
  text += '\n';
  return text;
}

absl::Status WriteFile(const std::string& path, const std::string& content) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) return CannotWrite(path, errno);
  std::string_view left = content;
  while (!left.empty()) {
    const ssize_t count = write(file, left.data(), left.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      const int error = errno;
      close(file);
      return CannotWrite(path, error);
    }
    left.remove_prefix(static_cast<size_t>(count));
  }
  return close(file) == 0 ? absl::OkStatus() : CannotWrite(path, errno);
}

}  // namespace maneuver::cli
