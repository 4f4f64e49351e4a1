// Folders of tags whose rows a test chooses.

#ifndef MANEUVER_TESTS_UNIT_MODEL_TAGS_TAGS_FOR_TESTS_H_
#define MANEUVER_TESTS_UNIT_MODEL_TAGS_TAGS_FOR_TESTS_H_

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "model/tags/shard_tags.h"
#include "model/tags/tag_folder.h"

namespace maneuver::tags {

inline const std::vector<std::string> kActionNames = {"left turn, slowing", "keep speed", "stop"};

// Returns a schema for the three actions, with one file for each name.
inline TagSchema SmallSchema(const std::vector<std::string>& files = {"town-a"}) {
  TagSchema schema;
  schema.set_format_version(kTagFormatVersion);
  schema.set_merged(true);
  schema.set_model_sha256("0123");
  schema.set_stride(0.5);
  for (const std::string& name : kActionNames) schema.add_action_names(name);
  for (TagColumn& column : CsvColumns()) *schema.add_columns() = std::move(column);
  for (const std::string& name : files) {
    TagFile* file = schema.add_files();
    file->set_name(name);
    file->set_dataset("town");
    file->set_shard(name + ".tfrecord");
    file->set_shard_sha256("sha of " + name);
  }
  return schema;
}

// Returns a row by the values that a test names; the others are 0.
inline CsvRow RowWith(const std::map<Column, double>& numbers) {
  CsvRow row;
  row.row[Column::kWindows] = 1;
  for (const auto& [column, number] : numbers) row.row[column] = ToInteger(column, number);
  return row;
}

// Writes the tags of one shard, by scene.
inline void WriteTags(const std::filesystem::path& folder, const Schema& schema,
                      const TagFile& file,
                      const std::map<std::string, std::vector<CsvRow>>& scenes) {
  auto writer = ShardTagsWriter::Create(folder, schema, file);
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (const auto& [scene, rows] : scenes) {
    const absl::Status status = (*writer)->Add(scene, rows);
    ASSERT_TRUE(status.ok()) << status;
  }
  const absl::Status status = (*writer)->Commit();
  ASSERT_TRUE(status.ok()) << status;
}

}  // namespace maneuver::tags

#endif  // MANEUVER_TESTS_UNIT_MODEL_TAGS_TAGS_FOR_TESTS_H_
