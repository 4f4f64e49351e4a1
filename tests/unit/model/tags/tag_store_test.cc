#include "model/tags/tag_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/unit/model/tags/tags_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::tags::tag_store_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

v1::Tags June() {
  v1::Tags tags;
  tags.set_model_version("models/town/versions/7");
  tags.add_datasets("datasets/town");
  return tags;
}

class TagStoreTest : public ::testing::Test {
 protected:
  const TemporaryFolder folder_;
  const TagStore store_{folder_ / "tags"};
};

TEST_F(TagStoreTest, CountsTheShardsThatAreComplete) {
  ASSERT_TRUE(store_.Begin("june", June()).ok());
  EXPECT_EQ(store_.Get("june")->all_shards(), 0) << "no job has begun";
  const auto schema = PrepareTagFolder(store_.FolderOf("june"), SmallSchema({"town-a", "town-b"}));
  ASSERT_TRUE(schema.ok()) << schema.status();
  WriteTags(store_.FolderOf("june"), *schema, schema->content.files(0),
            {{"s", {RowWith({{Column::kWindows, 3}}), RowWith({})}}});
  const auto tags = store_.Get("june");
  ASSERT_TRUE(tags.ok()) << tags.status();
  EXPECT_EQ(tags->name(), "tags/june");
  EXPECT_EQ(tags->model_version(), "models/town/versions/7");
  EXPECT_EQ(tags->shards(), 1);
  EXPECT_EQ(tags->all_shards(), 2);
  EXPECT_EQ(tags->rows(), 2);
  EXPECT_EQ(tags->window_count(), 4);
  EXPECT_GT(tags->size_bytes(), 500);
}

TEST_F(TagStoreTest, ReportsADamagedShard) {
  ASSERT_TRUE(store_.Begin("june", June()).ok());
  ASSERT_TRUE(PrepareTagFolder(store_.FolderOf("june"), SmallSchema()).ok());
  std::ofstream(store_.FolderOf("june") / "town-a.tags") << "something else entirely";
  EXPECT_TRUE(absl::IsDataLoss(store_.Get("june").status()));
  std::ofstream(store_.FolderOf("june") / "schema.json") << std::string(2'000'000, '[');
  const absl::Status damaged = store_.Get("june").status();
  EXPECT_TRUE(absl::IsDataLoss(damaged));
  const std::string message(damaged.message());
  EXPECT_THAT(message, testing::StartsWith("tags/june: schema.json is damaged"));
  EXPECT_THAT(message, testing::Not(testing::HasSubstr("\n")));
  EXPECT_TRUE(store_.Detach("june").ok()) << "it can be deleted";
}

TEST_F(TagStoreTest, BeginsOnceAndOnlyForTheSameTags) {
  ASSERT_TRUE(store_.Begin("june", June()).ok());
  EXPECT_TRUE(store_.Begin("june", June()).ok());
  v1::Tags other = June();
  other.set_windows(true);
  EXPECT_TRUE(absl::IsAlreadyExists(store_.Begin("june", other)));
  EXPECT_TRUE(absl::IsAlreadyExists(store_.CheckBegin("june", other)));
  EXPECT_TRUE(store_.CheckBegin("july", other).ok());
}

TEST_F(TagStoreTest, WithdrawsTagsWithoutFilesAndBeginsThemAgain) {
  v1::Tags other = June();
  other.set_windows(true);
  bool made = false;
  ASSERT_TRUE(store_.Begin("june", June(), &made).ok());
  EXPECT_TRUE(made);
  store_.Withdraw("june");
  EXPECT_FALSE(fs::exists(store_.FolderOf("june")));
  fs::create_directory(store_.FolderOf("june"));  // as an interrupted call leaves it
  ASSERT_TRUE(store_.Begin("june", other, &made).ok());
  EXPECT_TRUE(made);
  ASSERT_TRUE(store_.Begin("june", other, &made).ok());
  EXPECT_FALSE(made);
}

TEST_F(TagStoreTest, ListsByNameAndForgetsWhatIsDetached) {
  EXPECT_THAT(*store_.List("", 10), IsEmpty());
  for (const char* id : {"may", "june", "july"}) ASSERT_TRUE(store_.Begin(id, June()).ok());
  EXPECT_THAT(*store_.List("", 2), ElementsAre("july", "june"));
  EXPECT_THAT(*store_.List("june", 2), ElementsAre("may"));
  const auto detached = store_.Detach("june");
  ASSERT_TRUE(detached.ok()) << detached.status();
  EXPECT_THAT(*store_.List("", 10), ElementsAre("july", "may"));
  EXPECT_TRUE(absl::IsNotFound(store_.Get("june").status()));
  EXPECT_TRUE(absl::IsNotFound(store_.Detach("june").status()));
  // A server that died before it deleted them deletes them when it starts.
  ASSERT_TRUE(store_.RemoveLeftovers(/*is_shared=*/false).ok());
  EXPECT_FALSE(fs::exists(*detached));
  EXPECT_TRUE(store_.Contains("may"));
}

TEST_F(TagStoreTest, RoomIsWhatAllTagsLeaveOfTheQuota) {
  EXPECT_EQ(*store_.Room(), std::nullopt);
  const TagStore bounded(folder_ / "tags", 10'000);
  EXPECT_EQ(*bounded.Room(), 10'000);
  ASSERT_TRUE(bounded.Begin("june", June()).ok());
  std::ofstream(bounded.FolderOf("june") / "file") << std::string(4'000, 'x');
  EXPECT_LE(**bounded.Room(), 6'000);
  EXPECT_GE(**bounded.Room(), 5'000);
  std::ofstream(bounded.FolderOf("june") / "more") << std::string(9'000, 'x');
  EXPECT_EQ(*bounded.Room(), 0);
}

}  // namespace
}  // namespace maneuver::tags::tag_store_test
