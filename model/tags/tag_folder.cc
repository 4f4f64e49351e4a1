#include "model/tags/tag_folder.h"

#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/message_differencer.h>

#include <set>
#include <string>
#include <system_error>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/tags/tag_columns.h"

namespace maneuver::tags {
namespace {

namespace fs = std::filesystem;
using google::protobuf::util::MessageDifferencer;

TagColumn TextColumn(const std::string& name, const std::string& description) {
  TagColumn column;
  column.set_name(name);
  column.set_type("text");
  column.set_description(description);
  return column;
}

TagColumn NumberColumn(const ColumnSpec& spec) {
  TagColumn column = TextColumn(spec.name, spec.meaning);
  column.set_type(spec.decimals == 0 ? "integer" : "number");
  column.set_unit(spec.unit);
  return column;
}

// Fields without a value are written too, so that a reader sees all of them.
std::string PrintSchema(const TagSchema& schema) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string json;
  (void)google::protobuf::util::MessageToJsonString(schema, &json, options);
  return json;
}

// Returns "model_sha256: \"a\" -> \"b\"", of the first field that differs.
std::string FirstDifference(const TagSchema& is, const TagSchema& wanted) {
  std::string differences;
  MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&differences);
  differencer.Compare(is, wanted);
  return differences.substr(0, differences.find('\n'));
}

// A name that stays in the folder.
bool IsPlainName(const std::string& name) {
  return !name.empty() && name.front() != '.' && !absl::StrContains(name, '/');
}

absl::Status CheckSchema(const TagSchema& schema) {
  if (schema.format_version() < kOldestTagFormatVersion ||
      schema.format_version() > kTagFormatVersion) {
    return absl::DataLossError(absl::StrCat(kSchemaFile, ": format_version is ",
                                            schema.format_version(), "; this program reads ",
                                            kOldestTagFormatVersion, " to ", kTagFormatVersion));
  }
  if (schema.action_names().empty()) {
    return absl::DataLossError(absl::StrCat(kSchemaFile, ": action_names is empty"));
  }
  std::set<std::string> names;
  for (const TagFile& file : schema.files()) {
    if (!names.insert(file.name()).second) {
      return absl::DataLossError(
          absl::StrCat(kSchemaFile, ": files: \"", file.name(), "\" is there twice"));
    }
    if (!IsPlainName(file.name())) {
      return absl::DataLossError(
          absl::StrCat(kSchemaFile, ": files: \"", file.name(), "\" is not the name of a file"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

fs::path CsvFileOf(const fs::path& folder, const TagFile& file) {
  return folder / (file.name() + ".csv.gz");
}

fs::path TagsFileOf(const fs::path& folder, const TagFile& file) {
  return folder / (file.name() + ".tags");
}

std::vector<TagColumn> CsvColumns() {
  std::vector<TagColumn> columns = {TextColumn("dataset", "name of the dataset's folder")};
  for (size_t i = 0; i < kColumns; ++i) {
    const ColumnSpec& spec = Columns()[i];
    const auto column = static_cast<Column>(i);
    const bool text = column == Column::kScene || column == Column::kClass;
    columns.push_back(text ? TextColumn(spec.name, spec.meaning) : NumberColumn(spec));
    if (column == Column::kAction) {
      columns.push_back(TextColumn("name", "what the action is called"));
    }
  }
  columns.push_back(
      TextColumn("responsibilities",
                 "q(y|x,s), mean of the windows: ACTION:VALUE of each action with at least 0.01"));
  return columns;
}

absl::StatusOr<Schema> PrepareTagFolder(const fs::path& folder, const TagSchema& schema) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  const std::string json = PrintSchema(schema);
  const absl::StatusOr<Schema> there = ReadSchema(folder);
  if (there.ok()) {
    if (MessageDifferencer::Equals(there->content, schema)) return there;
    return absl::AlreadyExistsError(
        absl::StrCat(files::NameOf(folder), " has tags of another model, of other datasets or by ",
                     "other settings; choose another folder (", kSchemaFile, ": ",
                     FirstDifference(there->content, schema), ")"));
  }
  if (!absl::IsNotFound(there.status())) return there;
  fs::directory_iterator entries(folder, error);
  for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
    if (entries->path().filename().string().front() == '.') continue;
    // Another process may have begun the folder just now.
    if (fs::exists(folder / kSchemaFile, error)) return PrepareTagFolder(folder, schema);
    return absl::AlreadyExistsError(absl::StrCat(files::NameOf(folder), " has files, but no ",
                                                 kSchemaFile, "; choose another folder"));
  }
  if (error) return files::ErrnoStatus(error.value(), "read", folder);
  if (absl::Status status = files::WriteFileAtomically(folder / kSchemaFile, json); !status.ok()) {
    return status;
  }
  return Schema{schema, files::Sha256Hex(json)};
}

absl::StatusOr<Schema> ReadSchema(const fs::path& folder) {
  const absl::StatusOr<std::string> json = files::ReadFile(folder / kSchemaFile);
  if (!json.ok()) return json.status();
  Schema schema;
  const auto parsed = google::protobuf::util::JsonStringToMessage(*json, &schema.content);
  if (!parsed.ok()) {
    // Protobuf's further lines show the place in the text.
    const std::string reason(parsed.message());
    return absl::DataLossError(absl::StrCat(
        kSchemaFile,
        " is damaged, it is not the JSON of a schema: ", reason.substr(0, reason.find('\n'))));
  }
  if (absl::Status status = CheckSchema(schema.content); !status.ok()) return status;
  schema.sha256 = files::Sha256Hex(*json);
  return schema;
}

}  // namespace maneuver::tags
