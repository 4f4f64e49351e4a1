// Tests the same path with real Waymo Open Motion scenes, if MANEUVER_REAL_DATA names a folder with
// waymo_open_motion/{training,validation}.tfrecord-*.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/integration/trained_server.h"

namespace maneuver::integration::real_scenes_test {
namespace {

using ::testing::HasSubstr;

// A PNG starts with these bytes.
constexpr std::string_view kPngMagic = "\x89PNG\r\n\x1a\n";

std::string FirstBytes(const std::filesystem::path& file, size_t count) {
  std::ifstream stream(file, std::ios::binary);
  std::string bytes(count, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(count));
  return bytes;
}

TEST(RealScenesTest, ImportUploadTrainAndPredictWithPictures) {
  const char* place = std::getenv("MANEUVER_REAL_DATA");
  if (place == nullptr) GTEST_SKIP() << "MANEUVER_REAL_DATA is not set";
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(place)) {
    if (entry.path().filename().string().starts_with("validation.tfrecord")) {
      files.push_back(entry.path().string());
    }
  }
  ASSERT_FALSE(files.empty()) << "no validation.tfrecord-* under " << place;

  TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "data");
  ServerProcess server(folder.path() / "data");
  std::ofstream(folder.path() / "tiny.json") << kTinySettings;
  const std::string scenes = (folder.path() / "scenes").string();
  const auto succeed = [&](std::vector<std::string> arguments) {
    std::string output;
    EXPECT_EQ(RunManeuver(server, std::move(arguments), &output), 0) << output;
    return output;
  };
  std::vector<std::string> import = {"import", "waymo", scenes};
  import.insert(import.end(), files.begin(), files.end());
  succeed(import);
  succeed({"dataset", "upload", scenes, "waymo"});
  EXPECT_THAT(succeed({"dataset", "show", "waymo"}), HasSubstr("35"));
  succeed({"train", "real", "--dataset", "waymo", "--settings",
           (folder.path() / "tiny.json").string()});

  const nlohmann::json list =
      nlohmann::json::parse(succeed({"--output", "json", "scenario", "list", scenes}));
  const std::string id = list.at("scenarios").at(0).at("scenarioId");
  const std::filesystem::path scene = folder.path() / "scene.json";
  const std::filesystem::path picture = folder.path() / "scene.png";
  succeed({"scenario", "extract", scenes, id, "--out", scene.string()});
  // The answer on standard output, then messages for people on standard error.
  const std::string output =
      succeed({"--output", "json", "predict", scene.string(), "--plot", picture.string()});
  const nlohmann::json answer = nlohmann::json::parse(output.substr(0, output.rfind('}') + 1));
  EXPECT_FALSE(answer.at("predictions").at(0).at("targets").empty());
  EXPECT_EQ(FirstBytes(picture, kPngMagic.size()), kPngMagic);
}

}  // namespace
}  // namespace maneuver::integration::real_scenes_test
