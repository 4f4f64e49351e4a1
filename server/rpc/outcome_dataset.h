// Makes a dataset of the outcomes that the server has collected.

#ifndef MANEUVER_SERVER_RPC_OUTCOME_DATASET_H_
#define MANEUVER_SERVER_RPC_OUTCOME_DATASET_H_

#include "absl/status/status.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/serving/outcome_collection.h"

namespace maneuver::rpc {

// Where outcomes go.
struct OutcomeStorage {
  serving::OutcomeCollection* collection = nullptr;  // nullptr: none are collected
  data::DatasetStore* datasets = nullptr;            // set with `collection`
};

// Answers CollectOutcomes. Waits for the disk. FAILED_PRECONDITION, reason OUTCOMES_NOT_COLLECTED,
// if nothing is collected. The other errors are those of an upload, and of the removal of outcomes
// that are to be forgotten: then the dataset is there nevertheless.
absl::Status MakeOutcomeDataset(const OutcomeStorage& storage,
                                const v1::CollectOutcomesRequest& request,
                                v1::CollectOutcomesResponse* response);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_DATASET_H_
