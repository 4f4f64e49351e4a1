#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <string>

#include "model/data/dataset_folder.h"
#include "model/files/digest.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::dataset_manifest_test {
namespace {

using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;

v1::Dataset Manifest() {
  v1::Dataset manifest;
  manifest.set_format_version(1);
  manifest.set_recordings(3);
  manifest.set_duration_seconds(27.0);
  v1::Shard* shard = manifest.add_shards();
  shard->set_file("scenarios-00000.tfrecord");
  shard->set_content(v1::SHARD_CONTENT_SCENARIOS);
  shard->set_size_bytes(100);
  shard->set_records(3);
  shard->set_sha256(std::string(64, 'a'));
  return manifest;
}

TEST(DatasetManifestTest, AValidManifestHasNoViolations) {
  EXPECT_THAT(ValidateDatasetManifest(Manifest()), IsEmpty());
}

TEST(DatasetManifestTest, TextRoundTripKeepsEveryField) {
  const auto parsed = ParseDatasetManifest(PrintDatasetManifest(Manifest()));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->SerializeAsString(), Manifest().SerializeAsString());
  EXPECT_THAT(PrintDatasetManifest(Manifest()), HasSubstr("\"size_bytes\": \"100\""));
}

TEST(DatasetManifestTest, TheContentDigestCoversAllShardsInOrder) {
  v1::Dataset two = Manifest();
  *two.add_shards() = two.shards(0);
  two.mutable_shards(1)->set_sha256(std::string(64, 'b'));
  v1::Dataset turned = two;
  turned.mutable_shards()->SwapElements(0, 1);
  EXPECT_EQ(ContentSha256(Manifest()), files::Sha256Hex(std::string(64, 'a') + "\n"));
  EXPECT_NE(ContentSha256(Manifest()), ContentSha256(two));
  EXPECT_NE(ContentSha256(two), ContentSha256(turned));
  // Names and times do not count as content.
  v1::Dataset renamed = two;
  renamed.set_name("datasets/x");
  renamed.mutable_shards(0)->set_file("other.tfrecord");
  EXPECT_EQ(ContentSha256(two), ContentSha256(renamed));
}

TEST(DatasetManifestTest, TextThatIsNotJsonIsDataLoss) {
  EXPECT_EQ(ParseDatasetManifest("{\"recordings\": ").status().code(), absl::StatusCode::kDataLoss);
}

// Names that would leave the folder, be hidden in it, or overwrite its other files.
TEST(DatasetManifestTest, RefusesUnsafeFileNames) {
  for (const std::string& file :
       {std::string(""), std::string("../secret"), std::string("/etc/passwd"), std::string("a/b"),
        std::string(".hidden"), std::string(".."), std::string("Upper"), std::string("a b"),
        std::string("nul\0l", 5), std::string("dataset.json"), std::string(101, 'a')}) {
    v1::Dataset manifest = Manifest();
    manifest.mutable_shards(0)->set_file(file);
    EXPECT_THAT(ValidateDatasetManifest(manifest),
                ElementsAre(Field(&scene::FieldViolation::field, "shards[0].file")))
        << file;
  }
  v1::Dataset longest = Manifest();
  longest.mutable_shards(0)->set_file(std::string(100, 'a'));
  EXPECT_THAT(ValidateDatasetManifest(longest), IsEmpty());
}

TEST(DatasetManifestTest, NamesTheFieldThatIsWrong) {
  struct Case {
    const char* field;
    std::function<void(v1::Dataset*)> spoil;
  };
  const Case cases[] = {
      {"format_version", [](v1::Dataset* m) { m->set_format_version(2); }},
      {"recordings", [](v1::Dataset* m) { m->set_recordings(4); }},
      {"duration_seconds", [](v1::Dataset* m) { m->set_duration_seconds(-1.0); }},
      {"duration_seconds", [](v1::Dataset* m) { m->set_duration_seconds(NAN); }},
      {"shards", [](v1::Dataset* m) { m->clear_shards(); }},
      {"origin", [](v1::Dataset* m) { m->set_origin(std::string(1001, 'x')); }},
      {"shards[0].content", [](v1::Dataset* m) { m->mutable_shards(0)->clear_content(); }},
      {"shards[0].size_bytes", [](v1::Dataset* m) { m->mutable_shards(0)->set_size_bytes(-1); }},
      {"shards[0].sha256",
       [](v1::Dataset* m) { m->mutable_shards(0)->set_sha256(std::string(64, 'A')); }},
      {"shards[0].sha256", [](v1::Dataset* m) { m->mutable_shards(0)->set_sha256("abc"); }},
      {"shards[1].records",
       [](v1::Dataset* m) {
         *m->add_shards() = m->shards(0);
         m->mutable_shards(1)->set_file("b");
         m->mutable_shards(1)->set_content(v1::SHARD_CONTENT_ANNOTATIONS);
         m->mutable_shards(1)->set_records(-3);
       }},
  };
  for (const Case& c : cases) {
    v1::Dataset manifest = Manifest();
    c.spoil(&manifest);
    const auto violations = ValidateDatasetManifest(manifest);
    ASSERT_FALSE(violations.empty()) << c.field;
    EXPECT_EQ(violations[0].field, c.field);
  }
}

TEST(DatasetManifestTest, RefusesAFileNamedTwice) {
  v1::Dataset manifest = Manifest();
  *manifest.add_shards() = manifest.shards(0);
  manifest.set_recordings(6);
  EXPECT_THAT(ValidateDatasetManifest(manifest),
              ElementsAre(Field(&scene::FieldViolation::field, "shards[1].file")));
}

TEST(DatasetManifestTest, RefusesCountsThatOverflow) {
  v1::Dataset manifest = Manifest();
  manifest.mutable_shards(0)->set_records(INT64_MAX);
  *manifest.add_shards() = manifest.shards(0);
  manifest.mutable_shards(1)->set_file("b");
  EXPECT_FALSE(ValidateDatasetManifest(manifest).empty());
}

TEST(DatasetManifestTest, AMissingManifestIsNotFoundAndADamagedOneIsDataLoss) {
  TemporaryFolder folder;
  EXPECT_EQ(ReadDatasetManifest(folder / "absent").status().code(), absl::StatusCode::kNotFound);
  WriteBytes(folder / "dataset.json", "{}");
  const auto manifest = ReadDatasetManifest(folder.path());
  EXPECT_EQ(manifest.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(manifest.status().message()), HasSubstr("format_version"));
}

// Not an error of the disk or of its size.
TEST(DatasetManifestTest, AFolderInPlaceOfTheManifestIsDataLoss) {
  TemporaryFolder folder;
  ASSERT_TRUE(std::filesystem::create_directory(folder / "dataset.json"));
  const auto manifest = ReadDatasetManifest(folder.path());
  EXPECT_EQ(manifest.status().code(), absl::StatusCode::kDataLoss) << manifest.status();
  EXPECT_THAT(std::string(manifest.status().message()), HasSubstr("dataset.json"));
}

}  // namespace
}  // namespace maneuver::data::dataset_manifest_test
