// Describes what a model reads and predicts, as rows of a table.

#ifndef MANEUVER_CLIENT_CLI_SPEC_ROWS_H_
#define MANEUVER_CLIENT_CLI_SPEC_ROWS_H_

#include "client/cli/table.h"
#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/model_spec.pb.h"

namespace maneuver::cli {

// Adds a row of two cells for each part of the spec: which agents it predicts, the reference of
// trajectories, what the networks read, and optional parts.
void AddSpecRows(const v1::ModelSpec& spec, const v1::ModelCost& cost, Table* table);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_SPEC_ROWS_H_
