// What a server keeps: its data folder, its store, and the models in memory.

#ifndef MANEUVER_SERVER_MANEUVERD_STORAGE_H_
#define MANEUVER_SERVER_MANEUVERD_STORAGE_H_

#include <memory>

#include "absl/status/statusor.h"
#include "model/data/dataset_store.h"
#include "server/maneuverd/data_lock.h"
#include "server/maneuverd/options.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/serving/outcome_collection.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_store.h"
#include "server/store/store.h"

namespace maneuver {

// Each part needs those before it.
struct Storage {
  std::unique_ptr<DataLock> lock;
  std::unique_ptr<store::Store> store;
  std::unique_ptr<data::DatasetStore> datasets;
  std::unique_ptr<serving::VersionStore> versions;
  std::unique_ptr<serving::ServingTable> models;         // none is loaded yet
  std::unique_ptr<serving::OutcomeCollection> outcomes;  // nullptr: none are collected
};

// Opens them as the options say. Errors: those of what is opened. `metrics` must outlive the result.
absl::StatusOr<Storage> OpenStorage(const ServerOptions& options,
                                    monitoring::PrometheusMetrics& metrics);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_STORAGE_H_
