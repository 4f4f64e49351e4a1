// The part of Supervisor that is about tags.

#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/supervisor.h"
#include "server/jobs/trainer_outcome.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

std::string TagsId(const v1::Job& job) { return security::IdOf(job.tag().tags()); }

absl::Status WithTagsReason(const absl::Status& status) {
  if (absl::IsAlreadyExists(status)) return errors::WithReason(status, "TAGS_EXIST");
  if (absl::IsDataLoss(status)) return errors::WithReason(status, "TAGS_DAMAGED");
  return status.ok() ? status : WithDefaultReason(status, "CANNOT_WRITE");
}

}  // namespace

absl::StatusOr<v1::Job> Supervisor::Tag(const v1::TagRequest& request) {
  if (absl::Status status = CheckTagRequest(request); !status.ok()) return status;
  const std::string digest = RequestDigest(request);
  // An alias may have gone on since the job was first asked for.
  bool found = false;
  auto earlier = EarlierJob(request.request_id(), digest, &found);
  if (found || !earlier.ok()) return earlier;
  const auto model = ResolveReference(versions_, request.model());
  if (!model.ok()) return model.status();
  v1::Job job;
  *job.mutable_tag() = request;
  job.mutable_tag()->set_model(model->name.ToString());
  return Admit(std::move(job), request.request_id(), digest, request.validate_only());
}

absl::Status Supervisor::CheckTags(const v1::Job& job) const {
  const auto room = tags_.Room();
  if (!room.ok()) return WithTagsReason(room.status());
  if (*room == 0) return TagQuotaReached();
  return WithTagsReason(tags_.CheckBegin(TagsId(job), NewTags(job)));
}

absl::Status Supervisor::BeginTags(const v1::Job& job, bool* made) const {
  return WithTagsReason(tags_.Begin(TagsId(job), NewTags(job), made));
}

void Supervisor::WithdrawTags(const v1::Job& job) const {
  if (!IsShared()) tags_.Withdraw(TagsId(job));
}

absl::Status Supervisor::DeleteTags(const std::string& id) {
  absl::StatusOr<std::filesystem::path> detached;
  {
    const MutexLock lock(mutex_);
    for (const v1::JobState state : {v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING}) {
      const auto jobs = store_.ListInState(state, std::nullopt);
      // Of the store: the caller would take it for the tags'.
      if (!jobs.ok()) return errors::WithStorageReason(jobs.status());
      for (const v1::Job& job : *jobs) {
        if (!job.has_tag() || TagsId(job) != id) continue;
        return errors::WithReason(
            absl::FailedPreconditionError(absl::StrCat(job.name(), " writes tags/", id,
                                                       "; wait for it to end, or cancel it")),
            "TAGS_IN_USE", {{"job", job.name()}});
      }
    }
    detached = tags_.Detach(id);
  }
  if (!detached.ok()) return detached.status();
  std::error_code ignored;  // the next start removes what is left
  std::filesystem::remove_all(*detached, ignored);
  return absl::OkStatus();
}

}  // namespace maneuver::jobs
