// Tracks of real vehicles at ten frames a second, to measure importers of other formats with.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_MOVING_VEHICLES_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_MOVING_VEHICLES_H_

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/data/tfrecord.h"
#include "model/data/waymo/waymo_reader.h"

namespace maneuver::data {

// Sums squares, for a root mean square.
struct Errors {
  double squares = 0.0;
  int64_t count = 0;
  void Add(double error) {
    squares += error * error;
    ++count;
  }
  double RootMeanSquare() const { return std::sqrt(squares / static_cast<double>(count)); }
};

// Calls `visit` with each vehicle of the files "validation.tfrecord*" of Waymo Open Motion in
// `folder` that has 91 states and moves 5 m or more.
template <typename Visit>
void ForEachMovingVehicle(const std::filesystem::path& folder, const Visit& visit) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().filename().string().starts_with("validation.tfrecord")) {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  for (const auto& file : files) {
    auto reader = TfRecordReader::Open(file);
    ASSERT_TRUE(reader.ok()) << reader.status();
    std::string payload;
    while ((*reader)->Next(&payload).ok()) {
      const auto scenario = ParseWaymoScenario(payload);
      if (!scenario.ok()) continue;
      for (const v1::Agent& agent : scenario->agents()) {
        if (agent.type() != v1::AGENT_TYPE_VEHICLE || agent.states_size() != 91) continue;
        const v1::AgentState& first = agent.states(0);
        const v1::AgentState& last = agent.states(90);
        if (std::hypot(last.x() - first.x(), last.y() - first.y()) >= 5.0) visit(agent);
      }
    }
  }
}

}  // namespace maneuver::data

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_MOVING_VEHICLES_H_
