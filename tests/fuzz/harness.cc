#include "tests/fuzz/harness.h"

#include <google/protobuf/stubs/logging.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "shard_index.pb.h"
#include "stream_script.pb.h"
#include "tag_files.pb.h"

namespace maneuver::fuzz {
namespace {

template <typename Message>
const google::protobuf::Message* Of() {
  return &Message::default_instance();
}

const google::protobuf::Message* None() { return nullptr; }

// In /dev/shm: a harness may write a file for each input.
class ProcessFolder {
 public:
  ProcessFolder() {
    const char* const memory = "/dev/shm";
    const auto beside = access(memory, W_OK) == 0 ? std::filesystem::path(memory)
                                                  : std::filesystem::temp_directory_path();
    path_ = beside / ("maneuver-fuzz-" + std::to_string(getpid()));
    std::filesystem::create_directories(path_);
  }
  ~ProcessFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace

const std::vector<Harness>& Harnesses() {
  static const auto& all = *new std::vector<Harness>{
      {"argoverse", Argoverse, None},
      {"commonroad", CommonRoad, None},
      {"configuration", Configuration, None},
      {"dataset_json", DatasetJson, None},
      {"labels", Labels, None},
      {"lane_paths", LanePaths, Of<v1::Scenario>},
      {"model_json", ModelJson, None},
      {"names", Names, None},
      {"nuscenes", NuScenes, None},
      {"outline", Outline, Of<v1::StreamPredictRequest>},
      {"safetensors", Safetensors, None},
      {"scenario", Scenario, Of<v1::Scenario>},
      {"settings", Settings, Of<v1::TrainingSettings>},
      {"shard_index", ShardIndex, Of<data::ShardIndex>},
      {"stream", Stream, Of<StreamScript>},
      {"tags", Tags, Of<tags::TagHead>},
      {"tfrecord", TfRecord, None},
      {"tokens", Tokens, None},
      {"upload", Upload, None},
      {"waymo", Waymo, None},  // a lite message: no reflection
  };
  return all;
}

const Harness* FindHarness(std::string_view name) {
  for (const Harness& harness : Harnesses()) {
    if (harness.name == name) return &harness;
  }
  return nullptr;
}

void Expect(bool holds, std::string_view what) {
  if (holds) return;
  std::fprintf(stderr, "broken: %.*s\n", static_cast<int>(what.size()), what.data());
  std::abort();
}

const std::filesystem::path& Folder() {
  static const ProcessFolder folder;
  return folder.path();
}

std::filesystem::path FileOf(std::string_view bytes) {
  std::filesystem::path file = Folder() / "input";
  std::ofstream(file, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return file;
}

std::string ReadBytes(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

bool ParseMessage(std::string_view bytes, google::protobuf::Message* message) {
  // It would tell of each text that is not UTF-8.
  static const bool silent = (google::protobuf::SetLogHandler(nullptr), true);
  (void)silent;
  return message->ParsePartialFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

}  // namespace maneuver::fuzz
