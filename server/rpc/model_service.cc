#include "server/rpc/model_service.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/evaluation/rival_requirements.h"
#include "model/files/utf8.h"
#include "model/inference/action_model.h"
#include "server/jobs/job_requests.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/model_transfer.h"
#include "server/rpc/paging.h"
#include "server/serving/version_description.h"

namespace maneuver::rpc {
namespace {

using StoredVersion = serving::VersionStore::StoredVersion;

constexpr size_t kMaxLabelLength = 64;
constexpr double kMostSpeed = 100.0;  // m/s, of GetActionSetRequest

// The place in the list after which the next page starts: "{create time, ns}/{name}".
struct PageStart {
  int64_t nanoseconds = 0;
  security::ModelVersionName name;
};

int64_t Nanoseconds(const StoredVersion& version) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             version.create_time.time_since_epoch())
      .count();
}

std::string MakePageToken(const StoredVersion& last) {
  return absl::StrCat(Nanoseconds(last), "/", last.name.ToString());
}

absl::StatusOr<PageStart> ParsePageToken(std::string_view token) {
  PageStart start;
  const auto [end, error] = std::from_chars(token.begin(), token.end(), start.nanoseconds);
  if (error == std::errc() && end != token.end() && *end == '/') {
    auto name =
        security::ParseModelVersionName(token.substr(end + 1 - token.begin()), "page_token");
    if (name.ok()) {
      start.name = *std::move(name);
      return start;
    }
  }
  return WrongPageToken();
}

// Whether `version` comes after the start of a page, in the order of VersionStore::List.
bool ComesAfter(const StoredVersion& version, const PageStart& start) {
  const int64_t nanoseconds = Nanoseconds(version);
  if (nanoseconds != start.nanoseconds) return nanoseconds < start.nanoseconds;
  if (version.name.model != start.name.model) return version.name.model > start.name.model;
  return version.name.version < start.name.version;
}

absl::Status ListPage(const serving::VersionStore& store, const serving::ServingTable& table,
                      const v1::ListModelVersionsRequest& request,
                      v1::ListModelVersionsResponse* response) {
  std::string model;
  if (request.parent() != "models/-") {
    auto parsed = security::ParseModelName(request.parent(), "parent");
    if (!parsed.ok()) return parsed.status();
    model = *std::move(parsed);
  }
  const auto page_size = PageSizeOf(request.page_size());
  if (!page_size.ok()) return page_size.status();
  std::vector<StoredVersion> versions = store.List(model);
  if (!request.page_token().empty()) {
    const auto start = ParsePageToken(request.page_token());
    if (!start.ok()) return start.status();
    std::erase_if(versions,
                  [&](const StoredVersion& version) { return !ComesAfter(version, *start); });
  }
  const size_t count = std::min(versions.size(), static_cast<size_t>(*page_size));
  for (size_t i = 0; i < count; ++i) {
    auto version = serving::DescribeVersion(store, table, versions[i].name);
    if (absl::IsNotFound(version.status())) continue;  // deleted meanwhile
    v1::ModelVersion* proto = response->add_model_versions();
    if (version.ok()) {
      *proto = *std::move(version);
      proto->mutable_manifest()->clear_actions();
      proto->mutable_manifest()->clear_rivals();
    } else {
      // A damaged one is listed, so that it can be seen and deleted, with no manifest.
      proto->set_name(versions[i].name.ToString());
      for (std::string& alias : table.AliasesOf(versions[i].name)) {
        proto->add_aliases(std::move(alias));
      }
    }
  }
  if (count < versions.size()) response->set_next_page_token(MakePageToken(versions[count - 1]));
  return absl::OkStatus();
}

// The version that `name` means, described.
absl::StatusOr<v1::ModelVersion> DescribeReference(
    const serving::VersionStore& store, const serving::ServingTable& table,
    const std::optional<security::ModelReference>& reference) {
  const auto name = table.Resolve(reference);
  if (!name.ok()) return name.status();
  return serving::DescribeVersion(store, table, *name);
}

// Decodes the actions of `version` at the speed that the request asks for, if that makes a
// difference. May load the version.
absl::Status DrawAtSpeed(serving::ServingTable& table, const v1::GetActionSetRequest& request,
                         v1::ModelVersion* version) {
  if (!request.has_speed()) return absl::OkStatus();
  if (!(request.speed() >= 0.0 && request.speed() <= kMostSpeed)) {
    return errors::InvalidField("speed", absl::StrCat("expected 0 to ", kMostSpeed, " m/s"));
  }
  const v1::ModelManifest& manifest = version->manifest();
  if (!artifact::HasReference(manifest.spec()) || manifest.actions().empty()) {
    return absl::OkStatus();
  }
  const auto name = security::ParseModelReference(version->name(), "name");
  if (!name.ok()) return name.status();
  auto handle = table.Find(*name);
  if (handle.ok() && *handle == nullptr) handle = table.Load(*name);
  if (!handle.ok()) return handle.status();

  auto& actions = *version->mutable_manifest()->mutable_actions();
  std::vector<double> usage;
  const auto effective = std::make_unique<bool[]>(static_cast<size_t>(actions.size()));
  for (const v1::Action& action : actions) {
    effective[usage.size()] = action.effective();
    usage.push_back(action.usage());
  }
  std::vector<v1::Action> drawn = inference::DecodeActionSet(
      (*handle)->model(), usage, {effective.get(), usage.size()}, request.speed());
  for (size_t k = 0; k < drawn.size(); ++k) {
    actions[static_cast<int>(k)].mutable_distribution()->Swap(drawn[k].mutable_distribution());
  }
  return absl::OkStatus();
}

// The name of the last report of the page before is the token. One that was measured anew in
// between has moved to the front: the page then begins with it, and some are seen twice.
absl::Status ListReportsPage(const serving::VersionStore& store, const serving::ServingTable& table,
                             const v1::ListEvaluationReportsRequest& request,
                             v1::ListEvaluationReportsResponse* response) {
  const auto reference = security::ParseModelReference(request.parent(), "parent");
  if (!reference.ok()) return reference.status();
  const auto page_size = PageSizeOf(request.page_size());
  if (!page_size.ok()) return page_size.status();
  if (!request.page_token().empty() &&
      !security::ParseEvaluationName(request.page_token(), "page_token").ok()) {
    return WrongPageToken();
  }
  const auto version = table.Resolve(*reference);
  if (!version.ok()) return version.status();
  auto reports = store.ListReports(*version);
  if (!reports.ok()) return reports.status();
  auto next = reports->begin();
  if (!request.page_token().empty()) {
    next = std::ranges::find(*reports, request.page_token(), &v1::EvaluationReport::name);
    if (next == reports->end()) return WrongPageToken();
    ++next;
  }
  for (int i = 0; i < *page_size && next != reports->end(); ++i, ++next) {
    *response->add_evaluation_reports() = std::move(*next);
  }
  if (next != reports->end()) {
    response->set_next_page_token(response->evaluation_reports().rbegin()->name());
  }
  return absl::OkStatus();
}

// OK if the newest report of the version on the request's dataset shows what is required.
absl::Status CheckRequirements(const serving::VersionStore& store,
                               const v1::SetModelAliasRequest& request,
                               const security::ModelVersionName& version) {
  if (request.requirements().empty()) {
    if (request.dataset().empty()) return absl::OkStatus();
    return errors::InvalidField("dataset", "only goes with requirements");
  }
  std::vector<scene::FieldViolation> violations;
  jobs::CheckRequirements(request.requirements(), "requirements", violations);
  if (!violations.empty()) return errors::InvalidFields(violations);
  const auto dataset = security::ParseDatasetName(request.dataset(), "dataset");
  if (!dataset.ok()) return dataset.status();
  const auto report = store.GetReport({version, *dataset});
  if (!report.ok()) return report.status();
  if (!report->has_rivals()) {
    return errors::WithReason(
        absl::FailedPreconditionError(
            absl::StrCat(report->name(),
                         " says nothing of rivals: an earlier release measured it; evaluate the "
                         "version on ",
                         request.dataset(), " again")),
        "EVALUATION_OUTDATED", {{"evaluation", report->name()}});
  }
  const std::vector<v1::RivalShortfall> shortfalls =
      evaluation::FindShortfalls(report->rivals(), request.requirements());
  if (shortfalls.empty()) return absl::OkStatus();
  return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                version.ToString(), " does not show on ", request.dataset(),
                                " what is required: ", evaluation::ShortfallText(shortfalls))),
                            "REQUIREMENTS_NOT_MET", {{"evaluation", report->name()}});
}

}  // namespace

ModelService::ModelService(serving::VersionStore& store, serving::ServingTable& table,
                           serving::VersionUploads& uploads, const BlockingWork& blocking,
                           security::AccessControl& access)
    : store_(store), table_(table), uploads_(uploads), blocking_(blocking), access_(access) {}

ModelService::~ModelService() = default;

grpc::ServerUnaryReactor* ModelService::ListModelVersions(
    grpc::CallbackServerContext*, const v1::ListModelVersionsRequest* request,
    v1::ListModelVersionsResponse* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return ListPage(store_, table_, *request, response);
  });
}

grpc::ServerUnaryReactor* ModelService::GetModelVersion(grpc::CallbackServerContext*,
                                                        const v1::GetModelVersionRequest* request,
                                                        v1::ModelVersion* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto reference = security::ParseModelReference(request->name(), "name");
    if (!reference.ok()) return reference.status();
    auto version = DescribeReference(store_, table_, *reference);
    if (version.ok()) *response = *std::move(version);
    return version.status();
  });
}

grpc::ServerUnaryReactor* ModelService::DeleteModelVersion(
    grpc::CallbackServerContext*, const v1::DeleteModelVersionRequest* request,
    google::protobuf::Empty* response) {
  return AnswerFrom(blocking_, request, response, [this, request]() -> absl::Status {
    const auto name = security::ParseModelVersionName(request->name(), "name");
    return name.ok() ? table_.Delete(*name) : name.status();
  });
}

grpc::ServerUnaryReactor* ModelService::SetModelAlias(grpc::CallbackServerContext*,
                                                      const v1::SetModelAliasRequest* request,
                                                      v1::ModelAlias* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto name = security::ParseModelAliasName(request->name(), "name");
    if (!name.ok()) return name.status();
    const auto version = security::ParseModelVersionName(request->model_version(), "model_version");
    if (!version.ok()) return version.status();
    if (version->model != name->model) {
      return errors::InvalidField("model_version", "an alias points to a version of its own model");
    }
    if (auto status = CheckRequirements(store_, *request, *version); !status.ok()) return status;
    if (auto status = table_.SetAlias(*name, version->version); !status.ok()) return status;
    response->set_name(name->ToString());
    response->set_model_version(version->ToString());
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* ModelService::DeleteModelAlias(grpc::CallbackServerContext*,
                                                         const v1::DeleteModelAliasRequest* request,
                                                         google::protobuf::Empty* response) {
  return AnswerFrom(blocking_, request, response, [this, request]() -> absl::Status {
    const auto name = security::ParseModelAliasName(request->name(), "name");
    return name.ok() ? table_.DeleteAlias(*name) : name.status();
  });
}

grpc::ServerUnaryReactor* ModelService::GetActionSet(grpc::CallbackServerContext*,
                                                     const v1::GetActionSetRequest* request,
                                                     v1::ActionSet* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto reference = security::ParseOptionalModelReference(request->name(), "name");
    if (!reference.ok()) return reference.status();
    auto version = DescribeReference(store_, table_, *reference);
    if (!version.ok()) return version.status();
    const v1::ModelSpec& spec = version->manifest().spec();
    if (const absl::Status status = DrawAtSpeed(table_, *request, &*version); !status.ok()) {
      return status;
    }
    response->set_model_version(version->name());
    const auto times = artifact::WaypointTimes(spec.trajectory());
    response->mutable_waypoint_times()->Assign(times.begin(), times.end());
    if (artifact::HasReference(spec)) {
      response->set_speed(request->has_speed() ? request->speed() : inference::kActionSetSpeed);
    }
    response->mutable_actions()->Swap(version->mutable_manifest()->mutable_actions());
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* ModelService::LabelAction(grpc::CallbackServerContext*,
                                                    const v1::LabelActionRequest* request,
                                                    v1::Action* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto name = security::ParseModelVersionName(request->name(), "name");
    if (!name.ok()) return name.status();
    const std::string& label = request->label();
    if (files::IsLongerThan(label, kMaxLabelLength)) {
      return errors::InvalidField("label", "longer than 64 characters");
    }
    if (files::HasUnprintableCharacters(label)) {
      return errors::InvalidField("label", "has control characters; use text that can be printed");
    }
    if (!label.empty() && label.find_first_not_of(' ') == std::string::npos) {
      return errors::InvalidField("label", "is blank; leave it empty to remove the label");
    }
    auto action = table_.LabelAction(*name, request->action_id(), label);
    if (absl::IsOutOfRange(action.status())) {
      return errors::InvalidField("action_id", std::string(action.status().message()));
    }
    if (action.ok()) *response = *action;
    return action.status();
  });
}

grpc::ServerUnaryReactor* ModelService::ListEvaluationReports(
    grpc::CallbackServerContext*, const v1::ListEvaluationReportsRequest* request,
    v1::ListEvaluationReportsResponse* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return ListReportsPage(store_, table_, *request, response);
  });
}

grpc::ServerUnaryReactor* ModelService::GetEvaluationReport(
    grpc::CallbackServerContext*, const v1::GetEvaluationReportRequest* request,
    v1::EvaluationReport* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto name = security::ParseEvaluationName(request->name(), "name");
    if (!name.ok()) return name.status();
    auto report = store_.GetReport(*name);
    if (report.ok()) *response = *std::move(report);
    return report.status();
  });
}

grpc::ServerWriteReactor<v1::DownloadModelVersionResponse>* ModelService::DownloadModelVersion(
    grpc::CallbackServerContext* rpc, const v1::DownloadModelVersionRequest* request) {
  return new ModelDownloadCall(store_, table_, blocking_, access_, rpc, *request);
}

grpc::ServerReadReactor<grpc::ByteBuffer>* ModelService::UploadModelVersion(
    grpc::CallbackServerContext* rpc, grpc::ByteBuffer* response) {
  return new ModelUploadCall(uploads_, blocking_, access_, rpc, response);
}

grpc::ServerUnaryReactor* ModelService::QueryModelUpload(grpc::CallbackServerContext* rpc,
                                                         const v1::QueryModelUploadRequest* request,
                                                         v1::QueryModelUploadResponse* response) {
  return AnswerFrom(blocking_, request, response,
                    [this, caller = access_.NameOf(CredentialsOf(*rpc)), request, response] {
                      return AnswerQueryModelUpload(uploads_, caller, *request, response);
                    });
}

}  // namespace maneuver::rpc
