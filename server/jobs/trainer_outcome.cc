#include "server/jobs/trainer_outcome.h"

#include <signal.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/file_system_failure.h"
#include "model/files/utf8.h"
#include "server/errors/error_details.h"
#include "server/jobs/trainer_protocol.h"

namespace maneuver::jobs {
namespace {

constexpr std::streamoff kTailBytes = 8 * 1024;
constexpr size_t kMaxLastLine = 400;
constexpr size_t kMostLines = 8;

// Printable, valid UTF-8, not too long.
std::string Presentable(std::string_view line) {
  std::string clean;
  while (!line.empty() && clean.size() < kMaxLastLine) {
    const size_t length = files::Utf8Length(line);
    if (length == 0) {
      clean += '?';
    } else if (files::IsControlCharacter(line.substr(0, length))) {
      clean += ' ';
    } else {
      clean.append(line.substr(0, length));
    }
    line.remove_prefix(length == 0 ? 1 : length);
  }
  return clean;
}

bool EndsPath(char c) {
  return std::isspace(static_cast<unsigned char>(c)) != 0 ||
         std::string_view("'\",;:()[]<>").find(c) != std::string_view::npos;
}

bool IsBlank(std::string_view line) { return line.find_first_not_of(" \t\r") == line.npos; }

// A sentence, and what the trainer said last.
std::string WithLastWords(absl::string_view sentence, const std::string& last_words) {
  if (last_words.empty()) return std::string(sentence);
  return absl::StrCat(sentence, " Its last line: ", last_words);
}

absl::Status Died(int number, const std::string& last_words) {
  const char* name = sigabbrev_np(number);
  const bool crashed = number == SIGSEGV || number == SIGABRT || number == SIGBUS ||
                       number == SIGILL || number == SIGFPE;
  const std::string sentence = absl::StrCat(
      "the trainer ", crashed ? "crashed" : "was killed", " by signal ", number, " (SIG",
      name != nullptr ? name : "?", ")",
      crashed ? "; this is a fault of the trainer: its log has more."
              : ": someone killed it, or the machine ran out of memory; resume the job, with more "
                "memory if it was that.");
  return errors::WithReason(absl::AbortedError(WithLastWords(sentence, last_words)), "TRAINER_DIED",
                            {{"signal", absl::StrCat(number)}});
}

// Whether one of several processes was lost: as the others say it, or as a launcher does which
// exits like a task that was killed.
bool HasLostRank(const ChildResult& result) {
  return result.signal == 0 && (result.exit_status == static_cast<int>(TrainerExit::kRankLost) ||
                                result.exit_status == 128 + SIGKILL);
}

absl::Status OutOfMemory(absl::string_view how, const std::string& last_words) {
  return errors::WithReason(
      absl::ResourceExhaustedError(WithLastWords(
          absl::StrCat(how,
                       "; train with a smaller batch, raster or model, or give it more "
                       "(--job-memory-limit of the server) and resume the job."),
          last_words)),
      "OUT_OF_MEMORY");
}

}  // namespace

absl::Status TrainerStatus(const ChildResult& result, const std::string& last_words) {
  if (result.over_memory_limit) {
    return OutOfMemory("the trainer took more memory than a job may", last_words);
  }
  if (result.out_of_memory) {
    return OutOfMemory("the system killed the trainer because memory ran out", last_words);
  }
  if (result.signal != 0) return Died(result.signal, last_words);
  const auto failed = [&last_words](absl::StatusCode code, errors::Reason reason,
                                    absl::string_view sentence) {
    return errors::WithReason(absl::Status(code, WithLastWords(sentence, last_words)), reason);
  };
  if (HasLostRank(result)) {
    return failed(absl::StatusCode::kUnavailable, "RANK_LOST",
                  "a process of the training ended or did not answer in time; resume the job, "
                  "which continues from its last checkpoint.");
  }
  switch (static_cast<TrainerExit>(result.exit_status)) {
    case TrainerExit::kOk:
      return absl::OkStatus();
    case TrainerExit::kInvalidSettings:
      return failed(absl::StatusCode::kInvalidArgument, "INVALID_SETTINGS",
                    "the trainer refused the settings; correct them and ask again.");
    case TrainerExit::kUnusableData:
      return failed(absl::StatusCode::kFailedPrecondition, "UNUSABLE_DATA",
                    "the data cannot be used; upload the dataset again.");
    case TrainerExit::kNotEnough:
      return failed(absl::StatusCode::kFailedPrecondition, "NOT_ENOUGH_EXAMPLES",
                    "the datasets hold not enough examples for these settings.");
    case TrainerExit::kOutOfMemory:
      return OutOfMemory("the trainer ran out of memory", last_words);
    case TrainerExit::kDiskFull:
      return failed(absl::StatusCode::kResourceExhausted, "DISK_FULL",
                    "the disk is full; free some space on the server and resume the job.");
    case TrainerExit::kCannotWrite:
      return failed(absl::StatusCode::kFailedPrecondition, "CANNOT_WRITE",
                    "the trainer cannot write in the data folder of the server; see to its "
                    "permissions and resume the job.");
    case TrainerExit::kDiverged:
      return failed(absl::StatusCode::kAborted, "TRAINING_DIVERGED",
                    "the training diverged: its loss is no longer finite; try a smaller "
                    "optimization.learning_rate.");
    case TrainerExit::kCollapsed:
      return failed(absl::StatusCode::kFailedPrecondition, "ACTIONS_COLLAPSED",
                    "the model uses too few of its actions to be of use.");
    case TrainerExit::kNotFinite:
      return failed(absl::StatusCode::kAborted, "METRICS_NOT_FINITE",
                    "a metric of the evaluation is not finite; see whether the data or the model "
                    "is damaged.");
    case TrainerExit::kNoRoom:
      return TagQuotaReached();
    case TrainerExit::kRankLost:
    case TrainerExit::kInternal:
      break;
  }
  return errors::WithReason(
      absl::InternalError(WithLastWords(
          absl::StrCat("the trainer failed (exit status ", result.exit_status, ")."), last_words)),
      "TRAINER_INTERNAL");
}

absl::Status WithDefaultReason(absl::Status status, errors::Reason reason) {
  if (errors::IsStoreAway(status)) return status;
  if (files::IsFileSystemFailure(status)) {
    return errors::WithFolderReason(std::move(status), "data");
  }
  absl::Status clean(status.code(), WithoutPaths(std::string(status.message())));
  return errors::WithReason(
      std::move(clean), absl::IsResourceExhausted(status) ? errors::Reason("DISK_FULL") : reason);
}

absl::Status CannotStartTrainer(const absl::Status& reason) {
  // Its log could not be made: that is the disk's fault.
  if (absl::IsResourceExhausted(reason) || files::IsFileSystemFailure(reason)) {
    return WithDefaultReason(reason, "TRAINER_INTERNAL");
  }
  return errors::WithReason(
      absl::InternalError(absl::StrCat(
          "the trainer cannot be started: ", WithoutPaths(std::string(reason.message())),
          "; is maneuver-trainer installed beside the server?")),
      "TRAINER_INTERNAL");
}

bool HasDied(const ChildResult& result) {
  return (result.signal != 0 || HasLostRank(result)) && !result.timed_out &&
         !result.over_memory_limit;
}

absl::Status ServerInterrupted() {
  return errors::WithReason(
      absl::AbortedError("the server stopped while the job ran; it continues from its last "
                         "checkpoint"),
      "SERVER_INTERRUPTED");
}

absl::Status GaveUp(absl::Status last, int processes) {
  absl::Status status(last.code(), absl::StrCat("given up, since ", processes,
                                                " processes of the job in a row came to no new "
                                                "checkpoint; the last: ",
                                                last.message()));
  last.ForEachPayload([&status](absl::string_view url, const absl::Cord& payload) {
    status.SetPayload(url, payload);
  });
  return status;
}

absl::Status TagQuotaReached() {
  return errors::WithReason(
      absl::ResourceExhaustedError(
          "all tags together have as many bytes as they may (--tag-quota); delete tags that are no "
          "longer needed, and tag or resume the job again"),
      "TAG_QUOTA");
}

absl::Status WallTimeExceeded(std::chrono::milliseconds limit) {
  return errors::WithReason(
      absl::DeadlineExceededError(absl::StrCat(
          "the job ran for ", limit.count() / 1000,
          " s, as long as this server lets a job run (--job-time-limit); its last checkpoint is "
          "kept, and resuming the job gives it as long again")),
      "WALL_TIME_EXCEEDED");
}

std::vector<std::string> LastLines(const std::filesystem::path& log, int64_t from) {
  std::ifstream file(log, std::ios::binary | std::ios::ate);
  if (!file) return {};
  const std::streamoff size = file.tellg();
  file.seekg(std::max<std::streamoff>({0, size - kTailBytes, from}));
  std::string line;
  std::vector<std::string> last;
  while (std::getline(file, line)) {
    if (IsBlank(line)) continue;
    last.push_back(std::move(line));
    if (last.size() > kMostLines) last.erase(last.begin());
  }
  for (std::string& text : last) text = Presentable(WithoutPaths(text));
  return last;
}

std::string WithoutPaths(std::string_view text) {
  std::string result;
  size_t at = 0;
  while (at < text.size()) {
    // A slash that a letter or digit precedes is part of a name such as datasets/town.
    const bool starts =
        text[at] == '/' && (at == 0 || EndsPath(text[at - 1]) || text[at - 1] == '=');
    if (!starts) {
      result += text[at++];
      continue;
    }
    size_t end = at;
    while (end < text.size() && !EndsPath(text[end])) ++end;
    std::string_view path = text.substr(at, end - at);
    while (path.ends_with('/')) path.remove_suffix(1);
    result.append(path.substr(path.rfind('/') + 1));
    at = end;
  }
  return result;
}

}  // namespace maneuver::jobs
