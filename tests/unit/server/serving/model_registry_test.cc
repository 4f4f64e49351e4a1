#include "server/serving/model_registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "model/artifact/model_folder.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/serving/model_registry_fixture.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;
using security::ModelAliasName;
using security::ModelReference;
using security::ModelVersionName;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(ModelRegistryTest, WithoutModelsARequestIsToldToTrainOne) {
  const auto found = registry_->Find(std::nullopt);
  EXPECT_TRUE(absl::IsFailedPrecondition(found.status()));
  EXPECT_THAT(std::string(found.status().message()), HasSubstr("train one"));
  EXPECT_TRUE(absl::IsNotFound(registry_->Find(Alias("town", "serving")).status()));
  EXPECT_FALSE(registry_->Ready());
}

TEST_F(ModelRegistryTest, TheFirstVersionServesAndLaterOnesWaitForPromotion) {
  EXPECT_EQ(Publish("town")->ToString(), "models/town/versions/1");
  EXPECT_EQ(Answers(std::nullopt), 1);
  EXPECT_TRUE(registry_->Ready());
  EXPECT_EQ(Publish("town")->version, 2);
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_EQ(Publish("town", v1::PROMOTION_ALWAYS)->version, 3);
  EXPECT_EQ(Answers(Alias("town", "serving")), 3);
  EXPECT_EQ(Publish("city", v1::PROMOTION_NEVER)->version, 1);
  EXPECT_TRUE(absl::IsNotFound(registry_->Find(Alias("city", "serving")).status()));
}

TEST_F(ModelRegistryTest, TheVersionThatAJobMadeIsFoundAfterARestart) {
  const auto find = [this](const std::string& maker, v1::Promotion promotion) {
    const auto found = registry_->FindMadeBy("town", promotion, maker);
    EXPECT_TRUE(found.ok()) << found.status();
    return found.ok() && *found ? (*found)->version : 0;
  };
  EXPECT_EQ(find("jobs/a", v1::PROMOTION_UNSPECIFIED), 0);
  ASSERT_TRUE(registry_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, "jobs/a").ok());
  ASSERT_TRUE(registry_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, "jobs/b").ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_NEVER).ok());
  Restart();
  EXPECT_EQ(find("jobs/a", v1::PROMOTION_NEVER), 1);
  EXPECT_EQ(find("jobs/b", v1::PROMOTION_NEVER), 2);
  EXPECT_EQ(find("jobs/c", v1::PROMOTION_NEVER), 0);
  EXPECT_EQ(registry_->List("town").size(), 3u);
}

// As a server leaves it that died between the folder's last rename and the alias.
TEST_F(ModelRegistryTest, AVersionThatWasPublishedHalfIsPromotedWhenItIsFound) {
  ASSERT_TRUE(registry_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, "jobs/a").ok());
  ASSERT_TRUE(registry_->Publish("town", FinishedModel(), v1::PROMOTION_NEVER, "jobs/b").ok());
  Restart();
  ASSERT_TRUE(registry_->FindMadeBy("town", v1::PROMOTION_UNSPECIFIED, "jobs/b").ok());
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 2);
  // Something serves by now.
  ASSERT_TRUE(registry_->FindMadeBy("town", v1::PROMOTION_UNSPECIFIED, "jobs/a").ok());
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
  ASSERT_TRUE(registry_->FindMadeBy("town", v1::PROMOTION_ALWAYS, "jobs/a").ok());
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
}

TEST_F(ModelRegistryTest, ModelsMustBeNamedWhenSeveralServe) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  const auto found = registry_->Find(std::nullopt);
  EXPECT_TRUE(absl::IsFailedPrecondition(found.status()));
  EXPECT_THAT(std::string(found.status().message()), HasSubstr("name one"));
}

TEST_F(ModelRegistryTest, ADamagedModelIsNotPublishedAndNothingChanges) {
  ASSERT_TRUE(Publish("town").ok());
  const fs::path damaged = FinishedModel("altered");
  const auto published = registry_->Publish("town", damaged, v1::PROMOTION_ALWAYS);
  EXPECT_TRUE(absl::IsFailedPrecondition(published.status()));
  EXPECT_THAT(std::string(published.status().message()), HasSubstr("was altered"));
  EXPECT_TRUE(fs::exists(damaged));
  EXPECT_EQ(Answers(std::nullopt), 1);
  EXPECT_EQ(registry_->List("town").size(), 1u);
}

TEST_F(ModelRegistryTest, PromotingADamagedVersionLeavesTheOldOneServing) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  std::ofstream(folder_ / "models/town/2/weights.safetensors") << "altered";
  const absl::Status status = registry_->SetAlias({"town", "serving"}, 2);
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("was altered"));
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_EQ(aliases_.GetAlias({"town", "serving"}).value(), 1);
}

TEST_F(ModelRegistryTest, AnAliasThatCannotBeStoredChangesNothing) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  aliases_.broken = true;
  EXPECT_TRUE(absl::IsUnavailable(registry_->SetAlias({"town", "serving"}, 2)));
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);

  const fs::path finished = FinishedModel();
  EXPECT_FALSE(registry_->Publish("town", finished, v1::PROMOTION_ALWAYS).ok());
  EXPECT_TRUE(fs::exists(finished / "model.json"));
  EXPECT_EQ(registry_->List("town").size(), 2u);
}

TEST_F(ModelRegistryTest, ARequestInFlightKeepsTheVersionThatItFound) {
  ASSERT_TRUE(Publish("town").ok());
  const ModelHandle in_flight = *registry_->Find(std::nullopt);
  ASSERT_TRUE(Publish("town", v1::PROMOTION_ALWAYS).ok());
  EXPECT_EQ(in_flight->name().version, 1);
  EXPECT_TRUE(in_flight->WarmUp().ok());
  EXPECT_EQ(Answers(std::nullopt), 2);
}

TEST_F(ModelRegistryTest, EverythingOnDiskIsThereAfterARestart) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->SetAlias({"town", "candidate"}, 2).ok());
  Restart();
  EXPECT_TRUE(registry_->Ready());
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_EQ(Answers(Alias("town", "candidate")), 2);
  EXPECT_EQ(registry_->List("").size(), 2u);
}

TEST_F(ModelRegistryTest, AVersionDamagedWhileTheServerWasDownSaysSoAndOthersServe) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  std::ofstream(folder_ / "models/town/1/weights.safetensors") << "altered";
  Restart();
  EXPECT_EQ(Answers(Alias("city", "serving")), 1);
  const auto found = registry_->Find(Alias("town", "serving"));
  EXPECT_TRUE(absl::IsFailedPrecondition(found.status()));
  EXPECT_THAT(std::string(found.status().message()), HasSubstr("was altered"));
  EXPECT_TRUE(registry_->Ready());
}

TEST_F(ModelRegistryTest, LeftoversOfInterruptedWritersAreRemoved) {
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

TEST_F(ModelRegistryTest, AVersionAskedForByNumberIsLoadedOnceAndDroppedForTheNext) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  EXPECT_EQ(Answers(Version("town", 2)), 0);
  const int before = loads_;
  EXPECT_EQ((*registry_->Load(Version("town", 2)))->name().version, 2);
  EXPECT_EQ((*registry_->Load(Version("town", 2)))->name().version, 2);
  EXPECT_EQ(loads_, before + 1);
  EXPECT_TRUE(registry_->Load(Version("town", 3)).ok());
  EXPECT_EQ(Answers(Version("town", 2)), 0);
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_TRUE(absl::IsNotFound(registry_->Load(Version("town", 4)).status()));
}

TEST_F(ModelRegistryTest, AVersionWithAnAliasCannotBeDeleted) {
  ASSERT_TRUE(Publish("town").ok());
  const absl::Status refused = registry_->Delete({"town", 1});
  EXPECT_TRUE(absl::IsFailedPrecondition(refused));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("serving"));
  ASSERT_TRUE(registry_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_FALSE(registry_->Ready());
  EXPECT_TRUE(registry_->Delete({"town", 1}).ok());
  EXPECT_THAT(registry_->List(""), IsEmpty());
  EXPECT_TRUE(absl::IsNotFound(registry_->Delete({"town", 1})));
}

TEST_F(ModelRegistryTest, TheNumberOfADeletedVersionIsNeverGivenAgain) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->Delete({"town", 2}).ok());
  Restart();
  EXPECT_EQ(Publish("town")->version, 3);
}

TEST_F(ModelRegistryTest, VersionsAreListedNewestFirstWithTheirAliases) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_ALWAYS).ok());
  ASSERT_TRUE(registry_->SetAlias({"town", "previous"}, 1).ok());
  std::vector<std::string> names;
  for (const auto& info : registry_->List("")) names.push_back(info.name.ToString());
  EXPECT_THAT(names, ElementsAre("models/town/versions/2", "models/city/versions/1",
                                 "models/town/versions/1"));
  EXPECT_THAT(registry_->List("town").at(1).aliases, ElementsAre("previous"));
}

TEST_F(ModelRegistryTest, ReadinessIsTold) {
  std::vector<bool> told;
  registry_->OnReadyChange([&](bool ready) { told.push_back(ready); });
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_THAT(told, ElementsAre(false, true, false));
}

TEST_F(ModelRegistryTest, ALabelStaysWithItsVersion) {
  artifact::StoredModel model = artifact::TinyModel();
  for (int k = 0; k < model.manifest.spec().actions(); ++k) {
    model.manifest.add_actions()->set_action_id(k);
  }
  const fs::path finished = folder_ / "finished";
  ASSERT_TRUE(artifact::WriteModelFolder(finished, model).ok());
  ASSERT_TRUE(registry_->Publish("town", finished, v1::PROMOTION_UNSPECIFIED).ok());
  const auto before = registry_->List("town").at(0).create_time;

  const auto labelled = registry_->LabelAction({"town", 1}, 2, "turn left");
  ASSERT_TRUE(labelled.ok()) << labelled.status();
  EXPECT_EQ(labelled->label(), "turn left");
  Restart();
  const auto described = registry_->Describe({"town", 1});
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_EQ(described->manifest().actions(2).label(), "turn left");
  EXPECT_GT(described->cost().backbone_multiply_adds(), 0);
  EXPECT_EQ(registry_->List("town").at(0).create_time, before);
  EXPECT_TRUE(absl::IsOutOfRange(registry_->LabelAction({"town", 1}, 3, "x").status()));
}

TEST_F(ModelRegistryTest, AVersionIsPromotedOverTheOneThatItWasComparedWithAndNoOther) {
  EXPECT_EQ(registry_->Serving("town"), std::nullopt);
  ASSERT_TRUE(Publish("town", v1::PROMOTION_IF_NO_WORSE).ok());
  EXPECT_EQ(registry_->Serving("town"), std::nullopt);  // not by publishing
  EXPECT_TRUE(*registry_->PromoteOver({"town", 1}, std::nullopt));
  EXPECT_EQ(registry_->Serving("town"), (ModelVersionName{"town", 1}));
  ASSERT_TRUE(Publish("town", v1::PROMOTION_IF_NO_WORSE).ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_IF_NO_WORSE).ok());
  EXPECT_FALSE(*registry_->PromoteOver({"town", 2}, ModelVersionName{"town", 3}));
  EXPECT_FALSE(*registry_->PromoteOver({"town", 2}, std::nullopt));
  EXPECT_EQ(Answers(Alias("town", "serving")), 1);
  EXPECT_TRUE(*registry_->PromoteOver({"town", 2}, ModelVersionName{"town", 1}));
  EXPECT_EQ(Answers(Alias("town", "serving")), 2);
}

}  // namespace
}  // namespace maneuver::serving
