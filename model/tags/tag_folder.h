// A folder of tags: schema.json, and for each shard of the datasets NAME.csv.gz and NAME.tags.

#ifndef MANEUVER_MODEL_TAGS_TAG_FOLDER_H_
#define MANEUVER_MODEL_TAGS_TAG_FOLDER_H_

#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "tag_files.pb.h"

namespace maneuver::tags {

inline constexpr char kSchemaFile[] = "schema.json";
inline constexpr int kTagFormatVersion = 2;
// Tags of format 1 have all columns but the last four, which read as 0. They can be read, not added
// to.
inline constexpr int kOldestTagFormatVersion = 1;

std::filesystem::path CsvFileOf(const std::filesystem::path& folder, const TagFile& file);
std::filesystem::path TagsFileOf(const std::filesystem::path& folder, const TagFile& file);

// Returns the columns of the CSV files, in order, as schema.json lists them: the dataset, those of
// tag_columns.h with the action's name after its number, and the responsibilities.
std::vector<TagColumn> CsvColumns();

// schema.json, and the digest by which the .tags files refer to it.
struct Schema {
  TagSchema content;
  std::string sha256;
};

// Makes the folder if it is missing, and writes its schema, unless the same one is there already.
// ALREADY_EXISTS, naming the first difference, if another one is there, or if the folder has files
// that are not hidden, but no schema; DATA_LOSS as in ReadSchema; errors of files.
absl::StatusOr<Schema> PrepareTagFolder(const std::filesystem::path& folder,
                                        const TagSchema& schema);

// Reads the schema of a folder. NOT_FOUND if there is none; DATA_LOSS if it is damaged or of a
// format version that this program does not read.
absl::StatusOr<Schema> ReadSchema(const std::filesystem::path& folder);

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_FOLDER_H_
