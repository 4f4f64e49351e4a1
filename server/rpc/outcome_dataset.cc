#include "server/rpc/outcome_dataset.h"

#include <string>
#include <utility>

#include "model/data/dataset_folder.h"
#include "server/errors/error_details.h"
#include "server/rpc/dataset_upload.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

absl::Status NotCollected(const std::string& message) {
  return errors::WithReason(absl::FailedPreconditionError(message), "OUTCOMES_NOT_COLLECTED");
}

}  // namespace

absl::Status MakeOutcomeDataset(const OutcomeStorage& storage,
                                const v1::CollectOutcomesRequest& request,
                                v1::CollectOutcomesResponse* response) {
  const auto id = security::ParseDatasetName(request.dataset(), "dataset");
  if (!id.ok()) return id.status();
  if (storage.collection == nullptr) {
    return NotCollected(
        "this server collects no outcomes; have the operator start it with --outcome-recordings");
  }
  serving::OutcomeCollection& outcomes = *storage.collection;
  const absl::Status none = NotCollected(
      "no outcome is collected; report outcomes with their scenes, then make the dataset");
  if (outcomes.empty()) return none;
  auto writer = storage.datasets->Create(*id, "outcomes of predictions", outcomes.bytes());
  if (!writer.ok()) return WithDatasetReason(writer.status());
  const auto written = outcomes.Write(**writer);
  if (!written.ok()) return WithDatasetReason(written.status());
  if (written->digests.empty()) return none;
  const auto committed = (*writer)->Commit();
  if (!committed.ok()) return WithDatasetReason(committed.status());
  auto dataset = storage.datasets->Get(*id);
  if (!dataset.ok()) return WithDatasetReason(dataset.status());
  if (request.forget()) {
    if (absl::Status status = outcomes.Forget(*written); !status.ok()) return status;
  }
  *response->mutable_dataset() = *std::move(dataset);
  response->set_surprising_recordings(written->surprising);
  response->set_sampled_recordings(written->sampled);
  return absl::OkStatus();
}

}  // namespace maneuver::rpc
