#include "server/rpc/tag_service.h"

#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/digest.h"
#include "model/tags/shard_tags.h"
#include "model/tags/tag_folder.h"
#include "model/tags/tag_store.h"
#include "server/rpc/download_call.h"
#include "server/rpc/paging.h"
#include "server/security/resource_name.h"
#include "server/serving/file_sender.h"

namespace maneuver::rpc {
namespace {

namespace fs = std::filesystem;

absl::Status WithTagsReason(absl::Status status) {
  if (!errors::ReasonOf(status).empty()) return status;
  if (absl::IsNotFound(status)) return errors::WithReason(std::move(status), "TAGS_NOT_FOUND");
  if (absl::IsDataLoss(status)) return errors::WithReason(std::move(status), "TAGS_DAMAGED");
  return status;
}

// The id of the last tags of the page before is the token.
absl::Status ListPage(const tags::TagStore& store, const v1::ListTagsRequest& request,
                      v1::ListTagsResponse* response) {
  const auto page_size = PageSizeOf(request.page_size());
  if (!page_size.ok()) return page_size.status();
  const std::string& after = request.page_token();
  if (!after.empty() && !security::IsResourceId(after)) return WrongPageToken();
  const auto limit = static_cast<size_t>(*page_size);
  auto ids = store.List(after, limit + 1);
  if (!ids.ok()) return ids.status();
  if (ids->size() > limit) {
    ids->resize(limit);
    response->set_next_page_token(ids->back());
  }
  for (const std::string& id : *ids) {
    auto tags = store.Get(id);
    if (absl::IsNotFound(tags.status())) continue;  // deleted meanwhile
    // Damaged ones are listed by their name alone, so that they can be seen and deleted.
    if (!tags.ok()) response->add_tags()->set_name(absl::StrCat("tags/", id));
    if (tags.ok()) *response->add_tags() = *std::move(tags);
  }
  return absl::OkStatus();
}

// The files of the complete shards of one folder.
class TagsReader {
 public:
  // FAILED_PRECONDITION if no job has begun. Computes the SHA-256 of all files.
  absl::Status Open(const tags::TagStore& store, const std::string& id,
                    const v1::DownloadTagsRequest& request) {
    if (!store.Contains(id)) return store.Get(id).status();
    const fs::path folder = store.FolderOf(id);
    const auto schema = tags::ReadSchema(folder);
    if (absl::IsNotFound(schema.status())) {
      return errors::WithReason(
          absl::FailedPreconditionError(
              absl::StrCat("no job has begun to write tags/", id, "; wait until its job runs")),
          "TAGS_NOT_BEGUN");
    }
    if (!schema.ok()) return schema.status();
    header_.set_name(absl::StrCat("tags/", id));
    absl::Status status = Add(folder / tags::kSchemaFile);
    for (const tags::TagFile& file : schema->content.files()) {
      if (!status.ok()) return status;
      if (!tags::IsTagged(folder, *schema, file)) continue;
      status = Add(tags::CsvFileOf(folder, file));
      if (status.ok()) status = Add(tags::TagsFileOf(folder, file));
    }
    *header_.mutable_files() = sender_.files();
    return status.ok() ? sender_.Skip(request.arrived_bytes()) : status;
  }

  const v1::DownloadTagsHeader& header() const { return header_; }
  absl::StatusOr<std::string> Next() { return sender_.Next(); }

 private:
  absl::Status Add(const fs::path& file) {
    // Complete files do not change. There may be more than a process can have open.
    absl::Status status = sender_.Add(file.parent_path(), file.filename().string(),
                                      serving::FileSender::Opening::kLater);
    if (!status.ok()) return status;
    auto digest = files::Sha256OfFile(file);
    if (!digest.ok()) return digest.status();
    sender_.file(sender_.files().size() - 1).set_sha256(*std::move(digest));
    return absl::OkStatus();
  }

  v1::DownloadTagsHeader header_;
  serving::FileSender sender_;
};

class TagsDownloadCall final : public DownloadCall<v1::DownloadTagsResponse, TagsReader> {
 public:
  TagsDownloadCall(const tags::TagStore& store, const BlockingWork& blocking,
                   security::AccessControl& access, grpc::CallbackServerContext* rpc,
                   const v1::DownloadTagsRequest& request)
      : DownloadCall(blocking, rpc), store_(store), request_(request) {
    Start(access, "/maneuver.v1.TagService/DownloadTags");
  }

 private:
  absl::StatusOr<std::unique_ptr<TagsReader>> Open() override {
    const auto id = security::ParseTagsName(request_.name(), "name");
    if (!id.ok()) return id.status();
    auto reader = std::make_unique<TagsReader>();
    if (absl::Status status = reader->Open(store_, *id, request_); !status.ok()) return status;
    return reader;
  }
  absl::Status WithReason(absl::Status status) const override {
    return WithTagsReason(std::move(status));
  }

  const tags::TagStore& store_;
  const v1::DownloadTagsRequest request_;
};

}  // namespace

TagService::TagService(jobs::Supervisor& jobs, const BlockingWork& blocking,
                       security::AccessControl& access)
    : jobs_(jobs), blocking_(blocking), access_(access) {}

TagService::~TagService() = default;

grpc::ServerUnaryReactor* TagService::ListTags(grpc::CallbackServerContext*,
                                               const v1::ListTagsRequest* request,
                                               v1::ListTagsResponse* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return ListPage(jobs_.tag_store(), *request, response);
  });
}

grpc::ServerUnaryReactor* TagService::GetTags(grpc::CallbackServerContext*,
                                              const v1::GetTagsRequest* request,
                                              v1::Tags* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response]() -> absl::Status {
    const auto id = security::ParseTagsName(request->name(), "name");
    if (!id.ok()) return id.status();
    auto tags = jobs_.tag_store().Get(*id);
    if (!tags.ok()) return WithTagsReason(tags.status());
    *response = *std::move(tags);
    return absl::OkStatus();
  });
}

grpc::ServerWriteReactor<v1::DownloadTagsResponse>* TagService::DownloadTags(
    grpc::CallbackServerContext* rpc, const v1::DownloadTagsRequest* request) {
  return new TagsDownloadCall(jobs_.tag_store(), blocking_, access_, rpc, *request);
}

grpc::ServerUnaryReactor* TagService::DeleteTags(grpc::CallbackServerContext*,
                                                 const v1::DeleteTagsRequest* request,
                                                 google::protobuf::Empty* response) {
  return AnswerFrom(blocking_, request, response, [this, request]() -> absl::Status {
    const auto id = security::ParseTagsName(request->name(), "name");
    return id.ok() ? WithTagsReason(jobs_.DeleteTags(*id)) : id.status();
  });
}

}  // namespace maneuver::rpc
