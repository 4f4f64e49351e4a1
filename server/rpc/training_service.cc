#include "server/rpc/training_service.h"

#include <string>
#include <utility>

#include "server/rpc/paging.h"
#include "server/rpc/training_watch.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

absl::Status WithJobReason(absl::Status status) {
  return absl::IsNotFound(status) ? errors::WithReason(std::move(status), "JOB_NOT_FOUND") : status;
}

absl::Status Answer(absl::StatusOr<v1::Job> job, v1::Job* response) {
  if (job.ok()) *response = *std::move(job);
  return job.status();
}

absl::Status ListPage(jobs::Supervisor& jobs, const v1::ListJobsRequest& request,
                      v1::ListJobsResponse* response) {
  const auto page_size = PageSizeOf(request.page_size());
  if (!page_size.ok()) return page_size.status();
  auto page = jobs.List(*page_size, request.page_token());
  if (absl::IsInvalidArgument(page.status())) return WrongPageToken();
  if (!page.ok()) return page.status();
  for (v1::Job& job : page->jobs) {
    // Hundreds of kilobytes a job, for one that wants its figures alone.
    if (job.has_evaluation()) {
      job.mutable_evaluation()->clear_sampled_examples();
      job.mutable_evaluation()->clear_rivals();
    }
    job.clear_cross_validation();
    *response->add_jobs() = std::move(job);
  }
  response->set_next_page_token(std::move(page->next_page_token));
  return absl::OkStatus();
}

// Jobs by their whole name, once it was checked.
absl::StatusOr<std::string> JobName(const std::string& name) {
  const auto id = security::ParseJobName(name, "name");
  if (!id.ok()) return id.status();
  return name;
}

}  // namespace

TrainingService::TrainingService(jobs::Supervisor& jobs, const BlockingWork& blocking,
                                 security::AccessControl& access)
    : jobs_(jobs), blocking_(blocking), access_(access) {}

TrainingService::~TrainingService() = default;

grpc::ServerUnaryReactor* TrainingService::Train(grpc::CallbackServerContext*,
                                                 const v1::TrainRequest* request,
                                                 v1::Job* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, request, response] { return Answer(jobs_.Train(*request), response); });
}

grpc::ServerUnaryReactor* TrainingService::Evaluate(grpc::CallbackServerContext*,
                                                    const v1::EvaluateRequest* request,
                                                    v1::Job* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return Answer(jobs_.Evaluate(*request), response);
  });
}

grpc::ServerUnaryReactor* TrainingService::CrossValidate(grpc::CallbackServerContext*,
                                                         const v1::CrossValidateRequest* request,
                                                         v1::Job* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return Answer(jobs_.CrossValidate(*request), response);
  });
}

grpc::ServerUnaryReactor* TrainingService::Recalibrate(grpc::CallbackServerContext*,
                                                       const v1::RecalibrateRequest* request,
                                                       v1::Job* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return Answer(jobs_.Recalibrate(*request), response);
  });
}

grpc::ServerUnaryReactor* TrainingService::Tag(grpc::CallbackServerContext*,
                                               const v1::TagRequest* request, v1::Job* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, request, response] { return Answer(jobs_.Tag(*request), response); });
}

grpc::ServerUnaryReactor* TrainingService::GetJob(grpc::CallbackServerContext*,
                                                  const v1::GetJobRequest* request,
                                                  v1::Job* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto name = JobName(request->name());
    return name.ok() ? WithJobReason(Answer(jobs_.Get(*name), response)) : name.status();
  });
}

grpc::ServerUnaryReactor* TrainingService::ListJobs(grpc::CallbackServerContext*,
                                                    const v1::ListJobsRequest* request,
                                                    v1::ListJobsResponse* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, request, response] { return ListPage(jobs_, *request, response); });
}

grpc::ServerUnaryReactor* TrainingService::CancelJob(grpc::CallbackServerContext*,
                                                     const v1::CancelJobRequest* request,
                                                     v1::Job* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto name = JobName(request->name());
    return name.ok() ? WithJobReason(Answer(jobs_.Cancel(*name), response)) : name.status();
  });
}

grpc::ServerUnaryReactor* TrainingService::ResumeJob(grpc::CallbackServerContext*,
                                                     const v1::ResumeJobRequest* request,
                                                     v1::Job* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto name = JobName(request->name());
    return name.ok() ? WithJobReason(Answer(jobs_.Resume(*name), response)) : name.status();
  });
}

grpc::ServerUnaryReactor* TrainingService::DeleteJob(grpc::CallbackServerContext*,
                                                     const v1::DeleteJobRequest* request,
                                                     google::protobuf::Empty* response) {
  return AnswerFrom(blocking_, request, response, [this, request]() -> absl::Status {
    const auto name = JobName(request->name());
    return name.ok() ? WithJobReason(jobs_.Delete(*name)) : name.status();
  });
}

grpc::ServerWriteReactor<v1::WatchJobResponse>* TrainingService::WatchJob(
    grpc::CallbackServerContext* rpc, const v1::WatchJobRequest* request) {
  return new JobWatchCall(jobs_, blocking_, access_, rpc, *request);
}

}  // namespace maneuver::rpc
