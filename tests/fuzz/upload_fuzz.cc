// Uploads in any order: begun, continued, broken off, wrong, discarded, committed, by two callers.
// What is published has the announced digests, and nothing stays announced.
//
// Each byte of the input is an operation, and the one after it its argument.

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/files/digest.h"
#include "model/files/file_receiver.h"
#include "model/files/upload_staging.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

constexpr char kCallers[2][8] = {"", "planner"};
constexpr size_t kMostOperations = 48;

const std::vector<std::string>& Contents() {
  static const auto& contents =
      *new std::vector<std::string>{"the first shard, which is the longest of them",
                                    std::string("\0\1\2", 3), std::string(70, 'x')};
  return contents;
}

std::vector<files::AnnouncedFile> Announced() {
  static const auto& announced = *new std::vector<files::AnnouncedFile>([] {
    std::vector<files::AnnouncedFile> files;
    for (const std::string& content : Contents()) {
      files.push_back({.name = "file-" + std::to_string(files.size()),
                       .size_bytes = static_cast<int64_t>(content.size()),
                       .sha256 = files::Sha256Hex(content)});
    }
    return files;
  }());
  return announced;
}

// One caller and the upload that it has open.
struct Caller {
  std::unique_ptr<files::FileReceiver> receiver;
  std::string left;  // bytes that it would send if it sent the right ones
};

class Uploads {
 public:
  Uploads() : root_(Folder() / "uploads") {
    std::filesystem::create_directories(root_);
    staging_ = std::make_shared<files::UploadStaging>(root_);
  }
  ~Uploads() {
    for (Caller& caller : callers_) caller.receiver = nullptr;
    ExpectNothingUnderWay();
    std::filesystem::remove_all(root_);
  }
  Uploads(const Uploads&) = delete;
  Uploads& operator=(const Uploads&) = delete;

  void Do(uint8_t operation, uint8_t argument) {
    const size_t who = operation & 1;
    Caller& caller = callers_[who];
    switch ((operation >> 1) % 6) {
      case 0:
        Begin(who, argument);
        break;
      case 1:
        Send(caller, caller.left.substr(0, argument));
        break;
      case 2:
        Send(caller, std::string(argument % 100, static_cast<char>(argument)));
        break;
      case 3:
        Commit(caller);
        break;
      case 4:
        caller.receiver = nullptr;
        break;
      default:
        if (caller.receiver) caller.receiver->Discard();
        caller.receiver = nullptr;
        break;
    }
  }

 private:
  // Some callers say the truth about what has arrived, and some do not.
  void Begin(size_t who, uint8_t lie) {
    const auto slot = staging_->Enter("town", kCallers[who]);
    std::vector<int64_t> arrived = files::ArrivedBytes(slot->folder, Announced());
    for (size_t i = 0; i < arrived.size(); ++i) {
      Expect(arrived[i] >= 0 && arrived[i] <= Announced()[i].size_bytes,
             "no more arrived than announced");
    }
    if (lie % 4 == 0) arrived.clear();
    if (lie % 4 == 1) arrived[lie % arrived.size()] += lie % 5;
    for (size_t i = 0; i < arrived.size(); ++i) {
      arrived[i] = std::min(arrived[i], Announced()[i].size_bytes);  // as the service checks
    }
    auto begun = files::FileReceiver::Begin(
        staging_,
        {.id = "town",
         .resource = "datasets/town",
         .noun = "shard",
         .caller = kCallers[who],
         .files = Announced(),
         .arrived = arrived},
        [](uint64_t wanted, uint64_t there, const files::UploadStaging::Others&) {
          Expect(there <= wanted, "no more is there than is wanted");
          return absl::OkStatus();
        });
    if (!begun.ok()) return;
    callers_[who].left.clear();
    for (size_t i = 0; i < Contents().size(); ++i) {
      callers_[who].left +=
          Contents()[i].substr(arrived.empty() ? 0 : static_cast<size_t>(arrived[i]));
    }
    callers_[who].receiver = *std::move(begun);
  }

  static void Send(Caller& caller, const std::string& bytes) {
    if (!caller.receiver) return;
    const absl::Status status = caller.receiver->Append(bytes);
    if (status.ok()) {
      caller.left.erase(0, bytes.size());
    } else {
      Expect(!status.message().empty(), "an error says what is wrong");
    }
  }

  void Commit(Caller& caller) {
    if (!caller.receiver) return;
    const std::filesystem::path place = root_ / "town";
    bool published = false;
    const absl::Status status =
        caller.receiver->Commit(place, [&](const std::filesystem::path& made) {
          for (size_t i = 0; i < Contents().size(); ++i) {
            Expect(ReadBytes(made / Announced()[i].name) == Contents()[i],
                   "only what was announced is published");
          }
          std::filesystem::rename(made, place);
          published = true;
          return absl::OkStatus();
        });
    Expect(status.ok() == published, "OK means published");
    if (published) std::filesystem::remove_all(place);
    caller.receiver = nullptr;
  }

  void ExpectNothingUnderWay() {
    const auto slot = staging_->Enter("other", "");
    const absl::Status status =
        staging_->Announce(*slot, {}, [](const files::UploadStaging::Others& others) {
          Expect(others.under_way.announced == 0 && others.under_way.missing == 0,
                 "nothing stays announced");
          return absl::OkStatus();
        });
    Expect(status.ok(), status.ToString());
    staging_->End(*slot);
  }

  const std::filesystem::path root_;
  std::shared_ptr<files::UploadStaging> staging_;
  std::array<Caller, 2> callers_;
};

}  // namespace

void Upload(std::string_view bytes) {
  Uploads uploads;
  for (size_t i = 0; i + 1 < std::min(bytes.size(), 2 * kMostOperations); i += 2) {
    uploads.Do(static_cast<uint8_t>(bytes[i]), static_cast<uint8_t>(bytes[i + 1]));
  }
}

}  // namespace maneuver::fuzz
