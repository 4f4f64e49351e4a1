#include "server/rpc/dataset_service.h"

#include <chrono>
#include <functional>
#include <limits>
#include <string>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "model/artifact/training_presets.h"
#include "server/rpc/dataset_upload.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/paging.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

// The id of the last dataset of the page before is the token.
absl::Status ListPage(const data::DatasetStore& datasets, const v1::ListDatasetsRequest& request,
                      v1::ListDatasetsResponse* response) {
  const auto page_size = PageSizeOf(request.page_size());
  if (!page_size.ok()) return page_size.status();
  const std::string& after = request.page_token();
  if (!after.empty() && !security::IsResourceId(after)) return WrongPageToken();
  const auto limit = static_cast<size_t>(*page_size);
  auto page = datasets.List(after, limit + 1);
  if (!page.ok()) return WithDatasetReason(page.status());
  if (page->size() > limit) {
    page->resize(limit);
    response->set_next_page_token(security::IdOf(page->back().name()));
  }
  for (v1::Dataset& dataset : *page) *response->add_datasets() = std::move(dataset);
  return absl::OkStatus();
}

// The index of the first recording of the page is the token.
absl::Status ListPage(data::DatasetStore& datasets, const v1::ListScenariosRequest& request,
                      v1::ListScenariosResponse* response) {
  const auto id = security::ParseDatasetName(request.parent(), "parent");
  if (!id.ok()) return id.status();
  const auto page_size = PageSizeOf(request.page_size());
  if (!page_size.ok()) return page_size.status();
  uint32_t begin = 0;
  if (!request.page_token().empty() && !absl::SimpleAtoi(request.page_token(), &begin)) {
    return WrongPageToken();
  }
  const auto limit = static_cast<size_t>(*page_size);
  auto scenarios = datasets.ListScenarios(*id, begin, limit + 1);
  if (!scenarios.ok()) return WithDatasetReason(scenarios.status());
  if (scenarios->size() > limit) {
    scenarios->resize(limit);
    response->set_next_page_token(absl::StrCat(begin + limit));
  }
  for (v1::ScenarioSummary& scenario : *scenarios) {
    *response->add_scenarios() = std::move(scenario);
  }
  return absl::OkStatus();
}

absl::StatusOr<v1::DatasetSummary> Describe(const data::DatasetStore& datasets,
                                            const v1::DescribeDatasetRequest& request,
                                            const std::function<bool()>& gives_up) {
  const auto id = security::ParseDatasetName(request.name(), "name");
  if (!id.ok()) return id.status();
  v1::TrainingSettings settings;
  *settings.mutable_examples() = request.examples();
  settings = artifact::ResolveTrainingSettings(settings);
  const auto violations = artifact::ValidateTrainingSettings(settings);
  if (!violations.empty()) return errors::InvalidFields(violations);
  return datasets.Describe(*id, settings.model(), settings.examples(), gives_up);
}

absl::StatusOr<v1::Dataset> Register(const data::DatasetStore& datasets,
                                     const v1::RegisterDatasetRequest& request) {
  const auto id = security::ParseDatasetName(request.name(), "name");
  if (!id.ok()) return id.status();
  if (request.folder().empty() || request.folder().find('\0') != std::string::npos) {
    return errors::InvalidField("folder", "must be an absolute path on the server");
  }
  const absl::Status registrable = datasets.CheckRegistrable(request.folder());
  if (absl::IsPermissionDenied(registrable)) {
    return errors::WithReason(registrable, "FOLDER_NOT_ALLOWED");
  }
  auto dataset = datasets.Register(*id, request.folder());
  if (absl::IsInvalidArgument(dataset.status())) {
    return errors::InvalidField("folder", std::string(dataset.status().message()));
  }
  return dataset;
}

// Copies the value to *response.
template <typename Message>
absl::Status Answer(absl::StatusOr<Message> result, Message* response) {
  if (!result.ok()) return WithDatasetReason(result.status());
  *response = *std::move(result);
  return absl::OkStatus();
}

}  // namespace

DatasetService::DatasetService(data::DatasetStore& datasets, jobs::Supervisor& jobs,
                               const BlockingWork& blocking, security::AccessControl& access)
    : datasets_(datasets), jobs_(jobs), blocking_(blocking), access_(access) {}

DatasetService::~DatasetService() = default;

grpc::ServerReadReactor<grpc::ByteBuffer>* DatasetService::UploadDataset(
    grpc::CallbackServerContext* rpc, grpc::ByteBuffer* response) {
  return new DatasetUploadCall(datasets_, blocking_, access_, rpc, response);
}

grpc::ServerUnaryReactor* DatasetService::QueryUpload(grpc::CallbackServerContext* rpc,
                                                      const v1::QueryUploadRequest* request,
                                                      v1::QueryUploadResponse* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, caller = access_.NameOf(CredentialsOf(*rpc)), request, response] {
                      return AnswerQueryUpload(datasets_, caller, *request, response);
                    });
}

grpc::ServerUnaryReactor* DatasetService::RegisterDataset(grpc::CallbackServerContext*,
                                                          const v1::RegisterDatasetRequest* request,
                                                          v1::Dataset* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    return Answer(Register(datasets_, *request), response);
  });
}

grpc::ServerUnaryReactor* DatasetService::ListDatasets(grpc::CallbackServerContext*,
                                                       const v1::ListDatasetsRequest* request,
                                                       v1::ListDatasetsResponse* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, request, response] { return ListPage(datasets_, *request, response); });
}

grpc::ServerUnaryReactor* DatasetService::GetDataset(grpc::CallbackServerContext*,
                                                     const v1::GetDatasetRequest* request,
                                                     v1::Dataset* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto id = security::ParseDatasetName(request->name(), "name");
    return id.ok() ? Answer(datasets_.Get(*id), response) : id.status();
  });
}

// Returns whether a caller has cancelled, or the server ends. One whose time is over may ask again:
// its answer is kept for that. Its cancellation comes at about the deadline, too.
bool IsGivenUp(const grpc::CallbackServerContext& rpc) {
  constexpr std::chrono::seconds kAbout{1};
  return rpc.IsCancelled() && std::chrono::system_clock::now() + kAbout < DeadlineOf(rpc);
}

grpc::ServerUnaryReactor* DatasetService::DescribeDataset(grpc::CallbackServerContext* rpc,
                                                          const v1::DescribeDatasetRequest* request,
                                                          v1::DatasetSummary* response) {
  return AnswerFrom(blocking_, request, response, [this, rpc, request, response]() -> absl::Status {
    return Answer(Describe(datasets_, *request, [rpc] { return IsGivenUp(*rpc); }), response);
  });
}

grpc::ServerUnaryReactor* DatasetService::DeleteDataset(grpc::CallbackServerContext*,
                                                        const v1::DeleteDatasetRequest* request,
                                                        google::protobuf::Empty* response) {
  return AnswerFrom(blocking_, request, response, [this, request]() -> absl::Status {
    const auto id = security::ParseDatasetName(request->name(), "name");
    return id.ok() ? WithDatasetReason(jobs_.DeleteDataset(*id)) : id.status();
  });
}

grpc::ServerUnaryReactor* DatasetService::ListScenarios(grpc::CallbackServerContext*,
                                                        const v1::ListScenariosRequest* request,
                                                        v1::ListScenariosResponse* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, request, response] { return ListPage(datasets_, *request, response); });
}

grpc::ServerUnaryReactor* DatasetService::GetScenario(grpc::CallbackServerContext*,
                                                      const v1::GetScenarioRequest* request,
                                                      v1::Scenario* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto id = security::ParseDatasetName(request->parent(), "parent");
    if (!id.ok()) return id.status();
    auto scenario = datasets_.GetScenario(*id, request->scenario_id());
    if (absl::IsNotFound(scenario.status()) && datasets_.Contains(*id)) {
      return errors::WithReason(scenario.status(), "SCENARIO_NOT_FOUND");
    }
    return Answer(std::move(scenario), response);
  });
}

}  // namespace maneuver::rpc
