#include "server/store/stored_job.h"

#include <cstdint>
#include <limits>
#include <string_view>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "model/data/tfrecord.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_state.h"
#include "server/monitoring/logging.h"

namespace maneuver::store {

using monitoring::Log;
using monitoring::LogLevel;

namespace {

// The tag of field 536870911, the last one, as four bytes; then come these bytes.
constexpr std::string_view kChecksumTag("\xfd\xff\xff\xff\x0f", 5);
constexpr size_t kChecksumField = kChecksumTag.size() + sizeof(uint32_t);

std::string WithChecksum(std::string message) {
  const uint32_t crc = data::MaskedCrc32c(message);
  message += kChecksumTag;
  for (size_t i = 0; i < sizeof(crc); ++i) message += static_cast<char>(crc >> (8 * i));
  return message;
}

// Parses a message with or without its checksum. False if it is damaged.
bool ParseChecked(std::string_view bytes, google::protobuf::Message* message) {
  if (bytes.size() >= kChecksumField &&
      bytes.substr(bytes.size() - kChecksumField, kChecksumTag.size()) == kChecksumTag) {
    const std::string_view checked = bytes.substr(0, bytes.size() - kChecksumField);
    if (WithChecksum(std::string(checked)) != bytes) return false;
    return message->ParseFromArray(checked.data(), static_cast<int>(checked.size()));
  }
  // Of an earlier release, which knew no field that this one does not; or the tag itself is damaged.
  if (!message->ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return false;
  message->DiscardUnknownFields();
  return true;
}

// A damaged name may be no UTF-8, which a message must be.
std::string Readable(const std::string& name) { return absl::CHexEscape(name); }

absl::Status Forbidden(v1::JobState from, v1::JobState to) {
  return absl::FailedPreconditionError(
      absl::StrCat("a job that is ", std::string(jobs::JobStateLabel(from)), " cannot become ",
                   std::string(jobs::JobStateLabel(to))));
}

}  // namespace

std::string StoredJob(v1::Job job) {
  job.clear_progress();
  return WithChecksum(job.SerializeAsString());
}

std::string StoredProgress(const v1::JobProgress& progress) {
  return WithChecksum(progress.SerializeAsString());
}

std::string StoredDataset(const v1::Dataset& manifest) {
  return WithChecksum(manifest.SerializeAsString());
}

absl::StatusOr<v1::JobProgress> ParseStoredProgress(int64_t sequence, const std::string& bytes) {
  v1::JobProgress progress;
  if (!ParseChecked(bytes, &progress) || progress.sequence() != sequence) {
    return absl::DataLossError("the job store holds an event that is damaged");
  }
  return progress;
}

absl::StatusOr<v1::Job> ParseStoredJob(const JobKey& key, const std::string& bytes,
                                       const std::optional<std::string>& progress) {
  v1::Job job;
  if (!ParseChecked(bytes, &job) ||
      (progress && !ParseChecked(*progress, job.mutable_progress()))) {
    return absl::DataLossError(
        absl::StrCat("the job store holds a job that is damaged: ", Readable(key.name)));
  }
  if (job.name() != key.name || job.state() != key.state) {
    return absl::DataLossError(
        absl::StrCat("the job store contradicts itself about ", Readable(key.name)));
  }
  if (job.has_progress() && jobs::HasEnded(job.state())) {
    // The latest event is of before the end.
    job.mutable_progress()->clear_time_left();
    if (job.state() == v1::JOB_STATE_SUCCEEDED) job.mutable_progress()->set_fraction(1.0);
  }
  return job;
}

void AddToPage(absl::StatusOr<v1::Job> job, const std::string& name, DamageLog& damage,
               jobs::JobPage* page) {
  if (job.ok()) {
    page->jobs.push_back(*std::move(job));
  } else {
    damage.Report(job.status());
    const bool is_name = security::ParseJobName(name, "name").ok();
    page->damaged.push_back({is_name ? name : "", job.status(), page->jobs.size()});
  }
}

void DamageLog::Report(const absl::Status& damage) {
  std::string reason(damage.message());
  const MutexLock lock(mutex_);
  const auto [line, is_new] = reported_.insert(std::move(reason));
  if (is_new) Log(LogLevel::kError, "a stored job is damaged", {{"reason", *line}});
}

absl::StatusOr<v1::Dataset> ParseStoredDataset(const std::string& name, const std::string& bytes) {
  v1::Dataset manifest;
  if (!ParseChecked(bytes, &manifest) || manifest.name() != name) {
    return absl::DataLossError(
        absl::StrCat("the job store holds a manifest that is damaged: ", name));
  }
  return manifest;
}

int64_t CreateMicros(const v1::Job& job) {
  return job.create_time().seconds() * 1'000'000 + job.create_time().nanos() / 1'000;
}

int64_t AliasDigest(const security::ModelAliasName& name, int64_t version) {
  return data::MaskedCrc32c(absl::StrCat(name.ToString(), "=", version));
}

absl::StatusOr<serving::ModelAlias> StoredAlias(const security::ModelAliasName& name,
                                                int64_t version, std::optional<int64_t> digest) {
  if (digest && *digest != AliasDigest(name, version)) {
    return absl::DataLossError(
        absl::StrCat("the job store holds an alias that is damaged: ", name.ToString()));
  }
  return serving::ModelAlias{name, static_cast<int>(version)};
}

int64_t PriorityOf(const v1::Job& job) {
  if (job.has_evaluate()) return job.evaluate().priority();
  if (job.has_recalibrate()) return job.recalibrate().priority();
  if (job.has_tag()) return job.tag().priority();
  return job.has_cross_validate() ? job.cross_validate().priority() : job.train().priority();
}

absl::StatusOr<int64_t> ParsePageToken(const std::string& page_token) {
  int64_t before = std::numeric_limits<int64_t>::max();
  if (!page_token.empty() && (!absl::SimpleAtoi(page_token, &before) || before < 1)) {
    return absl::InvalidArgumentError("page_token: expected the next_page_token of a response");
  }
  return before;
}

absl::Status EditRunning(const jobs::JobEdit& end, v1::Job& job) {
  end(job);
  return jobs::CanMove(v1::JOB_STATE_RUNNING, job.state())
             ? absl::OkStatus()
             : Forbidden(v1::JOB_STATE_RUNNING, job.state());
}

absl::Status CheckMove(v1::JobState from, v1::JobState to) {
  if (from == v1::JOB_STATE_RUNNING || to == v1::JOB_STATE_RUNNING || !jobs::CanMove(from, to)) {
    return Forbidden(from, to);
  }
  return absl::OkStatus();
}

absl::Status NoSuchJob(const std::string& name) {
  return absl::NotFoundError(absl::StrCat("there is no ", name));
}

absl::Status NoSuchAlias(const security::ModelAliasName& name) {
  return absl::NotFoundError(absl::StrCat("there is no ", name.ToString()));
}

absl::Status NoSuchVersion(const security::ModelVersionName& name) {
  return errors::WithReason(absl::NotFoundError(absl::StrCat("there is no ", name.ToString())),
                            "MODEL_VERSION_NOT_FOUND", {{"model_version", name.ToString()}});
}

absl::Status HasAlias(const security::ModelVersionName& name) {
  return errors::WithReason(
      absl::FailedPreconditionError(
          absl::StrCat("an alias points to ", name.ToString(), "; point it elsewhere first")),
      "MODEL_VERSION_IN_USE", {{"model_version", name.ToString()}});
}

absl::Status LeaseEnded(const jobs::JobLease& lease) {
  return absl::AbortedError(absl::StrCat("the lease of ", lease.job, " has ended"));
}

absl::Status IsInState(const v1::Job& job) {
  return absl::FailedPreconditionError(
      absl::StrCat(job.name(), " is ", std::string(jobs::JobStateLabel(job.state()))));
}

absl::Status NotEnded(const v1::Job& job) {
  return absl::FailedPreconditionError(absl::StrCat(
      job.name(), " is ", std::string(jobs::JobStateLabel(job.state())), "; cancel it first"));
}

}  // namespace maneuver::store
