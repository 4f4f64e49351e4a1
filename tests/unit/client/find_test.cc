// maneuver find on tags that maneuver tag wrote.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/found_scenes.h"
#include "client/cli/maneuver.h"
#include "model/artifact/model_folder.h"
#include "model/data/dataset_folder.h"
#include "model/data/town/synthetic_town.h"
#include "model/files/durable_file.h"
#include "model/scene/target_frame.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::find_test {
namespace {

void Command(const std::vector<std::string>& arguments) {
  std::istringstream in;
  std::ostringstream out, err;
  Environment environment(in, out, err);
  EXPECT_EQ(RunManeuver(arguments, environment), kOk) << err.str();
}

// Tags have whole milliseconds; times of recordings need not.
TEST(FindTest, AnExtractedScenePredictsFromAStateOfItsTarget) {
  const TemporaryFolder folder;
  const std::string model = (folder / "model").string();
  const std::string dataset = (folder / "town").string();
  const std::string tags = (folder / "tags").string();
  const std::string scenes = (folder / "scenes").string();
  ASSERT_TRUE(artifact::WriteModelFolder(
                  model, inference::RandomModel(artifact::TinyModel().manifest.spec(), 1))
                  .ok());
  auto writer = data::DatasetWriter::Create(dataset, "a town whose clock is off");
  ASSERT_TRUE(writer.ok()) << writer.status();
  v1::Scenario recording = data::town::GenerateRecording({.seed = 3}, 0).scenario;
  for (v1::Agent& agent : *recording.mutable_agents()) {
    for (v1::AgentState& state : *agent.mutable_states()) state.set_time(state.time() + 3.7e-4);
  }
  ASSERT_TRUE((*writer)->Add(recording).ok());
  ASSERT_TRUE((*writer)->Commit().ok());

  Command({"tag", dataset, "--model", model, "-o", tags});
  Command({"find", tags, "--surprise", "top:3", "--dataset", dataset, "--extract", scenes});
  int extracted = 0;
  for (const auto& file : std::filesystem::directory_iterator(scenes)) {
    v1::Scenario scene;
    ASSERT_TRUE(
        google::protobuf::util::JsonStringToMessage(*files::ReadFile(file.path()), &scene).ok());
    ASSERT_EQ(scene.target_ids_size(), 1);
    const v1::Agent* const target = scene::FindAgent(scene, scene.target_ids(0));
    ASSERT_NE(target, nullptr);
    EXPECT_TRUE(std::ranges::any_of(target->states(), [&](const v1::AgentState& state) {
      return state.time() == scene.prediction_time();
    })) << scene.prediction_time();
    ++extracted;
  }
  EXPECT_EQ(extracted, 3);
}

// Tags name a dataset by its folder's name alone.
TEST(FindTest, RefusesTwoDatasetFoldersOfOneName) {
  const Result result = Maneuver(
      {"find", "tags", "--dataset", "may/town", "--dataset", "june/town", "--extract", "scenes"});
  EXPECT_EQ(result.status, kUsage);
  EXPECT_THAT(result.err,
              testing::HasSubstr("--dataset: may/town and june/town have the same name"));
  EXPECT_TRUE(CheckFolderNames({"may/town", "may/../may/town/", "may/city"}).ok());
}

}  // namespace
}  // namespace maneuver::cli::find_test
