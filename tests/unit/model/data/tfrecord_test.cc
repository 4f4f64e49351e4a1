#include "model/data/tfrecord.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <string>
#include <vector>

#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::tfrecord_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// The record "abc", computed by hand from the format's definition.
const std::string kAbcRecord(
    "\x03\x00\x00\x00\x00\x00\x00\x00"  // length
    "\xb0\x99\x49\x0e"                  // its masked CRC-32C
    "abc"
    "\x6e\x57\xf1\x21",  // masked CRC-32C of "abc"
    19);

std::string Gzip(const std::string& bytes) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

// What a reader returns for a file, until its end or until it cannot continue.
struct Reading {
  std::vector<std::string> payloads;
  std::vector<absl::Status> damages;
  std::vector<uint64_t> damage_offsets;
  bool reached_end = false;
};

Reading ReadAll(const std::filesystem::path& file, const TfRecordReaderOptions& options = {}) {
  Reading reading;
  auto reader = TfRecordReader::Open(file, options);
  if (!reader.ok()) {
    reading.damages.push_back(reader.status());
    return reading;
  }
  std::string payload;
  while ((*reader)->can_continue()) {
    const absl::Status status = (*reader)->Next(&payload);
    if (absl::IsOutOfRange(status)) {
      reading.reached_end = true;
      break;
    }
    if (status.ok()) {
      reading.payloads.push_back(payload);
    } else {
      reading.damages.push_back(status);
      reading.damage_offsets.push_back((*reader)->offset());
    }
  }
  return reading;
}

class TfRecordTest : public testing::Test {
 protected:
  Reading ReadBytes(const std::string& bytes, const TfRecordReaderOptions& options = {}) {
    WriteBytes(folder_ / "shard.tfrecord", bytes);
    return ReadAll(folder_ / "shard.tfrecord", options);
  }

  std::string Written(const std::vector<std::string>& payloads) {
    const auto file = folder_ / "written.tfrecord";
    std::filesystem::remove(file);
    auto writer = TfRecordWriter::Create(file);
    for (const std::string& payload : payloads) EXPECT_TRUE((*writer)->Append(payload).ok());
    EXPECT_TRUE((*writer)->Close().ok());
    return *files::ReadFile(file);
  }

  TemporaryFolder folder_;
};

TEST_F(TfRecordTest, WritesTheBytesOfTheFormat) { EXPECT_EQ(Written({"abc"}), kAbcRecord); }

TEST_F(TfRecordTest, ReadsTheBytesOfTheFormat) {
  const Reading reading = ReadBytes(kAbcRecord + kAbcRecord);
  EXPECT_THAT(reading.payloads, ElementsAre("abc", "abc"));
  EXPECT_TRUE(reading.reached_end);
}

TEST_F(TfRecordTest, ReadsBackPayloadsOfEverySize) {
  const std::vector<std::string> payloads = {"", "x", std::string(300'000, 'y'),
                                             std::string(9'000'000, 'z'), std::string(1, '\0')};
  const Reading reading = ReadBytes(Written(payloads));
  EXPECT_EQ(reading.payloads, payloads);
  EXPECT_TRUE(reading.reached_end);
}

TEST_F(TfRecordTest, AnEmptyFileHasNoRecords) {
  const Reading reading = ReadBytes("");
  EXPECT_TRUE(reading.payloads.empty());
  EXPECT_TRUE(reading.reached_end);
}

TEST_F(TfRecordTest, WriterCountsRecordsBytesAndDigest) {
  auto writer = TfRecordWriter::Create(folder_ / "a");
  ASSERT_TRUE((*writer)->Append("abc").ok());
  ASSERT_TRUE((*writer)->Append("abc").ok());
  ASSERT_TRUE((*writer)->Close().ok());
  EXPECT_EQ((*writer)->records(), 2);
  EXPECT_EQ((*writer)->size_bytes(), 38);
  EXPECT_EQ((*writer)->sha256(), files::Sha256Hex(kAbcRecord + kAbcRecord));
}

// Flips every single bit of the middle record: it is reported in its place and never returned.
TEST_F(TfRecordTest, ReportsEachFlippedBitWithFileAndOffset) {
  for (size_t byte = 0; byte < kAbcRecord.size(); ++byte) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string damaged = kAbcRecord;
      damaged[byte] = static_cast<char>(damaged[byte] ^ (1 << bit));
      const Reading reading = ReadBytes(kAbcRecord + damaged + kAbcRecord);
      ASSERT_EQ(reading.damages.size(), 1u) << byte << "." << bit;
      EXPECT_EQ(reading.damages[0].code(), absl::StatusCode::kDataLoss);
      EXPECT_THAT(std::string(reading.damages[0].message()),
                  HasSubstr("shard.tfrecord, record at byte 19"));
      EXPECT_EQ(reading.damage_offsets[0], 19u);
      const bool in_header = byte < 12;
      // After a damaged payload the reader continues; after a damaged length it cannot.
      EXPECT_EQ(reading.payloads.size(), in_header ? 1u : 2u) << byte << "." << bit;
      EXPECT_EQ(reading.reached_end, !in_header);
    }
  }
}

TEST_F(TfRecordTest, ReportsTruncationAnywhereAndStops) {
  for (size_t size = 1; size < kAbcRecord.size(); ++size) {
    const Reading reading = ReadBytes(kAbcRecord + kAbcRecord.substr(0, size));
    EXPECT_EQ(reading.payloads.size(), 1u);
    ASSERT_EQ(reading.damages.size(), 1u) << size;
    EXPECT_EQ(reading.damages[0].code(), absl::StatusCode::kDataLoss);
    EXPECT_EQ(reading.damage_offsets[0], 19u);
    EXPECT_FALSE(reading.reached_end);
  }
}

TEST_F(TfRecordTest, KeepsReportingThatTheFramingIsLost) {
  WriteBytes(folder_ / "a", kAbcRecord.substr(0, 15));
  auto reader = TfRecordReader::Open(folder_ / "a");
  std::string payload;
  const absl::Status first = (*reader)->Next(&payload);
  EXPECT_EQ(first.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ((*reader)->Next(&payload), first);
}

TEST_F(TfRecordTest, RefusesAnAbsurdLengthWithAMatchingChecksum) {
  const std::string two_gibibytes("\x00\x00\x00\x80\x00\x00\x00\x00\xec\xaf\x30\x72", 12);
  const Reading reading = ReadBytes(two_gibibytes + "abc");
  ASSERT_EQ(reading.damages.size(), 1u);
  EXPECT_THAT(std::string(reading.damages[0].message()), HasSubstr("2147483648 bytes"));
}

TEST_F(TfRecordTest, RefusesRecordsLongerThanTheOptionAllows) {
  const std::string bytes = Written({"1234567890"});
  EXPECT_EQ(ReadBytes(bytes, {.max_record_bytes = 10}).payloads.size(), 1u);
  EXPECT_EQ(ReadBytes(bytes, {.max_record_bytes = 9}).damages.size(), 1u);
}

TEST_F(TfRecordTest, ReadsGzipLikePlainFiles) {
  const std::vector<std::string> payloads = {"a", std::string(2'000'000, 'b'), "c"};
  const Reading reading = ReadBytes(Gzip(Written(payloads)));
  EXPECT_EQ(reading.payloads, payloads);
  EXPECT_TRUE(reading.reached_end);
}

TEST_F(TfRecordTest, ReadsGzipOfSeveralMembers) {
  const Reading reading = ReadBytes(Gzip(kAbcRecord) + Gzip(kAbcRecord));
  EXPECT_THAT(reading.payloads, ElementsAre("abc", "abc"));
  EXPECT_TRUE(reading.reached_end);
}

TEST_F(TfRecordTest, ReportsATruncatedOrDamagedGzipStream) {
  std::string varied;  // hardly compressible, so that the records spread over the stream
  uint32_t state = 1;
  for (int i = 0; i < 100'000; ++i) {
    state = state * 1664525u + 1013904223u;
    varied.push_back(static_cast<char>(state >> 24));
  }
  const std::string packed = Gzip(Written({"first", varied}));
  const Reading truncated = ReadBytes(packed.substr(0, packed.size() / 2));
  EXPECT_THAT(truncated.payloads, ElementsAre("first"));
  ASSERT_EQ(truncated.damages.size(), 1u);
  EXPECT_EQ(truncated.damages[0].code(), absl::StatusCode::kDataLoss);

  std::string without_its_end = packed.substr(0, packed.size() - 3);
  EXPECT_EQ(ReadBytes(without_its_end).damages.size(), 1u);

  std::string damaged = packed;
  damaged[packed.size() / 2] = static_cast<char>(damaged[packed.size() / 2] ^ 0x10);
  EXPECT_GE(ReadBytes(damaged).damages.size(), 1u);
}

TEST_F(TfRecordTest, ReadsARecordWhoseLengthLooksLikeGzip) {
  const std::string payload(0x088B1F, 'p');  // little-endian: 1f 8b 08
  const std::string bytes = Written({payload});
  ASSERT_EQ(bytes.substr(0, 3), "\x1f\x8b\x08");
  EXPECT_THAT(ReadBytes(bytes).payloads, ElementsAre(payload));
}

TEST_F(TfRecordTest, RefusesGzipIfTheOptionSaysSo) {
  const Reading reading = ReadBytes(Gzip(kAbcRecord), {.allow_gzip = false});
  EXPECT_TRUE(reading.payloads.empty());
  EXPECT_EQ(reading.damages.size(), 1u);
}

TEST_F(TfRecordTest, ReportsAMissingFileAndNeverOverwritesAnExistingOne) {
  EXPECT_EQ(TfRecordReader::Open(folder_ / "absent").status().code(), absl::StatusCode::kNotFound);
  WriteBytes(folder_ / "a", "kept");
  EXPECT_EQ(TfRecordWriter::Create(folder_ / "a").status().code(),
            absl::StatusCode::kAlreadyExists);
}

}  // namespace
}  // namespace maneuver::data::tfrecord_test
