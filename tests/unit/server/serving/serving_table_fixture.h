// A version store and a serving table over a folder of their own. A model loads unless its weights
// file says "altered".

#ifndef MANEUVER_TESTS_UNIT_SERVER_SERVING_SERVING_TABLE_FIXTURE_H_
#define MANEUVER_TESTS_UNIT_SERVER_SERVING_SERVING_TABLE_FIXTURE_H_

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>

#include "model/files/durable_file.h"
#include "server/serving/serving_table.h"
#include "tests/unit/server/serving/fake_action_model.h"
#include "tests/unit/server/serving/memory_alias_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::serving {

class ServingTableTest : public ::testing::Test {
 protected:
  void SetUp() override { Restart(); }
  // Destroys the table before the metrics that a derived fixture has lent it (UseMetrics).
  void TearDown() override { table_ = nullptr; }

  // Opens store and table again, as a server that starts over the same data.
  void Restart() {
    table_ = nullptr;
    auto store = VersionStore::Open(folder_ / "models");
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
    auto opened = ServingTable::Open(
        *store_, aliases_,
        [this](const std::filesystem::path& folder)
            -> absl::StatusOr<std::shared_ptr<const inference::ActionModel>> {
          ++loads_;
          const auto weights = files::ReadFile(folder / "weights.safetensors");
          if (!weights.ok() || *weights == "altered") {
            return absl::DataLossError("weights.safetensors was altered");
          }
          return std::make_shared<FakeActionModel>(networks_);
        },
        {.max_unaliased_in_memory = 1, .serves = serves_, .retry_load = retry_load_},
        *table_metrics_);
    ASSERT_TRUE(opened.ok()) << opened.status();
    table_ = *std::move(opened);
    table_->LoadAliased();
  }

  // Counts in these metrics from the next Restart on. They must outlive the table.
  void UseMetrics(monitoring::MetricRegistry& metrics) { table_metrics_ = &metrics; }

  // Makes a folder as a trainer leaves it.
  std::filesystem::path FinishedModel(const std::string& weights = "good") {
    const std::filesystem::path finished = folder_ / ("finished-" + std::to_string(++finished_));
    std::filesystem::create_directories(finished);
    std::ofstream(finished / "weights.safetensors") << weights;
    std::ofstream(finished / "model.json") << "{}";
    return finished;
  }

  absl::StatusOr<security::ModelVersionName> Publish(
      const std::string& model, v1::Promotion promotion = v1::PROMOTION_UNSPECIFIED,
      const std::string& weights = "good") {
    return table_->Publish(model, FinishedModel(weights), promotion);
  }

  static std::optional<security::ModelReference> Alias(const std::string& model,
                                                       const std::string& alias) {
    return security::ModelAliasName{model, alias};
  }
  static std::optional<security::ModelReference> Version(const std::string& model, int version) {
    return security::ModelVersionName{model, version};
  }
  // Returns the number of the version that answers; 0 if it is not in memory, -1 if there is none.
  int Answers(const std::optional<security::ModelReference>& reference) {
    const auto handle = table_->Find(reference);
    if (!handle.ok()) return -1;
    return *handle == nullptr ? 0 : (*handle)->name().version;
  }

  monitoring::MetricRegistry* table_metrics_ = &monitoring::MetricRegistry::Null();
  const TemporaryFolder folder_;
  MemoryAliasStore aliases_;
  FakeNetworks networks_;
  bool serves_ = true;  // from the next start on
  std::chrono::nanoseconds retry_load_ = std::chrono::seconds(10);
  int loads_ = 0;
  int finished_ = 0;
  std::unique_ptr<VersionStore> store_;
  std::unique_ptr<ServingTable> table_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_TESTS_UNIT_SERVER_SERVING_SERVING_TABLE_FIXTURE_H_
