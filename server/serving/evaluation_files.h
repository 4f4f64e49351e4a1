// Reports of evaluations beside the version that was evaluated:
//
//   {version}/evaluations/{dataset}.json   the newest EvaluationReport on datasets/{dataset}, as
//                                          proto3 JSON
//
// They are no part of the model: its own files, and their digests, know nothing of them. What moves
// or removes the version's folder does so with its reports.

#ifndef MANEUVER_SERVER_SERVING_EVALUATION_FILES_H_
#define MANEUVER_SERVER_SERVING_EVALUATION_FILES_H_

#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::serving {

// Replaces the report on the same dataset in one step; a crash leaves the old one or the new.
//   dataset: its id
absl::Status WriteEvaluation(const std::filesystem::path& version_folder,
                             const std::string& dataset, const v1::EvaluationReport& report);

// NOT_FOUND; DATA_LOSS if it does not parse.
absl::StatusOr<v1::EvaluationReport> ReadEvaluation(const std::filesystem::path& version_folder,
                                                    const std::string& dataset);

// Ids of the datasets that there are reports on, sorted.
std::vector<std::string> ListEvaluations(const std::filesystem::path& version_folder);

// Removes what an interrupted WriteEvaluation left.
absl::Status RemoveUnfinishedEvaluations(const std::filesystem::path& version_folder);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_EVALUATION_FILES_H_
