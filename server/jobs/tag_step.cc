#include "server/jobs/tag_step.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/tags/tag_store.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_settings.h"
#include "server/jobs/trainer_outcome.h"
#include "server/jobs/trainer_run.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {

Outcome TagStep::Run() {
  const JobRunEnvironment& environment = attempt_.environment;
  const tags::TagStore& store = *environment.tag_store;
  const v1::TagRequest& request = job_.tag();
  const std::string id = security::IdOf(request.tags());
  // It may have been deleted since the job was admitted.
  const auto model = ResolveReference(*environment.versions, request.model());
  if (!model.ok()) return {WithDefaultReason(model.status(), "MODEL_UNAVAILABLE")};
  absl::Status status = EnsureSettings(job_, *environment.versions, folder_);
  if (!status.ok()) return {std::move(status)};
  status = store.Begin(id, NewTags(job_));
  if (!status.ok()) return {WithDefaultReason(std::move(status), "CANNOT_WRITE")};
  const auto room = store.Room();
  if (!room.ok()) return {WithDefaultReason(room.status(), "CANNOT_WRITE")};

  std::vector<std::string> arguments = {"tag",
                                        "--model",
                                        model->folder,
                                        "--output",
                                        store.FolderOf(id),
                                        "--part",
                                        absl::StrCat(request.part()),
                                        "--parts",
                                        absl::StrCat(PartsOf(request)),
                                        "--checkpoints",
                                        CheckpointFolder(folder_),
                                        "--progress",
                                        "json"};
  for (const std::string& dataset : request.datasets()) {
    const std::string name = security::IdOf(dataset);
    arguments.insert(arguments.end(), {"--dataset", environment.datasets->FolderOf(name)});
  }
  if (request.has_stride()) {
    arguments.insert(arguments.end(), {"--stride", absl::StrCat(StrideOf(request))});
  }
  if (*room) arguments.insert(arguments.end(), {"--room", absl::StrCat(**room)});
  if (request.windows()) arguments.emplace_back("--windows");
  Outcome outcome = RunTrainer(job_, arguments, folder_, attempt_);
  if (!outcome.status.ok() || attempt_.IsStopped()) return outcome;
  auto tagged = store.Get(id);
  if (!tagged.ok()) return {WithDefaultReason(tagged.status(), "TAGS_DAMAGED")};
  *job_.mutable_tagged() = *std::move(tagged);
  return outcome;
}

}  // namespace maneuver::jobs
