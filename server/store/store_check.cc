#include "server/store/store_check.h"

#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/jobs/job_state.h"

namespace maneuver::store {
namespace {

constexpr int kPage = 1'000;

absl::StatusOr<int64_t> CountEvents(Store& store, const std::string& job) {
  int64_t count = 0;
  int64_t last = 0;
  for (;;) {
    const auto events = store.ListProgress(job, last, kPage);
    if (!events.ok()) return events.status();
    if (events->empty()) return count;
    count += static_cast<int64_t>(events->size());
    last = events->back().sequence();
  }
}

absl::StatusOr<int64_t> CountDatasets(data::DatasetLedger& ledger) {
  const auto ids = ledger.ListIds();
  if (!ids.ok()) return ids.status();
  for (const std::string& id : *ids) {
    if (const auto manifest = ledger.Get(id); !manifest.ok()) return manifest.status();
  }
  return static_cast<int64_t>(ids->size());
}

}  // namespace

std::string StoreContents::ToString() const {
  int64_t all = 0;
  std::vector<std::string> states;
  for (const auto& [state, count] : jobs) {
    all += count;
    states.push_back(absl::StrCat(count, " ", std::string(jobs::JobStateLabel(state))));
  }
  return absl::StrCat(
      all, all == 1 ? " job" : " jobs",
      states.empty() ? "" : absl::StrCat(" (", absl::StrJoin(states, ", "), ")"), ", ", events,
      events == 1 ? " event, " : " events, ", aliases, aliases == 1 ? " alias" : " aliases",
      datasets ? absl::StrCat(", ", *datasets, *datasets == 1 ? " dataset" : " datasets") : "");
}

absl::StatusOr<StoreContents> CheckStore(Store& store) {
  StoreContents contents;
  std::string token;
  do {
    const auto page = store.List(kPage, token);
    if (!page.ok()) return page.status();
    if (!page->damaged.empty()) return page->damaged.front().error;
    for (const v1::Job& job : page->jobs) {
      ++contents.jobs[job.state()];
      const auto events = CountEvents(store, job.name());
      if (!events.ok()) return events.status();
      contents.events += *events;
    }
    token = page->next_page_token;
  } while (!token.empty());
  const auto aliases = store.ListAliases();
  if (!aliases.ok()) return aliases.status();
  contents.aliases = static_cast<int64_t>(aliases->size());
  if (data::DatasetLedger* ledger = store.Datasets()) {
    const auto datasets = CountDatasets(*ledger);
    if (!datasets.ok()) return datasets.status();
    contents.datasets = *datasets;
  }
  return contents;
}

}  // namespace maneuver::store
