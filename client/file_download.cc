#include "client/file_download.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/call_status.h"
#include "client/file_digest.h"
#include "client/retry.h"

namespace maneuver::client {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxFileName = 200;

bool IsSame(const DownloadHeader& a, const DownloadHeader& b) {
  return a.resource == b.resource &&
         std::ranges::equal(a.files, b.files, {}, &v1::ModelFile::SerializeAsString,
                            &v1::ModelFile::SerializeAsString);
}

// [a-z0-9][a-z0-9._-]*: no name that a server sends leads out of the folder.
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
absl::Status CheckHeader(const DownloadHeader& header, const DownloadTarget& target) {
  std::set<std::string> names;
  for (const v1::ModelFile& file : header.files) {
    if (!IsSafeFileName(file.file()) || !names.insert(file.file()).second ||
        !IsSha256(file.sha256()) || file.size_bytes() < 0) {
      return absl::InternalError(
          absl::StrCat("the server sends a file that cannot be part of ", target.noun));
    }
  }
  if (names.empty() || header.files.size() > target.most_files) {
    return absl::InternalError(
        absl::StrCat("the server sends another number of files than ", target.noun, " has"));
  }
  return absl::OkStatus();
}

// Files on their way into a folder.
class Download {
 public:
  Download(const DownloadTarget& target, const fs::path& folder, const OnUploaded& on_progress)
      : target_(target), folder_(folder.lexically_normal()), on_progress_(on_progress) {
    if (folder_.filename().empty()) folder_ = folder_.parent_path();  // "models/town/"
    part_ = folder_.parent_path() / absl::StrCat(".", folder_.filename().string(), ".part");
  }

  // Returns what the next call asks for: what began to arrive.
  const std::string& resource() const {
    return header_.resource.empty() ? target_.name : header_.resource;
  }
  // Returns what the next call says has arrived.
  const ArrivedBytes& BeginCall() {
    requested_ = arrived_;
    return arrived_;
  }
  int64_t there() const { return progress_.there; }
  bool is_whole() const { return is_whole_; }

  // Takes the first message. False if the call is to be made again, without what is here already,
  // or if nothing is missing (is_whole).
  absl::StatusOr<bool> TakeHeader(const DownloadHeader& header) {
    if (absl::Status status = CheckHeader(header, target_); !status.ok()) return status;
    const bool is_planned = IsSame(header, header_);
    next_ = 0;
    file_.close();
    if (!is_planned) SetHeader(header);
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
    header_ = {};
    arrived_.Clear();
    progress_ = {};
  }

  absl::Status TakeChunk(std::string_view bytes) {
    while (!bytes.empty()) {
      if (absl::Status status = FinishFullFiles(); !status.ok()) return status;
      if (next_ == header_.files.size()) {
        return absl::InternalError("the server sends more bytes than its header says");
      }
      const int64_t left = header_.files.Get(next_).size_bytes() - arrived_.Get(next_);
      const auto taken = bytes.substr(
          0, static_cast<size_t>(std::min<int64_t>(left, static_cast<int64_t>(bytes.size()))));
      if (!file_.is_open()) {
        const auto mode = arrived_.Get(next_) == 0 ? std::ios::trunc : std::ios::app;
        file_.open(PartOf(next_), std::ios::binary | std::ios::out | mode);
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
    if (next_ < header_.files.size()) {
      return absl::UnavailableError("the server ended the download before its end");
    }
    std::error_code error;
    for (int i = 0; i < header_.files.size(); ++i) {
      fs::rename(PartOf(i), part_ / header_.files.Get(i).file(), error);
      if (error) return CannotWrite();
    }
    fs::rename(part_, folder_, error);
    if (error) return CannotWrite();
    is_whole_ = true;
    return absl::OkStatus();
  }

 private:
  const fs::path& PartOf(int file) const { return parts_[static_cast<size_t>(file)]; }

  // A part has the name of its digest; of files with the same bytes, the later ones have more.
  void SetHeader(const DownloadHeader& header) {
    header_ = header;
    parts_.clear();
    std::set<std::string> taken;
    for (const v1::ModelFile& file : header_.files) {
      const bool is_first = taken.insert(file.sha256()).second;
      parts_.push_back(part_ /
                       (is_first ? file.sha256() : absl::StrCat(file.sha256(), "-", file.file())));
    }
  }

  absl::Status CannotWrite() const {
    return absl::FailedPreconditionError(
        absl::StrCat("cannot write ", folder_.string(), ": see to its permissions and the disk"));
  }

  // OK if the folder holds the files of the header and nothing else.
  absl::Status CheckSame() const {
    std::set<std::string> names;
    bool is_same = true;
    for (const v1::ModelFile& file : header_.files) {
      names.insert(file.file());
      const auto digest = Sha256OfFile((folder_ / file.file()).string());
      is_same = is_same && digest.ok() && *digest == file.sha256();
      if (!is_same) break;
    }
    std::error_code error;
    for (fs::directory_iterator entry(folder_, error);
         is_same && !error && entry != fs::directory_iterator(); entry.increment(error)) {
      is_same = names.contains(entry->path().filename().string());
    }
    if (is_same && !error) return absl::OkStatus();
    return absl::AlreadyExistsError(absl::StrCat(folder_.string(), " exists already and is not ",
                                                 header_.resource, "; name another folder"));
  }

  // Looks what is here of the header's files, and removes what is of others.
  absl::Status Plan() {
    std::error_code error;
    fs::create_directories(part_, error);
    if (error) return CannotWrite();
    std::set<std::string> wanted;
    arrived_.Clear();
    progress_ = {};
    for (int i = 0; i < header_.files.size(); ++i) {
      const v1::ModelFile& file = header_.files.Get(i);
      wanted.insert(PartOf(i).filename().string());
      const auto size = fs::file_size(PartOf(i), error);
      const bool fits = !error && size <= static_cast<uintmax_t>(file.size_bytes());
      arrived_.Add(fits ? static_cast<int64_t>(size) : 0);
      progress_.there += *arrived_.rbegin();
      progress_.total += file.size_bytes();
    }
    std::vector<fs::path> others;
    for (fs::directory_iterator entry(part_, error); !error && entry != fs::directory_iterator();
         entry.increment(error)) {
      if (!wanted.contains(entry->path().filename().string())) others.push_back(entry->path());
    }
    for (const fs::path& other : others) fs::remove_all(other, error);
    progress_.resumed = progress_.there;
    ShowProgress(progress_.there);
    return absl::OkStatus();
  }

  // Moves past the files that have all their bytes, and checks them.
  absl::Status FinishFullFiles() {
    for (; next_ < header_.files.size(); ++next_) {
      const v1::ModelFile& file = header_.files.Get(next_);
      if (arrived_.Get(next_) < file.size_bytes()) return absl::OkStatus();
      if (file.size_bytes() == 0) std::ofstream(PartOf(next_), std::ios::app);
      file_.close();
      const auto digest = Sha256OfFile(PartOf(next_).string());
      if (!digest.ok()) return digest.status();
      if (*digest == file.sha256()) continue;
      std::error_code ignored;
      fs::remove(PartOf(next_), ignored);
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

  const DownloadTarget& target_;
  fs::path folder_;
  fs::path part_;
  const OnUploaded& on_progress_;
  DownloadHeader header_;
  std::vector<fs::path> parts_;  // [files]
  ArrivedBytes arrived_;         // [files]
  ArrivedBytes requested_;       // that the server was told of
  int next_ = 0;                 // file that is arriving
  std::ofstream file_;
  UploadProgress progress_;
  bool is_whole_ = false;
};

}  // namespace

absl::StatusOr<std::string> DownloadFiles(
    const ClientOptions& options, const DownloadTarget& target, const ReadDownload& read,
    const std::function<void(grpc::ClientContext&)>& introduce, const OnUploaded& on_progress,
    const CallOptions& call) {
  const absl::Time deadline = absl::Now() + call.timeout.value_or(options.deadlines.upload);
  std::error_code error;
  const fs::path folder = fs::absolute(target.folder, error);
  if (error) {
    return absl::InvalidArgumentError(
        absl::StrCat("cannot download into the folder \"", target.folder, "\": ", error.message()));
  }
  Download download(target, folder, on_progress);
  absl::Status local_error;

  // One call, to its end. OK without a whole folder: the call is to be made again.
  const auto follow = [&]() -> absl::Status {
    grpc::ClientContext context;
    introduce(context);
    context.set_deadline(absl::ToChronoTime(deadline));
    const Cancellation::Registration registration(call.cancellation,
                                                  [&context] { context.TryCancel(); });
    bool goes_on = true;
    bool is_first = true;
    const auto take = [&](bool is_header, const auto& work) {
      if (std::exchange(is_first, false) != is_header) {
        local_error = absl::InternalError("the server sends its header in the wrong place");
      } else {
        work();
      }
      goes_on = goes_on && local_error.ok();
      return goes_on;
    };
    const TakeDownload each = {.header =
                                   [&](const DownloadHeader& header) {
                                     return take(true, [&] {
                                       const auto taken = download.TakeHeader(header);
                                       local_error = taken.status();
                                       goes_on = taken.ok() && *taken;
                                     });
                                   },
                               .chunk =
                                   [&](const std::string& chunk) {
                                     return take(false,
                                                 [&] { local_error = download.TakeChunk(chunk); });
                                   }};
    const grpc::Status end = read(context, download.resource(), download.BeginCall(), each);
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
    if (download.is_whole()) return download.resource();
    has_arrived = has_arrived || download.there() > before;
    if (status.ok()) continue;
    // What lay here from before may have been wrong, and is gone now; or what is sent has changed
    // since: an action got a label, a shard more is tagged.
    const bool may_be_outdated = absl::IsDataLoss(status) || absl::IsInvalidArgument(status);
    if (!may_be_outdated || !std::exchange(may_start_clean, false)) return status;
    download.Forget();
    local_error = absl::OkStatus();
  }
}

}  // namespace maneuver::client
