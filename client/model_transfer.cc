#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/client.h"
#include "client/connection.h"
#include "client/file_digest.h"
#include "client/file_upload.h"

namespace maneuver::client {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxFiles = 16;
constexpr size_t kMaxFileName = 100;

absl::StatusOr<v1::ModelFile> DescribeFile(const fs::path& folder, const std::string& name) {
  v1::ModelFile file;
  std::error_code error;
  const auto size = fs::file_size(folder / name, error);
  if (error) {
    return absl::NotFoundError(
        absl::StrCat(folder.string(), " is not a model folder: it has no ", name));
  }
  auto digest = Sha256OfFile((folder / name).string());
  if (!digest.ok()) return digest.status();
  file.set_file(name);
  file.set_size_bytes(static_cast<int64_t>(size));
  file.set_sha256(*std::move(digest));
  return file;
}

// [a-z0-9][a-z0-9._-]*: no name of a server's leads out of the folder.
bool IsSafeFileName(const std::string& name) {
  const auto is_alnum = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); };
  return !name.empty() && name.size() <= kMaxFileName && is_alnum(name.front()) &&
         std::ranges::all_of(
             name, [&](char c) { return is_alnum(c) || c == '.' || c == '_' || c == '-'; });
}

bool IsSha256(const std::string& digest) {
  return digest.size() == 64 && std::ranges::all_of(digest, [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

// INTERNAL for a header that no server of ours sends.
absl::Status CheckHeader(const v1::DownloadModelHeader& header) {
  std::set<std::string> names;
  for (const v1::ModelFile& file : header.files()) {
    if (!IsSafeFileName(file.file()) || !names.insert(file.file()).second ||
        !IsSha256(file.sha256()) || file.size_bytes() < 0) {
      return absl::InternalError("the server sends a file that cannot be part of a model");
    }
  }
  if (names.empty() || header.files_size() > kMaxFiles) {
    return absl::InternalError("the server sends another number of files than a model has");
  }
  return absl::OkStatus();
}

// A version on its way into a folder.
class Download {
 public:
  Download(const std::string& folder, const Client::OnUploaded& on_progress)
      : folder_(fs::absolute(folder).lexically_normal()), on_progress_(on_progress) {
    if (folder_.filename().empty()) folder_ = folder_.parent_path();  // "models/town/"
    part_ = folder_.parent_path() / absl::StrCat(".", folder_.filename().string(), ".part");
  }

  // The next request: of the version that began to arrive, without what is here.
  //   name: of the version that is wanted.
  v1::DownloadModelVersionRequest MakeRequest(const std::string& name) {
    v1::DownloadModelVersionRequest request;
    request.set_name(header_.model_version().empty() ? name : header_.model_version());
    *request.mutable_arrived_bytes() = arrived_;
    requested_ = arrived_;
    return request;
  }
  const std::string& version() const { return header_.model_version(); }
  int64_t there() const { return progress_.there; }
  bool is_whole() const { return is_whole_; }

  // Takes the first message. False if the call is to be made again, without what is here already,
  // or if nothing is missing (is_whole).
  absl::StatusOr<bool> TakeHeader(const v1::DownloadModelHeader& header) {
    if (absl::Status status = CheckHeader(header); !status.ok()) return status;
    const bool is_planned = header.SerializeAsString() == header_.SerializeAsString();
    next_ = 0;
    file_.close();
    if (!is_planned) header_ = header;
    std::error_code error;
    if (fs::exists(folder_, error) && !fs::is_empty(folder_, error)) {
      if (absl::Status status = CheckSame(); !status.ok()) return status;
      is_whole_ = true;
      return false;
    }
    if (is_planned) return true;
    if (absl::Status status = Plan(); !status.ok()) return status;
    if (!requested_.empty()) return std::ranges::equal(arrived_, requested_);
    return std::ranges::all_of(arrived_, [](int64_t bytes) { return bytes == 0; });
  }

  // What is here is looked at anew, once a header says of what it is to be part.
  void Forget() {
    header_.Clear();
    arrived_.Clear();
  }

  absl::Status TakeChunk(std::string_view bytes) {
    while (!bytes.empty()) {
      if (absl::Status status = FinishFullFiles(); !status.ok()) return status;
      if (next_ == header_.files_size()) {
        return absl::InternalError("the server sends more bytes than its header says");
      }
      const int64_t left = header_.files(next_).size_bytes() - arrived_.Get(next_);
      const auto taken = bytes.substr(
          0, static_cast<size_t>(std::min<int64_t>(left, static_cast<int64_t>(bytes.size()))));
      if (!file_.is_open()) {
        const auto mode = arrived_.Get(next_) == 0 ? std::ios::trunc : std::ios::app;
        file_.open(PartOf(header_.files(next_)), std::ios::binary | std::ios::out | mode);
      }
      if (!file_.write(taken.data(), static_cast<std::streamsize>(taken.size())) ||
          !file_.flush()) {
        return CannotWrite();
      }
      bytes.remove_prefix(taken.size());
      *arrived_.Mutable(next_) += static_cast<int64_t>(taken.size());
      ShowProgress(progress_.there + static_cast<int64_t>(taken.size()));
    }
    return FinishFullFiles();
  }

  // All messages came: makes the folder.
  absl::Status Commit() {
    if (absl::Status status = FinishFullFiles(); !status.ok()) return status;
    if (next_ < header_.files_size()) {
      return absl::UnavailableError("the server ended the download before its end");
    }
    std::error_code error;
    for (const v1::ModelFile& file : header_.files()) {
      fs::rename(PartOf(file), part_ / file.file(), error);
      if (error) return CannotWrite();
    }
    fs::rename(part_, folder_, error);
    if (error) return CannotWrite();
    is_whole_ = true;
    return absl::OkStatus();
  }

 private:
  fs::path PartOf(const v1::ModelFile& file) const { return part_ / file.sha256(); }

  absl::Status CannotWrite() const {
    return absl::FailedPreconditionError(
        absl::StrCat("cannot write ", folder_.string(), ": see to its permissions and the disk"));
  }

  // OK if the folder holds the files of the header.
  absl::Status CheckSame() const {
    for (const v1::ModelFile& file : header_.files()) {
      const auto digest = Sha256OfFile((folder_ / file.file()).string());
      if (!digest.ok() || *digest != file.sha256()) {
        return absl::AlreadyExistsError(
            absl::StrCat(folder_.string(), " exists already and is not ", header_.model_version(),
                         "; name another folder"));
      }
    }
    return absl::OkStatus();
  }

  // Looks what is here of the header's files, and removes what is of others.
  absl::Status Plan() {
    std::error_code error;
    fs::create_directories(part_, error);
    if (error) return CannotWrite();
    std::set<std::string> wanted;
    arrived_.Clear();
    progress_ = {};
    for (const v1::ModelFile& file : header_.files()) {
      wanted.insert(file.sha256());
      const auto size = fs::file_size(PartOf(file), error);
      const bool fits = !error && size <= static_cast<uintmax_t>(file.size_bytes());
      arrived_.Add(fits ? static_cast<int64_t>(size) : 0);
      progress_.there += *arrived_.rbegin();
      progress_.total += file.size_bytes();
    }
    std::vector<fs::path> others;
    for (const auto& entry : fs::directory_iterator(part_, error)) {
      if (!wanted.contains(entry.path().filename().string())) others.push_back(entry.path());
    }
    for (const fs::path& other : others) fs::remove_all(other, error);
    progress_.resumed = progress_.there;
    ShowProgress(progress_.there);
    return absl::OkStatus();
  }

  // Moves past the files that have all their bytes, and checks them.
  absl::Status FinishFullFiles() {
    for (; next_ < header_.files_size(); ++next_) {
      const v1::ModelFile& file = header_.files(next_);
      if (arrived_.Get(next_) < file.size_bytes()) return absl::OkStatus();
      if (file.size_bytes() == 0) std::ofstream(PartOf(file), std::ios::app);
      file_.close();
      const auto digest = Sha256OfFile(PartOf(file).string());
      if (!digest.ok()) return digest.status();
      if (*digest == file.sha256()) continue;
      std::error_code ignored;
      fs::remove(PartOf(file), ignored);
      return absl::DataLossError(
          absl::StrCat(file.file(),
                       " arrived with another SHA-256 than the server says: it was altered on its "
                       "way, or on the server's disk, or on this one"));
    }
    return absl::OkStatus();
  }

  void ShowProgress(int64_t there) {
    progress_.there = there;
    if (on_progress_) on_progress_(progress_);
  }

  fs::path folder_;
  fs::path part_;
  const Client::OnUploaded& on_progress_;
  v1::DownloadModelHeader header_;
  ArrivedBytes arrived_;    // [files]
  ArrivedBytes requested_;  // that the server was told of
  int next_ = 0;            // file that is arriving
  std::ofstream file_;
  UploadProgress progress_;
  bool is_whole_ = false;
};

}  // namespace

absl::StatusOr<v1::ModelVersion> Client::UploadModelVersion(const std::string& folder,
                                                            const std::string& parent,
                                                            const OnUploaded& on_progress,
                                                            const CallOptions& call) {
  google::protobuf::RepeatedPtrField<v1::ModelFile> announced;
  std::vector<LocalFile> files;
  std::vector<std::string> names = {"model.json", "weights.safetensors"};
  std::error_code error;
  if (fs::exists(fs::path(folder) / "baselines.json", error)) {
    names.insert(names.end(), {"baselines.json", "baselines.safetensors"});
  }
  for (const std::string& name : names) {
    auto file = DescribeFile(folder, name);
    if (!file.ok()) return file.status();
    files.push_back({(fs::path(folder) / name).string(), file->size_bytes()});
    *announced.Add() = *std::move(file);
  }
  v1::ModelVersion committed;
  UploadCalls calls;
  calls.may_be_committed_before = true;
  calls.ask = [&](grpc::ClientContext& context, ArrivedBytes* arrived, bool* is_committed) {
    v1::QueryModelUploadRequest request;
    request.set_parent(parent);
    *request.mutable_files() = announced;
    v1::QueryModelUploadResponse answer;
    const grpc::Status status = connection_->models->QueryModelUpload(&context, request, &answer);
    arrived->Swap(answer.mutable_arrived_bytes());
    *is_committed = answer.has_committed();
    if (answer.has_committed()) committed = std::move(*answer.mutable_committed());
    return status;
  };
  calls.send = [&](grpc::ClientContext& context, const ArrivedBytes& arrived,
                   const UploadCalls::SendChunks& send_chunks) {
    const auto writer = connection_->models->UploadModelVersion(&context, &committed);
    v1::UploadModelVersionRequest first;
    first.mutable_header()->set_parent(parent);
    *first.mutable_header()->mutable_files() = announced;
    *first.mutable_header()->mutable_arrived_bytes() = arrived;
    const auto write = [&](std::string chunk) {
      v1::UploadModelVersionRequest message;
      message.set_chunk(std::move(chunk));
      return writer->Write(message);
    };
    if (writer->Write(first) && send_chunks(write)) writer->WritesDone();
    return writer->Finish();  // also says why it took no more
  };
  const absl::Status status = UploadFiles(
      connection_->options, files, calls,
      [this](grpc::ClientContext& context) { connection_->Introduce(context); }, on_progress, call);
  if (!status.ok()) return status;
  return committed;
}

absl::StatusOr<std::string> Client::DownloadModelVersion(const std::string& name,
                                                         const std::string& folder,
                                                         const OnUploaded& on_progress,
                                                         const CallOptions& call) {
  const ClientOptions& options = connection_->options;
  const absl::Time deadline = absl::Now() + call.timeout.value_or(options.deadlines.upload);
  Download download(folder, on_progress);
  absl::Status local_error;

  // One call, to its end. OK without a whole folder: the call is to be made again.
  const auto follow = [&]() -> absl::Status {
    grpc::ClientContext context;
    connection_->Introduce(context);
    context.set_deadline(absl::ToChronoTime(deadline));
    const Cancellation::Registration registration(call.cancellation,
                                                  [&context] { context.TryCancel(); });
    const auto reader =
        connection_->models->DownloadModelVersion(&context, download.MakeRequest(name));
    v1::DownloadModelVersionResponse message;
    bool goes_on = true;
    for (bool is_first = true; goes_on && reader->Read(&message); is_first = false) {
      if (is_first != message.has_header()) {
        local_error = absl::InternalError("the server sends its header in the wrong place");
      } else if (is_first) {
        const auto taken = download.TakeHeader(message.header());
        local_error = taken.status();
        goes_on = taken.ok() && *taken;
      } else {
        local_error = download.TakeChunk(message.chunk());
      }
      goes_on = goes_on && local_error.ok();
    }
    if (!goes_on) context.TryCancel();
    const grpc::Status end = reader->Finish();
    if (!local_error.ok()) return local_error;
    if (!goes_on) return absl::OkStatus();
    const absl::Status status = ToRetriable(end, call.cancellation);
    return status.ok() ? download.Commit() : status;
  };

  bool may_start_clean = true;
  bool has_arrived = false;
  for (;;) {
    // At first the download is given the patience of any call. Each byte earns it more.
    RetryPolicy policy = options.retry;
    if (has_arrived) policy.max_attempts = 1'000'000;
    const absl::Time give_up = std::min(deadline, absl::Now() + options.upload_patience);
    const int64_t before = download.there();
    const absl::Status status =
        RetryUnavailable(policy, give_up, call.cancellation, options.on_retry, [&] {
          absl::Status result = follow();
          return download.there() > before && absl::IsUnavailable(result) ? absl::OkStatus()
                                                                          : result;
        });
    if (download.is_whole()) return download.version();
    has_arrived = has_arrived || download.there() > before;
    if (status.ok()) continue;
    // What lay here from before may have been wrong, and is gone now; or the version has changed
    // since: an action got a label.
    const bool may_be_outdated = absl::IsDataLoss(status) || absl::IsInvalidArgument(status);
    if (!may_be_outdated || !std::exchange(may_start_clean, false)) return status;
    download.Forget();
    local_error = absl::OkStatus();
  }
}

}  // namespace maneuver::client
