#include "tests/integration/trained_server.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <utility>

#include "model/data/dataset_folder.h"
#include "model/data/town/synthetic_town.h"

namespace maneuver::integration {

const char kTinySettings[] = R"({
  "preset": "compact",
  "model": {
    "raster": {"height": 48, "width": 48, "meters_per_pixel": 2, "history_frames": 3,
               "frame_interval": "0.5s"},
    "backbone": {"convolutions": [{"channels": 16, "stride": 2}, {"channels": 24, "stride": 2},
                                  {"channels": 24, "stride": 2}], "features": 64},
    "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
    "actions": 12,
    "latent_dimensions": 3,
    "action_predictor": {"hidden": [48, 48]},
    "trajectory_encoder": {"hidden": [48, 48]},
    "decoder": {"hidden": [48, 48]},
    "scenario_encoder": {"hidden": [32, 32]}
  },
  "examples": {"max_examples": 4000},
  "optimization": {"pretraining_epochs": 10, "mixture_epochs": 5, "joint_epochs": 4, "posterior_epochs": 1},
  "seed": 7,
  "threads": 1
})";

const char kTinyLanesSettings[] = R"({
  "preset": "lanes",
  "model": {
    "scene_vectors": {"history_width": 16, "path_width": 24, "attention_heads": 2, "features": 32,
                      "agent_width": 12, "agent_heads": 3},
    "action_geometry": {"pair_width": 12, "attention_heads": 2, "features": 16},
    "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
    "actions": 12,
    "latent_dimensions": 3,
    "action_predictor": {"hidden": [48]},
    "trajectory_encoder": {"hidden": [48, 48]},
    "decoder": {"hidden": [48, 48]},
    "scenario_encoder": {"hidden": [32]}
  },
  "examples": {"max_examples": 5000},
  "optimization": {"pretraining_epochs": 10, "mixture_epochs": 5, "joint_epochs": 4, "covariance_epochs": 1},
  "seed": 7,
  "threads": 1
})";

void WriteTown(const std::filesystem::path& folder, uint64_t seed, int recordings,
               std::vector<v1::Scenario>* kept) {
  auto writer = data::DatasetWriter::Create(folder, "synthetic town");
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int i = 0; i < recordings; ++i) {
    const data::town::TownRecording recording = data::town::GenerateRecording({.seed = seed}, i);
    ASSERT_TRUE((*writer)->Add(recording.scenario).ok());
    for (const v1::ManeuverAnnotation& maneuver : recording.maneuvers) {
      ASSERT_TRUE((*writer)->Add(maneuver).ok());
    }
    if (kept != nullptr) kept->push_back(recording.scenario);
  }
  const auto committed = (*writer)->Commit();
  ASSERT_TRUE(committed.ok()) << committed.status();
}

TrainedServer::TrainedServer(std::vector<std::string> flags, const char* settings)
    : flags_(std::move(flags)) {
  std::filesystem::create_directory(data_dir());
  std::ofstream(this->settings()) << settings;
  WriteTown(folder() / "town", 1, 60, nullptr);
  WriteTown(folder() / "unseen", 2, 12, &unseen_);
  Restart();
  const std::vector<std::vector<std::string>> commands = {
      {"dataset", "upload", (folder() / "town").string(), "town"},
      {"dataset", "upload", (folder() / "unseen").string(), "unseen"},
      {"train", "tiny", "--dataset", "town", "--settings", this->settings().string()},
  };
  for (const std::vector<std::string>& command : commands) {
    std::string output;
    const int status = RunManeuver(*server_, command, &output);
    if (status != 0) ADD_FAILURE() << "maneuver " << command[0] << ": " << status << "\n" << output;
  }
}

void TrainedServer::Restart() {
  server_.reset();
  server_ = std::make_unique<ServerProcess>(data_dir(), flags_);
}

}  // namespace maneuver::integration
