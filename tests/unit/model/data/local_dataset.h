// A dataset as a client has it.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_LOCAL_DATASET_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_LOCAL_DATASET_H_

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"

namespace maneuver::data {

// Written to a folder when it is made, in shards of some 3 kB.
struct LocalDataset {
  LocalDataset(const std::filesystem::path& folder, int recordings) {
    auto writer = DatasetWriter::Create(folder, "a test", {.shard_bytes = 3'000});
    for (int i = 0; i < recordings; ++i) {
      EXPECT_TRUE((*writer)->Add(SmallRecording("r" + std::to_string(i))).ok());
    }
    manifest = *(*writer)->Commit();
    for (const v1::Shard& shard : manifest.shards()) {
      bytes += *files::ReadFile(folder / shard.file());
    }
  }

  v1::Dataset manifest;
  std::string bytes;  // of all shards, in order
};

}  // namespace maneuver::data

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_LOCAL_DATASET_H_
