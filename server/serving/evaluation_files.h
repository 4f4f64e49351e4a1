// Reports of evaluations beside the version that was evaluated:
//
//   {version}/evaluations/{dataset}.json   the newest EvaluationReport on datasets/{dataset}, as
//                                          proto3 JSON
//
// Reports are not part of the model: neither its files nor their digests refer to them. Whoever
// moves or removes the version's folder also moves or removes its reports.

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
// Returns the error of the folder or file that could not be written.
//   dataset: its id
absl::Status WriteEvaluation(const std::filesystem::path& version_folder,
                             const std::string& dataset, const v1::EvaluationReport& report);

// Reads a report. NOT_FOUND if there is none; DATA_LOSS if it does not parse, or its digest
// (files/sealed_json.h) does not match.
absl::StatusOr<v1::EvaluationReport> ReadEvaluation(const std::filesystem::path& version_folder,
                                                    const std::string& dataset);

// Returns the ids of the datasets that have reports, sorted; none if the folder cannot be read.
std::vector<std::string> ListEvaluations(const std::filesystem::path& version_folder);

// Returns the folder of the reports, which need not exist. An interrupted WriteEvaluation leaves a
// temporary there.
std::filesystem::path EvaluationsFolder(const std::filesystem::path& version_folder);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_EVALUATION_FILES_H_
