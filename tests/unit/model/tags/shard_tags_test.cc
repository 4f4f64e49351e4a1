#include "model/tags/shard_tags.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>

#include "model/data/byte_source.h"
#include "model/files/durable_file.h"
#include "model/kernels/crc32c.h"
#include "tests/unit/model/tags/tags_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::tags::shard_tags_test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

TEST(TagColumnsTest, ADecimalTextIsTheNumber) {
  EXPECT_EQ(DecimalText(-25, 2), "-0.25");
  EXPECT_EQ(DecimalText(5, 3), "0.005");
  EXPECT_EQ(DecimalText(123456, 4), "12.3456");
  EXPECT_EQ(DecimalText(7, 0), "7");
  EXPECT_EQ(DecimalText(INT64_MIN, 0), "-9223372036854775808");
}

TEST(TagColumnsTest, ANumberBeyondItsColumnBecomesTheEndOfItsRange) {
  EXPECT_EQ(ToInteger(Column::kSpeed, 1e300), INT32_MAX);
  EXPECT_EQ(ToInteger(Column::kSpeed, -1e300), -INT32_MAX);
  EXPECT_EQ(ToInteger(Column::kSpeed, NAN), -INT32_MAX);
  EXPECT_EQ(ToInteger(Column::kSpeed, 1.235), 124);
  EXPECT_EQ(ToNumber(Column::kSpeed, 124), 1.24);
}

std::string Unpacked(const fs::path& file) {
  auto source = data::OpenGzip(file);
  EXPECT_TRUE(source.ok()) << source.status();
  std::string text(1 << 16, '\0');
  const auto count = (*source)->Read(text.data(), text.size());
  EXPECT_TRUE(count.ok()) << count.status();
  text.resize(count.value_or(0));
  return text;
}

constexpr size_t kPreamble = 16;  // magic, bytes of the head, CRC-32C

uint32_t HeadBytes(const std::string& bytes) {
  uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 8, sizeof count);
  return count;
}

TagHead HeadOf(const std::string& bytes) {
  TagHead head;
  EXPECT_TRUE(head.ParseFromString(bytes.substr(kPreamble, HeadBytes(bytes))));
  return head;
}

// Returns a file with another head, and its checksum.
std::string WithHead(const std::string& bytes, const TagHead& head) {
  const auto aligned = [](size_t count) { return (count + 7) / 8 * 8; };
  const std::string text = head.SerializeAsString();
  const uint32_t words[] = {static_cast<uint32_t>(text.size()), kernels::Crc32c(text)};
  std::string changed = bytes.substr(0, 8);
  changed.append(reinterpret_cast<const char*>(words), sizeof words);
  changed += text;
  changed.resize(aligned(changed.size()), '\0');
  return changed + bytes.substr(aligned(kPreamble + HeadBytes(bytes)));
}

class ShardTagsTest : public ::testing::Test {
 protected:
  ShardTagsTest() {
    schema_ = *PrepareTagFolder(folder(), SmallSchema());
    CsvRow first = RowWith({{Column::kTarget, 7},
                            {Column::kClass, 1},
                            {Column::kFrom, 1.5},
                            {Column::kTo, 2.0},
                            {Column::kWindows, 2},
                            {Column::kAction, 0},
                            {Column::kResponsibility, 0.75},
                            {Column::kProbability, 0.125},
                            {Column::kSurprise, 2.0794},
                            {Column::kPeak, 2.0},
                            {Column::kLikeliest, 1},
                            {Column::kAde, 0.5},
                            {Column::kFde, 1.0},
                            {Column::kSpeed, 8.0},
                            {Column::kX, -12.5},
                            {Column::kY, 3e6},
                            {Column::kHeading, -0.5},
                            {Column::kMidX, 20.0},
                            {Column::kMidY, 1.25},
                            {Column::kEndX, 38.0},
                            {Column::kEndY, -4.5}});
    first.responsibilities = "0:0.7500 1:0.2500";
    WriteTags(folder(), schema_, file(),
              {{"a \"b\", c", {first}}, {"d", {RowWith({{Column::kAction, 2}})}}});
  }

  fs::path folder() const { return folder_.path() / "tags"; }
  const TagFile& file() const { return schema_.content.files(0); }
  std::string Bytes() const { return *files::ReadFile(TagsFileOf(folder(), file())); }
  absl::Status StatusWith(const std::string& bytes) const {
    std::ofstream(TagsFileOf(folder(), file()), std::ios::binary) << bytes;
    const auto tags = ShardTags::Open(folder(), schema_, file());
    if (!tags.ok()) return tags.status();
    for (size_t i = 0; i < kColumns; ++i) {
      const absl::Status status = (*tags)->Verify(static_cast<Column>(i));
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }

  TemporaryFolder folder_;
  Schema schema_;
};

TEST_F(ShardTagsTest, TheCsvHasEachRowWithItsColumnsInOrder) {
  EXPECT_EQ(
      Unpacked(CsvFileOf(folder(), file())),
      "dataset,scene,target,class,from_time,to_time,windows,action,name,responsibility,"
      "probability,surprise,peak_time,likeliest,ade,fde,speed,x,y,heading,mid_x,mid_y,end_x,end_y,"
      "responsibilities\n"
      "town,\"a \"\"b\"\", c\",7,vehicle,1.500,2.000,2,0,\"left turn, slowing\",0.7500,"
      "0.125000,2.0794,2.000,1,0.50,1.00,8.00,-12.50,3000000.00,-0.5000,20.00,1.25,"
      "38.00,-4.50,0:0.7500 1:0.2500\n"
      "town,d,0,unspecified,0.000,0.000,1,2,stop,0.0000,0.000000,0.0000,0.000,0,0.00,0.00,"
      "0.00,0.00,0.00,0.0000,0.00,0.00,0.00,0.00,\n");
}

TEST_F(ShardTagsTest, TheBinaryFileHasTheSameNumbers) {
  const auto tags = ShardTags::Open(folder(), schema_, file());
  ASSERT_TRUE(tags.ok()) << tags.status();
  EXPECT_EQ((*tags)->rows(), 2u);
  EXPECT_EQ((*tags)->head().windows(), 3);
  EXPECT_THAT((*tags)->head().action_rows(), ::testing::ElementsAre(1, 0, 1));
  EXPECT_EQ((*tags)->head().scenes(0), "a \"b\", c");
  EXPECT_EQ(ToNumber(Column::kY, (*tags)->Value(Column::kY, 0)), 3e6);
  EXPECT_EQ(ToNumber(Column::kHeading, (*tags)->Value(Column::kHeading, 0)), -0.5);
  EXPECT_EQ((*tags)->Value(Column::kScene, 1), 1);
  EXPECT_TRUE(IsTagged(folder(), schema_, file()));
}

TEST_F(ShardTagsTest, AChangedByteAnywhereIsFound) {
  const std::string good = Bytes();
  ASSERT_TRUE(StatusWith(good).ok());
  for (size_t i = 0; i < good.size(); ++i) {
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 0x10);
    const absl::Status status = StatusWith(bad);
    // What fills up to a multiple of 8 bytes means nothing.
    if (status.ok()) {
      EXPECT_EQ(good[i], '\0') << i;
    } else {
      EXPECT_THAT(std::string(status.message()), HasSubstr("town-a.tags")) << i;
    }
  }
}

TEST_F(ShardTagsTest, ANumberOfRowsThatCannotBeIsFoundThoughTheChecksumIsRight) {
  const std::string good = Bytes();
  for (const int64_t rows : {int64_t{-1}, int64_t{3}, INT64_MAX}) {
    TagHead head = HeadOf(good);
    head.set_action_rows(0, rows);
    EXPECT_TRUE(absl::IsDataLoss(StatusWith(WithHead(good, head)))) << rows;
  }
}

TEST_F(ShardTagsTest, ActionsWhoseRowsAreNotAllRowsAreFoundThoughTheChecksumIsRight) {
  const std::string good = Bytes();
  TagHead head = HeadOf(good);
  head.set_action_rows(0, 0);  // a query for this action would leave the file out
  EXPECT_TRUE(absl::IsDataLoss(StatusWith(WithHead(good, head))));
  head.set_action_rows(0, 1);
  EXPECT_TRUE(StatusWith(WithHead(good, head)).ok());
  head.set_action_rows(1, 1);
  EXPECT_TRUE(absl::IsDataLoss(StatusWith(WithHead(good, head))));
}

TEST_F(ShardTagsTest, ACutFileIsFound) {
  const std::string good = Bytes();
  for (size_t bytes = 0; bytes < good.size(); ++bytes) {
    const absl::Status status = StatusWith(good.substr(0, bytes));
    EXPECT_TRUE(absl::IsDataLoss(status)) << bytes << ": " << status;
  }
  EXPECT_FALSE(StatusWith(good + "12345678").ok());
}

TEST_F(ShardTagsTest, ANamedPipeInItsPlaceIsRefusedAtOnce) {
  const fs::path tags = TagsFileOf(folder(), file());
  fs::remove(tags);
  ASSERT_EQ(mkfifo(tags.c_str(), 0600), 0);
  const absl::Status refused = ShardTags::Open(folder(), schema_, file()).status();
  EXPECT_TRUE(absl::IsDataLoss(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("not a file"));
}

TEST_F(ShardTagsTest, ACutCsvIsNotTagged) {
  fs::resize_file(CsvFileOf(folder(), file()), 10);
  EXPECT_FALSE(IsTagged(folder(), schema_, file()));
}

TEST_F(ShardTagsTest, AnActionThatDoesNotExistIsFoundThoughTheChecksumIsRight) {
  TagSchema wide = SmallSchema({"town-b"});
  wide.add_action_names("a fourth");
  const fs::path other = folder_.path() / "other";
  const Schema schema = *PrepareTagFolder(other, wide);
  WriteTags(other, schema, schema.content.files(0), {{"s", {RowWith({{Column::kLikeliest, 9}})}}});
  const auto tags = ShardTags::Open(other, schema, schema.content.files(0));
  ASSERT_TRUE(tags.ok());
  EXPECT_TRUE((*tags)->Verify(Column::kAction).ok());
  EXPECT_TRUE(absl::IsDataLoss((*tags)->Verify(Column::kLikeliest)));
}

TEST_F(ShardTagsTest, AFolderOfAnotherModelIsRefusedByTheFieldThatDiffers) {
  TagSchema other = SmallSchema();
  other.set_model_sha256("4567");
  const absl::Status status = PrepareTagFolder(folder(), other).status();
  EXPECT_TRUE(absl::IsAlreadyExists(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("model_sha256"));
  EXPECT_TRUE(PrepareTagFolder(folder(), SmallSchema()).ok());
}

TEST_F(ShardTagsTest, AFolderWithOtherFilesIsRefused) {
  const fs::path other = folder_.path() / "other";
  fs::create_directory(other);
  std::ofstream(other / "letter.txt") << "dear";
  EXPECT_TRUE(absl::IsAlreadyExists(PrepareTagFolder(other, SmallSchema()).status()));
}

TEST_F(ShardTagsTest, ASchemaWhoseFilesLeaveTheFolderIsRefused) {
  TagSchema bad = SmallSchema({"../town-a"});
  const fs::path other = folder_.path() / "other";
  ASSERT_TRUE(PrepareTagFolder(other, bad).ok());
  EXPECT_TRUE(absl::IsDataLoss(ReadSchema(other).status()));
}

TEST_F(ShardTagsTest, AWriterWithoutACommitLeavesNothing) {
  const fs::path other = folder_.path() / "other";
  const Schema schema = *PrepareTagFolder(other, SmallSchema());
  {
    auto writer = ShardTagsWriter::Create(other, schema, file());
    ASSERT_TRUE((*writer)->Add("s", std::vector<CsvRow>{RowWith({})}).ok());
  }
  std::ofstream(other / ".town-a.csv.gz.tmp-77") << "of a process that was killed";
  { const auto writer = ShardTagsWriter::Create(other, schema, file()); }
  EXPECT_EQ(std::distance(fs::directory_iterator(other), {}), 1);  // schema.json
}

TEST_F(ShardTagsTest, AWriterLeavesWhatIsWrittenOfAShardWhoseNameBeginsLikeItsOwn) {
  const fs::path other = folder_.path() / "other";
  const Schema schema = *PrepareTagFolder(other, SmallSchema());
  const std::vector<std::string> kept = {".town-a.b.csv.gz.tmp-77", ".town-a.b.tags.tmp-0123456789",
                                         ".town-a.csv.gz.tmp-7.csv.gz.tmp-77"};
  const std::vector<std::string> removed = {".town-a.csv.gz.tmp-77", ".town-a.tags.tmp-0123456789"};
  for (const auto& names : {kept, removed}) {
    for (const std::string& name : names) std::ofstream(other / name) << "unfinished";
  }
  { const auto writer = ShardTagsWriter::Create(other, schema, file()); }
  for (const std::string& name : kept) EXPECT_TRUE(fs::exists(other / name)) << name;
  for (const std::string& name : removed) EXPECT_FALSE(fs::exists(other / name)) << name;
}

// Returns a file without its last four columns, whose head says so.
std::string OfFormat1(const std::string& bytes, const std::string& schema_sha256) {
  TagHead head = HeadOf(bytes);
  head.set_schema_sha256(schema_sha256);
  head.mutable_columns()->DeleteSubrange(18, 4);
  const std::string all = WithHead(bytes, head);
  // Each of the four has two rows of four bytes.
  return all.substr(0, all.size() - 32);
}

TEST_F(ShardTagsTest, AFileOfTheFormatBeforeIsReadWithZerosForWhatItLacks) {
  Schema before = schema_;
  before.content.set_format_version(1);
  before.sha256 = "of format 1";
  const std::string bytes = OfFormat1(Bytes(), before.sha256);
  std::ofstream(TagsFileOf(folder(), file()), std::ios::binary) << bytes;
  const auto tags = ShardTags::Open(folder(), before, file());
  ASSERT_TRUE(tags.ok()) << tags.status();
  for (size_t i = 0; i < kColumns; ++i) {
    EXPECT_TRUE((*tags)->Verify(static_cast<Column>(i)).ok()) << i;
  }
  EXPECT_EQ(ToNumber(Column::kHeading, (*tags)->Value(Column::kHeading, 0)), -0.5);
  EXPECT_EQ((*tags)->Value(Column::kMidX, 0), 0);
  EXPECT_EQ((*tags)->Value(Column::kEndY, 1), 0);
  EXPECT_EQ((*tags)->head().columns(static_cast<int>(Column::kEndY)).most(), 0);
}

}  // namespace
}  // namespace maneuver::tags::shard_tags_test
