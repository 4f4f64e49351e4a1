// Files of tags: a head that says anything, before columns whose checksums are right. What can be
// opened and verified answers queries.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "model/kernels/crc32c.h"
#include "model/tags/tag_query.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

constexpr int64_t kMostRows = 64;

tags::Schema PreparedSchema() {
  tags::TagSchema content;
  content.set_format_version(tags::kTagFormatVersion);
  for (const char* name : {"keep speed", "stop", "left turn"}) content.add_action_names(name);
  tags::TagFile* file = content.add_files();
  file->set_name("shard");
  file->set_dataset("town");
  std::filesystem::remove_all(Folder() / "tags");
  auto schema = tags::PrepareTagFolder(Folder() / "tags", content);
  Expect(schema.ok(), schema.status().ToString());
  return *schema;
}

std::string Word(uint32_t number) {
  return {reinterpret_cast<const char*>(&number), sizeof number};
}

void Pad(std::string* bytes) { bytes->resize((bytes->size() + 7) / 8 * 8, '\0'); }

// Returns a file that begins with this head and has the columns that the head names.
std::string FileWith(tags::TagHead head) {
  const int64_t rows = head.rows() < 0 || head.rows() > kMostRows ? 0 : head.rows();
  std::string columns;
  for (int i = 0; i < head.columns_size(); ++i) {
    const int64_t bytes = head.columns(i).bytes();
    std::string column;
    // Small numbers, so that some are actions and recordings.
    for (int64_t row = 0; row < rows && (bytes == 4 || bytes == 8); ++row) {
      const uint64_t value =
          (static_cast<uint64_t>(row) * static_cast<uint64_t>(head.columns(i).most()) +
           static_cast<uint64_t>(head.columns(i).least())) %
          4;
      column.append(reinterpret_cast<const char*>(&value), static_cast<size_t>(bytes));
    }
    head.mutable_columns(i)->set_crc(kernels::Crc32c(column));
    columns += column;
    Pad(&columns);
  }
  const std::string text = head.SerializeAsString();
  std::string file =
      "mnvrtags" + Word(static_cast<uint32_t>(text.size())) + Word(kernels::Crc32c(text)) + text;
  Pad(&file);
  return file + columns;
}

}  // namespace

void Tags(std::string_view bytes) {
  static const tags::Schema schema = PreparedSchema();
  tags::TagHead head;
  if (!ParseMessage(bytes, &head)) return;
  head.set_schema_sha256(schema.sha256);
  const tags::TagFile& file = schema.content.files(0);
  std::ofstream(tags::TagsFileOf(Folder() / "tags", file), std::ios::binary | std::ios::trunc)
      << FileWith(head);
  const auto set = tags::TagSet::Open({Folder() / "tags"});
  if (!set.ok()) {
    Expect(absl::IsDataLoss(set.status()) || absl::IsFailedPrecondition(set.status()),
           set.status().ToString());
    return;
  }
  tags::TagQuery query;
  query.limit = 10;
  query.most_surprising = true;
  for (const auto grouping : {tags::Grouping::kAction, tags::Grouping::kScene,
                              tags::Grouping::kPlace, tags::Grouping::kHour}) {
    query.grouping = grouping;
    query.errors = true;
    const auto found = tags::Find(*set, query);
    if (!found.ok()) {
      Expect(absl::IsDataLoss(found.status()), found.status().ToString());
      return;
    }
    Expect(found->all.rows == head.rows(), "each row is counted");
    for (const tags::Match& match : tags::WithoutNearDuplicates(*set, found->matches, 5)) {
      (void)set->shards[match.shard].Scene(match.row);
    }
  }
}

}  // namespace maneuver::fuzz
