#include "server/maneuverd/storage.h"

#include <filesystem>
#include <string>
#include <utility>

#include "model/inference/action_model.h"
#include "server/monitoring/logging.h"
#include "server/store/open_store.h"

namespace maneuver {

absl::StatusOr<Storage> OpenStorage(const ServerOptions& options,
                                    monitoring::PrometheusMetrics& metrics) {
  Storage storage;
  auto lock = DataLock::Take(options.data_dir, options.is_shared);
  if (!lock.ok()) return lock.status();
  storage.lock = *std::move(lock);
  const std::string modes = CloseToOthers(options.data_dir, options.is_shared);
  if (!modes.empty()) Log(monitoring::LogLevel::kWarning, modes);
  metrics.WatchDisk(options.data_dir);
  auto store = store::OpenStore(options.data_dir, options.store, options.is_shared, metrics);
  if (!store.ok()) return store.status();
  storage.store = *std::move(store);
  auto datasets = data::DatasetStore::Open(options.data_dir / "datasets", options.datasets,
                                           storage.store->Datasets());
  if (!datasets.ok()) return datasets.status();
  storage.datasets = *std::move(datasets);
  auto versions = serving::VersionStore::Open(options.data_dir / "models", storage.store->Ledger());
  if (!versions.ok()) return versions.status();
  storage.versions = *std::move(versions);
  auto models = serving::ServingTable::Open(
      *storage.versions, *storage.store,
      [engine = options.engine](const std::filesystem::path& folder) {
        return inference::ActionModel::Load(folder, engine);
      },
      {.serves = Predicts(options.role)}, metrics);
  if (!models.ok()) return models.status();
  storage.models = *std::move(models);
  if (options.outcome_recordings > 0) {
    auto outcomes = serving::OutcomeCollection::Open(options.data_dir / "outcomes",
                                                     options.outcome_recordings, metrics);
    if (!outcomes.ok()) return outcomes.status();
    storage.outcomes = *std::move(outcomes);
  }
  return storage;
}

}  // namespace maneuver
