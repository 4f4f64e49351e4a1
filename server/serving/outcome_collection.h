// Keeps outcomes on disk until a dataset is made of them: the most surprising ones, and a uniform
// sample of the others, within a bound. Of one event only the most surprising outcome is among the
// surprising ones, so that overlapping windows of one surprise do not crowd out others.
//
//   <folder>/<digest>,<event>,<surprise>.outcome   a Scenario, named by the first 32 digits of its
//                                                  SHA-256; without an event, <digest>,<surprise>
//
// The sample needs no state: it holds the outcomes with the smallest digests. So an outcome that is
// reported again changes nothing, and neither does a crash.

#ifndef MANEUVER_SERVER_SERVING_OUTCOME_COLLECTION_H_
#define MANEUVER_SERVER_SERVING_OUTCOME_COLLECTION_H_

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/data/dataset_folder.h"
#include "server/monitoring/metrics.h"

namespace maneuver::serving {

struct CollectedOutcome {
  v1::Scenario recording;  // as OutcomeRecording makes it
  double surprise = 0.0;   // the larger, the rather it is kept; finite
  // The event that it shares with near-duplicates, as EventOf names it; empty: its own.
  std::string event = {};
};

// Returns the name of what happens in one drive within 5 seconds; empty if the drive has no name.
//   prediction_time: seconds on the scenario's clock
std::string EventOf(const std::string& scenario_id, double prediction_time);

// Safe to use from any thread. Calls wait for the disk.
class OutcomeCollection {
 public:
  // Opens the folder and creates it if needed. Removes what an interrupted write left, and what is
  // above the bound.
  //   max_bytes: of all files together, of which at most one half is for the surprising ones
  static absl::StatusOr<std::unique_ptr<OutcomeCollection>> Open(
      std::filesystem::path folder, int64_t max_bytes, monitoring::MetricRegistry& metrics);

  // Adds outcomes. Once it returns OK, each is on disk unless the bound leaves no room for it.
  // Adding an outcome again changes nothing. An outcome of more than a quarter of the bound is not
  // kept. After an error some may have been added.
  absl::Status Add(const std::vector<CollectedOutcome>& outcomes);

  // What a dataset got.
  struct Written {
    std::vector<std::string> digests;
    int64_t surprising = 0;
    int64_t sampled = 0;
  };
  // Adds all outcomes to the writer, by digest. Skips damaged files, and those that the writer finds
  // invalid, with a line in the log. Other errors of a file or the writer end it.
  absl::StatusOr<Written> Write(data::DatasetWriter& writer) const;
  // Removes these outcomes.
  absl::Status Forget(const Written& written);

  int64_t bytes() const;  // of all files
  bool empty() const { return bytes() == 0; }

 private:
  struct Kept {
    double surprise = 0.0;  // to three decimals, as in the file's name
    int64_t bytes = 0;
    std::string event = {};
    bool is_surprising = false;
  };
  struct Metrics {
    explicit Metrics(monitoring::MetricRegistry& registry);
    monitoring::Gauge& surprising;
    monitoring::Gauge& sampled;
    monitoring::Gauge& bytes;
    monitoring::Gauge& limit;
  };

  OutcomeCollection(std::filesystem::path folder, int64_t max_bytes,
                    monitoring::MetricRegistry& metrics);

  absl::Status ReadFolder();
  absl::Status AddOne(const CollectedOutcome& outcome) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Insert(const std::string& digest, const Kept& kept) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Moves one of the surprising ones into the sample.
  void MoveToSample(std::string digest) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void RemoveSurprising(const std::string& digest, const Kept& kept)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Erase(const std::string& digest) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Returns the outcomes that are above the bound.
  std::vector<std::string> Excess() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status RemoveFiles(const std::vector<std::string>& digests)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Show() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::filesystem::path FileOf(const std::string& digest, const Kept& kept) const;

  const std::filesystem::path folder_;
  const int64_t max_bytes_;
  Metrics metrics_;
  mutable Mutex mutex_;
  std::map<std::string, Kept> kept_ ABSL_GUARDED_BY(mutex_);  // by digest
  // Surprise and digest of the surprising ones, and their digests by event; digests of the sample.
  std::set<std::pair<double, std::string>> surprising_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::string> events_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> sampled_ ABSL_GUARDED_BY(mutex_);
  int64_t surprising_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t sampled_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_OUTCOME_COLLECTION_H_
