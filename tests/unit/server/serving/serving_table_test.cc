#include "server/serving/serving_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "model/artifact/model_folder.h"
#include "model/files/durable_file.h"
#include "model/files/sealed_json.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/serving/serving_table_fixture.h"

namespace maneuver::serving::serving_table_test {
namespace {

namespace fs = std::filesystem;
using security::ModelAliasName;
using security::ModelReference;
using security::ModelVersionName;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

TEST_F(ServingTableTest, WithoutModelsTheErrorSaysToTrainOne) {
  const auto found = table_->Find(std::nullopt);
  EXPECT_TRUE(absl::IsFailedPrecondition(found.status()));
  EXPECT_THAT(std::string(found.status().message()), HasSubstr("train one"));
  EXPECT_TRUE(absl::IsNotFound(table_->Find(Alias("town", "serving")).status()));
  EXPECT_FALSE(table_->Ready());
}

TEST_F(ServingTableTest, TheFirstVersionServesAndLaterOnesWaitForPromotion) {
  EXPECT_EQ(Publish("town")->ToString(), "models/town/versions/1");
  EXPECT_EQ(Answers(std::nullopt), 1);
  EXPECT_TRUE(table_->Ready());
  EXPECT_EQ(Publish("town")->version, 2);
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_EQ(Publish("town", v1::PROMOTION_ALWAYS)->version, 3);
  EXPECT_EQ(Answers(Alias("town", "serving")), 3);
  EXPECT_EQ(Publish("city", v1::PROMOTION_NEVER)->version, 1);
  EXPECT_TRUE(absl::IsNotFound(table_->Find(Alias("city", "serving")).status()));
}

TEST_F(ServingTableTest, ACallThatNamesNoModelIsToldWhichServe) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("hamlet", v1::PROMOTION_NEVER).ok());
  ASSERT_TRUE(Publish("city").ok());
  EXPECT_EQ(table_->Find(std::nullopt).status().message(),
            "several models serve: models/city, models/town; name one of them in `model`");
  for (char model = 'a'; model <= 'k'; ++model) ASSERT_TRUE(Publish({model}).ok());
  EXPECT_EQ(table_->Find(std::nullopt).status().message(),
            "several models serve: models/a, models/b, models/c, models/city, models/d, models/e, "
            "models/f, models/g, models/h, models/i, ...; name one of them in `model`");
}

TEST_F(ServingTableTest, FindsTheVersionOfAJobAfterARestart) {
  const auto find = [this](const std::string& maker, v1::Promotion promotion) {
    const auto found = table_->FindMadeBy("town", promotion, {maker});
    EXPECT_TRUE(found.ok()) << found.status();
    return found.ok() && *found ? (*found)->version : 0;
  };
  EXPECT_EQ(find("jobs/a", v1::PROMOTION_UNSPECIFIED), 0);
  ASSERT_TRUE(table_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, {"jobs/a"}).ok());
  ASSERT_TRUE(table_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, {"jobs/b"}).ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_NEVER).ok());
  Restart();
  EXPECT_EQ(find("jobs/a", v1::PROMOTION_NEVER), 1);
  EXPECT_EQ(find("jobs/b", v1::PROMOTION_NEVER), 2);
  EXPECT_EQ(find("jobs/c", v1::PROMOTION_NEVER), 0);
  EXPECT_EQ(store_->List("town").size(), 3u);
}

// As a server leaves it that died between the folder's last rename and the alias.
TEST_F(ServingTableTest, PromotesAFoundVersionThatWasNotYetPromoted) {
  ASSERT_TRUE(table_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, {"jobs/a"}).ok());
  ASSERT_TRUE(table_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, {"jobs/b"}).ok());
  Restart();
  ASSERT_TRUE(table_->FindMadeBy("town", v1::PROMOTION_UNSPECIFIED, {"jobs/b"}).ok());
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 2);
  // Something serves by now.
  ASSERT_TRUE(table_->FindMadeBy("town", v1::PROMOTION_UNSPECIFIED, {"jobs/a"}).ok());
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
  ASSERT_TRUE(table_->FindMadeBy("town", v1::PROMOTION_ALWAYS, {"jobs/a"}).ok());
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
}

TEST_F(ServingTableTest, ModelsMustBeNamedWhenSeveralServe) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  const auto found = table_->Find(std::nullopt);
  EXPECT_TRUE(absl::IsFailedPrecondition(found.status()));
  EXPECT_THAT(std::string(found.status().message()), HasSubstr("name one"));
}

TEST_F(ServingTableTest, WarnsOfAModelFolderWithoutADigest) {
  const auto publish = [this](const std::string& manifest) {
    const fs::path finished = FinishedModel();
    std::ofstream(finished / "model.json") << manifest;
    testing::internal::CaptureStderr();
    EXPECT_TRUE(table_->Publish("town", finished, v1::PROMOTION_NEVER).ok());
    return testing::internal::GetCapturedStderr();
  };
  const std::string said = publish(files::Seal("{}"));
  EXPECT_THAT(said, AllOf(HasSubstr("model loaded"), Not(HasSubstr("carries no digest"))));
  // As an earlier release wrote it.
  EXPECT_THAT(publish("{}"), AllOf(HasSubstr("model loaded"), HasSubstr("carries no digest"),
                                   HasSubstr("models/town/versions/2")));
}

TEST_F(ServingTableTest, DoesNotPublishADamagedModel) {
  ASSERT_TRUE(Publish("town").ok());
  const fs::path damaged = FinishedModel("altered");
  const auto published = table_->Publish("town", damaged, v1::PROMOTION_ALWAYS);
  EXPECT_TRUE(absl::IsFailedPrecondition(published.status()));
  EXPECT_THAT(std::string(published.status().message()), HasSubstr("was altered"));
  EXPECT_TRUE(fs::exists(damaged));
  EXPECT_EQ(Answers(std::nullopt), 1);
  EXPECT_EQ(store_->List("town").size(), 1u);
}

TEST_F(ServingTableTest, PromotingADamagedVersionLeavesTheOldOneServing) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  std::ofstream(folder_ / "models/town/2/weights.safetensors") << "altered";
  const absl::Status status = table_->SetAlias({"town", "serving"}, 2);
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("was altered"));
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 1);
}

TEST_F(ServingTableTest, ChangesNothingIfAnAliasCannotBeStored) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  aliases_.broken = true;
  EXPECT_TRUE(absl::IsUnavailable(table_->SetAlias({"town", "serving"}, 2)));
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);

  const fs::path finished = FinishedModel();
  EXPECT_FALSE(table_->Publish("town", finished, v1::PROMOTION_ALWAYS).ok());
  EXPECT_TRUE(fs::exists(finished / "model.json"));
  EXPECT_EQ(store_->List("town").size(), 2u);
}

TEST_F(ServingTableTest, AVersionWhoseAliasMayBeOnItsWayToTheDatabaseStaysAndIsPromotedLater) {
  ASSERT_TRUE(Publish("town").ok());
  aliases_.away = true;
  const auto published =
      table_->Publish("town", FinishedModel(), v1::PROMOTION_ALWAYS, {"jobs/maker"});
  EXPECT_TRUE(errors::IsStoreAway(published.status())) << published.status();
  EXPECT_EQ(store_->List("town").size(), 2u);
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_FALSE(table_->FindMadeBy("town", v1::PROMOTION_ALWAYS, {"jobs/maker"}).ok());

  aliases_.away = false;
  const auto found = table_->FindMadeBy("town", v1::PROMOTION_ALWAYS, {"jobs/maker"});
  ASSERT_TRUE(found.ok() && *found) << found.status();
  EXPECT_EQ((*found)->version, 2);
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 2);
}

TEST_F(ServingTableTest, FollowsAliasesThatAnotherServerMovesAddsAndRemoves) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  aliases_.aliases[{"town", "serving"}] = 2;
  aliases_.aliases[{"town", "candidate"}] = 1;
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  table_->Follow();
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
  EXPECT_EQ(Answers(Alias("town", "candidate")), 1);
  aliases_.aliases.erase({"town", "serving"});
  table_->Follow();
  EXPECT_TRUE(absl::IsNotFound(table_->Find(Alias("town", "serving")).status()));
  EXPECT_EQ(Answers(Alias("town", "candidate")), 1);
  EXPECT_FALSE(table_->Ready());
}

TEST_F(ServingTableTest, ATableThatDoesNotServeKeepsAliasesButNoModel) {
  serves_ = false;
  Restart();
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 1);
  EXPECT_EQ(table_->Serving("town"), (ModelVersionName{"town", 1}));
  EXPECT_TRUE(table_->SetAlias({"town", "serving"}, 2).ok());
  aliases_.aliases[{"town", "candidate"}] = 1;
  const int before = loads_;
  table_->Follow();
  table_->LoadAliased();
  EXPECT_EQ(loads_, before);
  EXPECT_EQ(*table_->Resolve(Alias("town", "candidate")), (ModelVersionName{"town", 1}));
  EXPECT_THAT(table_->Loaded(), testing::IsEmpty());
  EXPECT_EQ(Answers(Alias("town", "serving")), 0);
  EXPECT_FALSE(table_->Ready());
  // What serves is checked all the same.
  std::ofstream(folder_ / "models/town/1/weights.safetensors") << "altered";
  EXPECT_FALSE(table_->SetAlias({"town", "serving"}, 1).ok());
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 2);
}

TEST_F(ServingTableTest, AnAliasThatMovedToAVersionWhichCannotBeLoadedStaysWhereItWas) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  std::ofstream(folder_ / "models/town/2/weights.safetensors") << "altered";
  Restart();
  aliases_.aliases[{"town", "serving"}] = 2;
  table_->Follow();
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_TRUE(table_->Ready());
  // It is not read again at each call.
  const int before = loads_;
  table_->Follow();
  EXPECT_EQ(loads_, before);
}

TEST_F(ServingTableTest, APromotionThatAnotherServerForestalledChangesNothingAndIsSeen) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  aliases_.aliases[{"town", "serving"}] = 2;
  EXPECT_FALSE(*table_->PromoteOver({"town", 3}, ModelVersionName{"town", 1}));
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 2);
}

TEST_F(ServingTableTest, ARequestInFlightKeepsTheVersionThatItFound) {
  ASSERT_TRUE(Publish("town").ok());
  const ModelHandle in_flight = *table_->Find(std::nullopt);
  ASSERT_TRUE(Publish("town", v1::PROMOTION_ALWAYS).ok());
  EXPECT_EQ(in_flight->name().version, 1);
  EXPECT_TRUE(in_flight->WarmUp().ok());
  EXPECT_EQ(Answers(std::nullopt), 2);
}

TEST_F(ServingTableTest, KeepsEverythingOverARestart) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(table_->SetAlias({"town", "candidate"}, 2).ok());
  Restart();
  EXPECT_TRUE(table_->Ready());
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_EQ(Answers(Alias("town", "candidate")), 2);
  EXPECT_EQ(store_->List("").size(), 2u);
}

TEST_F(ServingTableTest, ADamagedVersionReportsItsErrorAndOthersServe) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  std::ofstream(folder_ / "models/town/1/weights.safetensors") << "altered";
  Restart();
  EXPECT_EQ(Answers(Alias("city", "serving")), 1);
  const auto found = table_->Find(Alias("town", "serving"));
  EXPECT_TRUE(absl::IsFailedPrecondition(found.status()));
  EXPECT_THAT(std::string(found.status().message()), HasSubstr("was altered"));
  EXPECT_TRUE(table_->Ready());
}

TEST_F(ServingTableTest, RemovesLeftoversOfInterruptedWriters) {
  ASSERT_TRUE(Publish("town").ok());
  const auto leftover = files::MakeTemporaryFolderFor(folder_ / "models/town/2");
  ASSERT_TRUE(leftover.ok());
  const fs::path half_a_label = folder_ / "models/town/1/.model.json.tmp-0123456789abcdef";
  std::ofstream(half_a_label) << "{";
  Restart();
  EXPECT_FALSE(fs::exists(*leftover));
  EXPECT_FALSE(fs::exists(half_a_label));
  EXPECT_EQ(Publish("town")->version, 2);
}

TEST_F(ServingTableTest, AVersionThatCouldNotBeLoadedIsTriedAgain) {
  ASSERT_TRUE(Publish("town").ok());
  const fs::path weights = folder_ / "models/town/1/weights.safetensors";
  fs::rename(weights, folder_ / "away");
  retry_load_ = std::chrono::nanoseconds(0);
  Restart();
  EXPECT_FALSE(table_->Ready());
  EXPECT_FALSE(table_->Load(Version("town", 1)).ok());
  fs::rename(folder_ / "away", weights);
  EXPECT_TRUE(table_->Load(Version("town", 1)).ok());
  fs::rename(weights, folder_ / "away");
  Restart();
  fs::rename(folder_ / "away", weights);
  table_->LoadAliased();
  EXPECT_TRUE(table_->Ready());
}

TEST_F(ServingTableTest, AVersionThatWasDamagedOnTheDiskIsNotPromotedFromMemory) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(table_->SetAlias({"town", "candidate"}, 2).ok());
  std::ofstream(folder_ / "models/town/2/weights.safetensors") << "altered";
  EXPECT_FALSE(table_->SetAlias({"town", "serving"}, 2).ok());
  EXPECT_FALSE(table_->PromoteOver({"town", 2}, ModelVersionName{"town", 1}).ok());
  EXPECT_EQ(table_->Serving("town"), (ModelVersionName{"town", 1}));
  EXPECT_EQ(Answers(Alias("town", "candidate")), 2);  // what is in memory is whole
}

TEST_F(ServingTableTest, LoadsANumberedVersionOnceAndDropsItForTheNext) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  EXPECT_EQ(Answers(Version("town", 2)), 0);
  const int before = loads_;
  EXPECT_EQ((*table_->Load(Version("town", 2)))->name().version, 2);
  EXPECT_EQ((*table_->Load(Version("town", 2)))->name().version, 2);
  EXPECT_EQ(loads_, before + 1);
  EXPECT_TRUE(table_->Load(Version("town", 3)).ok());
  EXPECT_EQ(Answers(Version("town", 2)), 0);
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_TRUE(absl::IsNotFound(table_->Load(Version("town", 4)).status()));
}

TEST_F(ServingTableTest, RefusesToDeleteAVersionWithAnAlias) {
  ASSERT_TRUE(Publish("town").ok());
  const absl::Status refused = table_->Delete({"town", 1});
  EXPECT_TRUE(absl::IsFailedPrecondition(refused));
  EXPECT_EQ(refused.message(),
            "models/town/versions/1 is pointed to by town@serving; point each alias to another "
            "version with SetModelAlias, or remove it with DeleteModelAlias");
  ASSERT_TRUE(table_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_FALSE(table_->Ready());
  EXPECT_TRUE(table_->Delete({"town", 1}).ok());
  EXPECT_THAT(store_->List(""), IsEmpty());
  EXPECT_TRUE(absl::IsNotFound(table_->Delete({"town", 1})));
}

TEST_F(ServingTableTest, AnUnknownAliasIsAnsweredWithThoseThatTheModelHas) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  ASSERT_TRUE(table_->SetAlias({"town", "candidate"}, 1).ok());
  const absl::Status removed = table_->DeleteAlias({"town", "candidat"});
  EXPECT_TRUE(absl::IsNotFound(removed));
  EXPECT_EQ(removed.message(),
            "there is no models/town/aliases/candidat; models/town has candidate, serving");
  EXPECT_EQ(table_->Find(Alias("town", "candidat")).status().message(),
            "there is no models/town/aliases/candidat; models/town has candidate, serving; point "
            "it to a version with SetModelAlias");
  ASSERT_TRUE(table_->DeleteAlias({"city", "serving"}).ok());
  EXPECT_EQ(table_->DeleteAlias({"city", "serving"}).message(),
            "there is no models/city/aliases/serving; models/city has no alias");
  EXPECT_EQ(table_->DeleteAlias({"hamlet", "serving"}).message(),
            "there is no models/hamlet; ListModelVersions names those that exist");
}

TEST_F(ServingTableTest, ListsAliasesByTheVersionThatTheyPointTo) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_ALWAYS).ok());
  ASSERT_TRUE(table_->SetAlias({"town", "previous"}, 1).ok());
  ASSERT_TRUE(table_->SetAlias({"town", "best"}, 1).ok());
  EXPECT_THAT(table_->AliasesOf({"town", 1}), ElementsAre("best", "previous"));
  EXPECT_THAT(table_->AliasesOf({"town", 2}), ElementsAre("serving"));
}

TEST_F(ServingTableTest, TellsItsListenerWhetherItIsReady) {
  std::vector<bool> told;
  table_->OnReadyChange([&](bool ready) { told.push_back(ready); });
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(table_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_THAT(told, ElementsAre(false, true, false));
}

TEST_F(ServingTableTest, PromotesOnlyOverTheVersionThatItWasComparedWith) {
  EXPECT_EQ(table_->Serving("town"), std::nullopt);
  ASSERT_TRUE(Publish("town", v1::PROMOTION_IF_NO_WORSE).ok());
  EXPECT_EQ(table_->Serving("town"), std::nullopt);  // not by publishing
  EXPECT_TRUE(*table_->PromoteOver({"town", 1}, std::nullopt));
  EXPECT_EQ(table_->Serving("town"), (ModelVersionName{"town", 1}));
  ASSERT_TRUE(Publish("town", v1::PROMOTION_IF_NO_WORSE).ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_IF_NO_WORSE).ok());
  EXPECT_FALSE(*table_->PromoteOver({"town", 2}, ModelVersionName{"town", 3}));
  EXPECT_FALSE(*table_->PromoteOver({"town", 2}, std::nullopt));
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_TRUE(*table_->PromoteOver({"town", 2}, ModelVersionName{"town", 1}));
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
}

}  // namespace
}  // namespace maneuver::serving::serving_table_test
