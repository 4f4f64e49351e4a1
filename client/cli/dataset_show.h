// maneuver dataset show: describes a dataset, and draws some of its recordings.

#ifndef MANEUVER_CLIENT_CLI_DATASET_SHOW_H_
#define MANEUVER_CLIENT_CLI_DATASET_SHOW_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/environment.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::cli {

struct ShowDatasetArguments {
  std::string source;                // a folder with dataset.json, or a name on the server
  std::vector<std::string> changes;  // of ExampleSettings: "examples.stride=1s"
  std::optional<std::string> plot;   // PNG file
  int64_t scenes = 6;                // in it
};

int ShowDataset(const ShowDatasetArguments& arguments, Environment& environment);

// Returns the size of all shards.
int64_t SizeBytes(const v1::Dataset& dataset);

// Returns what ShowDataset prints of a description.
std::string DescriptionText(const v1::DatasetSummary& summary, bool color);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_DATASET_SHOW_H_
