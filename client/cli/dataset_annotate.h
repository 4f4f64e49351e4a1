// maneuver dataset annotate: adds labels of actions to a dataset folder.

#ifndef MANEUVER_CLIENT_CLI_DATASET_ANNOTATE_H_
#define MANEUVER_CLIENT_CLI_DATASET_ANNOTATE_H_

#include <string>
#include <vector>

#include "client/cli/environment.h"

namespace maneuver::cli {

struct AnnotateArguments {
  std::string folder;
  std::string labels;                // CSV file
  std::string output;                // new folder
  std::vector<std::string> actions;  // that labels may name; empty: any
};

int AnnotateDataset(const AnnotateArguments& arguments, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_DATASET_ANNOTATE_H_
