// How long a shared store takes with 10,000 jobs, 1,000 versions, aliases and datasets, while two
// other servers follow it. The calls about datasets take turns with those of a folder alone.
//
//   cmake --build --preset release --target store_bench && build/release/tests/store_bench

#include <stdlib.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "locks/stop_latch.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "server/store/postgresql_schema.h"
#include "server/store/postgresql_store.h"
#include "tests/postgresql/cluster.h"
#include "tests/unit/model/data/recordings_for_tests.h"

namespace maneuver::postgresql {
namespace {

using std::chrono::steady_clock;

constexpr int kJobs = 10'000;
constexpr int kWatched = 200;
constexpr int kVersions = 1'000;
constexpr int kDatasets = 1'000;
constexpr int kCalls = 1'000;
constexpr int64_t kQuota = int64_t{1} << 40;  // bytes

[[noreturn]] void Fail(const std::string& what, const absl::Status& status) {
  std::cerr << what << ": " << status << "\n";
  std::exit(1);
}
void Check(const std::string& what, const absl::Status& status) {
  if (!status.ok()) Fail(what, status);
}

v1::Job Job(int i) {
  v1::Job job;
  job.set_name(absl::StrFormat("jobs/b%015d", i));
  job.set_state(v1::JOB_STATE_PENDING);
  job.mutable_train()->set_model("models/town");
  job.mutable_train()->add_datasets("datasets/town");
  job.mutable_train()->set_priority(i % 5);
  job.mutable_create_time()->set_seconds(1'700'000'000 + i);
  return job;
}

// Half of the jobs have ended, and each of those has events; the others wait.
void Fill(store::Store& store) {
  for (int i = 0; i < kJobs; ++i) {
    Check("add", store.Add(Job(i), absl::StrCat("request-", i), "digest"));
    if (i % 2 == 1) continue;
    const auto claimed = store.Claim([](v1::Job&) {});
    if (!claimed.ok() || !*claimed) Fail("claim", claimed.status());
    for (int event = 1; event <= 3; ++event) {
      v1::JobProgress progress;
      progress.set_sequence(event);
      progress.set_phase("joint");
      Check("progress", store.AddProgress((*claimed)->lease, progress));
    }
    Check("finish", store.Finish((*claimed)->lease,
                                 [](v1::Job& job) { job.set_state(v1::JOB_STATE_SUCCEEDED); }));
  }
  std::vector<security::ModelVersionName> versions;
  for (int i = 0; i < kVersions; ++i) versions.push_back({absl::StrCat("m", i % 100), i / 100 + 1});
  Check("adopt", store.Ledger()->Adopt(versions));
  for (int i = 0; i < kVersions; ++i) {
    Check("alias", store.SetAlias({absl::StrCat("m", i % 100), absl::StrCat("alias-", i / 100)},
                                  i / 100 + 1));
  }
}

// What a server asks regularly, more often than it does.
void Follow(store::Store& store, const std::vector<std::string>& watched) {
  Check("follow", store.ListAliases().status());
  Check("follow", store.Ledger()->ListVersions().status());
  Check("follow", store.ListPositions(watched).status());
  for (const v1::JobState state : {v1::JOB_STATE_PENDING, v1::JOB_STATE_SUCCEEDED}) {
    Check("follow", store.CountInState(state).status());
  }
  Check("follow",
        store.TakeAbandoned([](v1::Job& job) { job.set_state(v1::JOB_STATE_PENDING); }).status());
}

void Print(const std::string& what, std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  const auto at = [&](double share) {
    const double place = share * static_cast<double>(seconds.size());
    return 1000 * seconds[std::min(seconds.size() - 1, static_cast<size_t>(place))];
  };
  std::cout << absl::StrFormat("| %-38s | %5d | %6.2f | %6.2f | %7.2f |\n", what, seconds.size(),
                               at(0.5), at(0.99), 1000 * seconds.back());
}

// Measures calls that take turns.
void MeasureInTurns(const std::vector<std::pair<std::string, std::function<void(int)>>>& calls,
                    int count = kCalls) {
  std::vector<std::vector<double>> seconds(calls.size());
  for (int i = 0; i < count; ++i) {
    for (size_t each = 0; each < calls.size(); ++each) {
      const auto begun = steady_clock::now();
      calls[each].second(i);
      seconds[each].push_back(std::chrono::duration<double>(steady_clock::now() - begun).count());
    }
  }
  for (size_t each = 0; each < calls.size(); ++each) Print(calls[each].first, seconds[each]);
}

void Measure(const std::string& what, int calls, const std::function<void(int)>& call) {
  MeasureInTurns({{what, call}}, calls);
}

// Measures the same calls to a store of datasets without and with a ledger.
void MeasureDatasets(const data::DatasetStore& folder, const data::DatasetStore& ledger) {
  const auto list = [](const data::DatasetStore& store) {
    return [&store, after = std::string()](int) mutable {
      const auto page = store.List(after, 50);
      if (!page.ok()) Fail("list", page.status());
      after = page->size() < 50 ? "" : page->back().name().substr(std::string("datasets/").size());
    };
  };
  const auto get = [](const data::DatasetStore& store) {
    return [&store](int i) { Check("get", store.Get(absl::StrFormat("d%04d", i)).status()); };
  };
  // A quota counts all datasets. This upload is refused then.
  const auto count = [](const data::DatasetStore& store) {
    return [&store](int) {
      v1::Dataset dataset;
      dataset.add_shards()->set_size_bytes(int64_t{1} << 62);
      const absl::Status refused = store.BeginUpload("new", dataset).status();
      if (!absl::IsFailedPrecondition(refused)) Fail("count", refused);
    };
  };
  MeasureInTurns({{"list 50 datasets: folder", list(folder)}, {"the same: ledger", list(ledger)}});
  MeasureInTurns({{"get a dataset: folder", get(folder)}, {"the same: ledger", get(ledger)}});
  MeasureInTurns({{"count the quota: folder", count(folder)}, {"the same: ledger", count(ledger)}},
                 100);
}

void Run() {
  auto cluster = Cluster::Start(/*explains=*/false);
  if (!cluster.ok()) Fail("PostgreSQL", cluster.status());
  const std::string address = (*cluster)->NewSchema();
  {
    const auto connection = store::PostgresqlConnection::Open(address);
    if (!connection.ok()) Fail("connect", connection.status());
    Check("migrate", store::Migrate(**connection, store::StoreMigrations()).status());
  }
  std::vector<std::unique_ptr<store::PostgresqlStore>> stores;
  for (int i = 0; i < 3; ++i) {
    auto store = store::PostgresqlStore::Share(address);
    if (!store.ok()) Fail("share", store.status());
    stores.push_back(*std::move(store));
  }
  store::Store& store = *stores[0];
  const auto begun = steady_clock::now();
  Fill(store);
  std::cout << absl::StrFormat("filled in %.0f s\n\n",
                               std::chrono::duration<double>(steady_clock::now() - begun).count());
  std::vector<std::string> watched;
  for (int i = 0; i < kWatched; ++i) watched.push_back(Job(i * 7).name());
  StopLatch stop;
  std::vector<std::thread> others;
  for (int i = 1; i < 3; ++i) {
    others.emplace_back([&, i] {
      while (!stop.StoppedWithin(std::chrono::seconds(1)))
        Follow(*stores[static_cast<size_t>(i)], watched);
    });
  }
  std::cout << "| call | calls | p50 ms | p99 ms | slowest |\n|---|---:|---:|---:|---:|\n";
  std::string token;
  Measure("list 50 jobs, page after page", kCalls, [&](int) {
    const auto page = store.List(50, token);
    if (!page.ok()) Fail("list", page.status());
    token = page->next_page_token;
  });
  Measure("get a job", kCalls, [&](int i) { Check("get", store.Get(Job(i * 9).name()).status()); });
  std::vector<jobs::JobLease> leases;
  Measure("claim", kCalls, [&](int) {
    const auto claimed = store.Claim([](v1::Job&) {});
    if (!claimed.ok() || !*claimed) Fail("claim", claimed.status());
    leases.push_back((*claimed)->lease);
  });
  Measure("renew", kCalls,
          [&](int i) { Check("renew", store.Renew(leases[static_cast<size_t>(i)]).status()); });
  Measure("finish", kCalls, [&](int i) {
    Check("finish", store.Finish(leases[static_cast<size_t>(i)],
                                 [](v1::Job& job) { job.set_state(v1::JOB_STATE_FAILED); }));
  });
  Measure("set an alias", kCalls, [&](int i) {
    Check("alias", store.SetAlias({absl::StrCat("m", i % 100), "serving"}, i % 10 + 1));
  });
  Measure("list 1,000 aliases", kCalls,
          [&](int) { Check("aliases", store.ListAliases().status()); });
  Measure("list 1,000 versions", kCalls,
          [&](int) { Check("versions", store.Ledger()->ListVersions().status()); });
  Measure("count the jobs of a state", kCalls,
          [&](int) { Check("count", store.CountInState(v1::JOB_STATE_SUCCEEDED).status()); });
  Measure("how far 200 watched jobs are", kCalls,
          [&](int) { Check("positions", store.ListPositions(watched).status()); });

  std::string folder = (std::filesystem::temp_directory_path() / "maneuver-bench-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) Fail("folder", absl::ErrnoToStatus(errno, folder));
  const auto datasets =
      data::DatasetStore::Open(folder, {.quota_bytes = kQuota, .is_shared = true});
  if (!datasets.ok()) Fail("datasets", datasets.status());
  for (int i = 0; i < kDatasets; ++i) {
    auto writer =
        data::DatasetWriter::Create((*datasets)->FolderOf(absl::StrFormat("d%04d", i)), "");
    if (!writer.ok()) Fail("dataset", writer.status());
    Check("dataset", (*writer)->Add(data::SmallRecording("r0")));
    Check("dataset", (*writer)->Commit().status());
  }
  const auto adopting = steady_clock::now();
  const auto listed = data::DatasetStore::Open(folder, {.quota_bytes = kQuota, .is_shared = true},
                                               store.Datasets());
  if (!listed.ok()) Fail("datasets", listed.status());
  const double adopted = std::chrono::duration<double>(steady_clock::now() - adopting).count();
  MeasureDatasets(**datasets, **listed);
  std::cout << absl::StrFormat("\nadopted 1,000 datasets in %.1f s\n", adopted);
  stop.Stop();
  for (std::thread& other : others) other.join();
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace maneuver::postgresql

int main() { maneuver::postgresql::Run(); }
