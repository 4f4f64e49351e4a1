// Counts what a dataset contains, on several threads.

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <numbers>
#include <optional>
#include <span>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/strip.h"
#include "locks/mutex.h"
#include "model/data/dataset_folder.h"
#include "model/data/example_index.h"
#include "model/data/shard_records.h"
#include "model/machine/usable_cores.h"
#include "model/scene/duration.h"
#include "model/scene/target_frame.h"

namespace maneuver::data {
namespace {

// The number of recordings that wait for each thread.
constexpr size_t kWaitingPerThread = 2;
// The distance of MapCoverage.examples_on_lanes, metres.
constexpr double kOnLane = 3.0;

// The edges of the speed histogram, metres per second.
constexpr double kSpeedEdges[] = {0.0,  1.0,  2.5,  5.0,  7.5,  10.0,
                                  12.5, 15.0, 20.0, 25.0, 30.0, 40.0};
constexpr double kTurnEdgesDegrees[] = {-180.0, -120.0, -60.0, -30.0, -15.0, -5.0,
                                        5.0,    15.0,   30.0,  60.0,  120.0, 180.0};

// Turns AGENT_TYPE_VEHICLE into VEHICLE.
std::string WithoutPrefix(const std::string& name, absl::string_view prefix) {
  return std::string(absl::StripPrefix(name, prefix));
}

// Returns "VEHICLE", for example.
std::string TypeName(const v1::Agent& agent) {
  return WithoutPrefix(v1::AgentType_Name(agent.type()), "AGENT_TYPE_");
}

v1::Histogram EmptyHistogram(std::span<const double> edges, double scale) {
  v1::Histogram histogram;
  for (const double edge : edges) histogram.add_edges(scale * edge);
  histogram.mutable_counts()->Resize(static_cast<int>(edges.size()) - 1, 0);
  return histogram;
}

void Count(double value, v1::Histogram* histogram) {
  const auto& edges = histogram->edges();
  const auto above = std::upper_bound(edges.begin() + 1, edges.end() - 1, value);
  const int bin = static_cast<int>(above - edges.begin()) - 1;
  histogram->set_counts(bin, histogram->counts(bin) + 1);
}

void AddTo(const v1::Histogram& more, v1::Histogram* sum) {
  for (int i = 0; i < more.counts_size(); ++i) {
    sum->set_counts(i, sum->counts(i) + more.counts(i));
  }
}

void AddTo(const google::protobuf::Map<std::string, int64_t>& more,
           google::protobuf::Map<std::string, int64_t>* sum) {
  for (const auto& [name, count] : more) (*sum)[name] += count;
}

// The lanes of one recording.
class Lanes {
 public:
  explicit Lanes(const v1::Scenario& recording) {
    for (const v1::MapFeature& feature : recording.map_features()) {
      if (feature.type() != v1::MAP_FEATURE_TYPE_LANE_CENTERLINE) continue;
      Lane lane{.feature = &feature};
      const int points = std::min(feature.x_size(), feature.y_size());
      for (int i = 0; i < points; ++i) {
        lane.min_x = std::min(lane.min_x, feature.x(i));
        lane.max_x = std::max(lane.max_x, feature.x(i));
        lane.min_y = std::min(lane.min_y, feature.y(i));
        lane.max_y = std::max(lane.max_y, feature.y(i));
        if (i > 0) {
          length_ += std::hypot(feature.x(i) - feature.x(i - 1), feature.y(i) - feature.y(i - 1));
        }
      }
      if (points > 0) lanes_.push_back(lane);
    }
  }

  bool empty() const { return lanes_.empty(); }
  double length() const { return length_; }

  // Returns whether a lane is at most `distance` from a point, metres.
  bool Near(double x, double y, double distance) const {
    return std::ranges::any_of(lanes_, [&](const Lane& lane) {
      return x >= lane.min_x - distance && x <= lane.max_x + distance &&
             y >= lane.min_y - distance && y <= lane.max_y + distance &&
             IsNear(*lane.feature, x, y, distance);
    });
  }

 private:
  struct Lane {
    const v1::MapFeature* feature;
    double min_x = HUGE_VAL;
    double max_x = -HUGE_VAL;
    double min_y = HUGE_VAL;
    double max_y = -HUGE_VAL;
  };

  static bool IsNear(const v1::MapFeature& lane, double x, double y, double distance) {
    const int points = std::min(lane.x_size(), lane.y_size());
    for (int i = 0; i < points; ++i) {
      // The segment from this point to the next; the last point has none.
      const int next = std::min(i + 1, points - 1);
      const double along_x = lane.x(next) - lane.x(i);
      const double along_y = lane.y(next) - lane.y(i);
      const double squared = along_x * along_x + along_y * along_y;
      const double from_x = x - lane.x(i);
      const double from_y = y - lane.y(i);
      const double share =
          squared > 0.0 ? std::clamp((from_x * along_x + from_y * along_y) / squared, 0.0, 1.0)
                        : 0.0;
      if (std::hypot(from_x - share * along_x, from_y - share * along_y) <= distance) return true;
    }
    return false;
  }

  std::vector<Lane> lanes_;
  double length_ = 0.0;
};

// Returns whether an agent stays nearer than `far` to its first state, metres.
bool NeverGoesAs(double far, const v1::Agent& agent) {
  return std::ranges::all_of(agent.states(), [&](const v1::AgentState& state) {
    return std::hypot(state.x() - agent.states(0).x(), state.y() - agent.states(0).y()) < far;
  });
}

// Returns the mean speed from the state before `time` to the state after it. Not every recording
// states velocities.
double SpeedAt(double time, const v1::Agent& agent) {
  const int now = scene::FindState(agent, time, HUGE_VAL, HUGE_VAL);
  const v1::AgentState& before = agent.states(std::max(0, now - 1));
  const v1::AgentState& after = agent.states(std::min(now + 1, agent.states_size() - 1));
  const double step = after.time() - before.time();
  return step > 0.0 ? std::hypot(after.x() - before.x(), after.y() - before.y()) / step : 0.0;
}

// The counts of one thread.
class Counts {
 public:
  Counts(const v1::ModelSpec& spec, const v1::ExampleSettings& settings)
      : spec_(spec), settings_(settings) {
    spec_.clear_target_types();
    for (const v1::AgentType type : {v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_PEDESTRIAN,
                                     v1::AGENT_TYPE_CYCLIST, v1::AGENT_TYPE_OTHER}) {
      spec_.add_target_types(type);
    }
    // Counts every standing window: see DatasetSummary.
    settings_.set_keep_standing(1.0);
    horizon_ =
        spec.trajectory().waypoints() * scene::ToSeconds(spec.trajectory().waypoint_interval());
    *summary_.mutable_example_settings() = settings;
    summary_.set_horizon_seconds(horizon_);
    *summary_.mutable_speeds() = EmptyHistogram(kSpeedEdges, 1.0);
    *summary_.mutable_turns() = EmptyHistogram(kTurnEdgesDegrees, std::numbers::pi / 180.0);
  }

  void Add(const v1::Scenario& recording) {
    std::unordered_map<int64_t, const v1::Agent*> by_id;
    for (const v1::Agent& agent : recording.agents()) {
      by_id[agent.id()] = &agent;
      ++(*summary_.mutable_agents_by_type())[TypeName(agent)];
      if (agent.type() == v1::AGENT_TYPE_VEHICLE && !agent.states().empty() &&
          NeverGoesAs(settings_.standing_distance(), agent)) {
        summary_.set_standing_vehicles(summary_.standing_vehicles() + 1);
      }
    }
    for (const v1::MapFeature& feature : recording.map_features()) {
      ++(*summary_.mutable_map_features_by_type())[WithoutPrefix(
          v1::MapFeatureType_Name(feature.type()), "MAP_FEATURE_TYPE_")];
    }
    const Lanes lanes(recording);
    v1::MapCoverage& coverage = *summary_.mutable_map_coverage();
    coverage.set_lane_length(coverage.lane_length() + lanes.length());
    if (!lanes.empty()) coverage.set_recordings_with_lanes(coverage.recordings_with_lanes() + 1);
    for (const Example& example : EnumerateExamples(recording, 0, spec_, settings_)) {
      const v1::Agent& target = *by_id.at(example.target_id);
      ++(*summary_.mutable_examples_by_type())[TypeName(target)];
      if (target.type() == v1::AGENT_TYPE_VEHICLE) Add(example, target, lanes);
    }
  }

  // Adds the counts of another thread.
  void Add(const v1::DatasetSummary& other) {
    AddTo(other.agents_by_type(), summary_.mutable_agents_by_type());
    AddTo(other.map_features_by_type(), summary_.mutable_map_features_by_type());
    AddTo(other.examples_by_type(), summary_.mutable_examples_by_type());
    AddTo(other.speeds(), summary_.mutable_speeds());
    AddTo(other.turns(), summary_.mutable_turns());
    summary_.set_examples(summary_.examples() + other.examples());
    summary_.set_standing_examples(summary_.standing_examples() + other.standing_examples());
    summary_.set_standing_vehicles(summary_.standing_vehicles() + other.standing_vehicles());
    v1::MapCoverage& coverage = *summary_.mutable_map_coverage();
    const v1::MapCoverage& more = other.map_coverage();
    coverage.set_recordings_with_lanes(coverage.recordings_with_lanes() +
                                       more.recordings_with_lanes());
    coverage.set_examples_on_lanes(coverage.examples_on_lanes() + more.examples_on_lanes());
    coverage.set_lane_length(coverage.lane_length() + more.lane_length());
  }

  v1::DatasetSummary& summary() { return summary_; }

 private:
  void Add(const Example& example, const v1::Agent& target, const Lanes& lanes) {
    summary_.set_examples(summary_.examples() + 1);
    Count(SpeedAt(example.time, target), summary_.mutable_speeds());
    if (lanes.Near(example.X_WT.x(), example.X_WT.y(), kOnLane)) {
      v1::MapCoverage& coverage = *summary_.mutable_map_coverage();
      coverage.set_examples_on_lanes(coverage.examples_on_lanes() + 1);
    }
    if (example.standing) {
      summary_.set_standing_examples(summary_.standing_examples() + 1);
      return;
    }
    const int last = scene::FindState(target, example.time + horizon_, HUGE_VAL, HUGE_VAL);
    const double turn = target.states(last).heading() - example.X_WT.heading();
    Count(std::remainder(turn, 2.0 * std::numbers::pi), summary_.mutable_turns());
  }

  v1::ModelSpec spec_;  // with all types of targets
  v1::ExampleSettings settings_;
  double horizon_ = 0.0;
  v1::DatasetSummary summary_;
};

// A bounded queue from the thread that reads records to the threads that count.
class Records {
 public:
  struct Record {
    v1::Shard shard;  // that contains it
    uint64_t offset;
    std::string payload;
  };

  explicit Records(size_t most) : most_(most) {}

  // Waits for room. Returns false after an error.
  bool Put(Record record) {
    const MutexLock lock(mutex_);
    while (records_.size() >= most_ && status_.ok()) changed_.Wait(mutex_);
    if (!status_.ok()) return false;
    records_.push_back(std::move(record));
    changed_.NotifyAll();
    return true;
  }
  void End() {
    const MutexLock lock(mutex_);
    ended_ = true;
    changed_.NotifyAll();
  }
  // Waits for a record. Returns nothing at the end and after an error.
  std::optional<Record> Take() {
    const MutexLock lock(mutex_);
    while (records_.empty() && !ended_) changed_.Wait(mutex_);
    if (records_.empty() || !status_.ok()) return std::nullopt;
    Record record = std::move(records_.front());
    records_.pop_front();
    changed_.NotifyAll();
    return record;
  }
  void Fail(const absl::Status& status) {
    const MutexLock lock(mutex_);
    status_.Update(status);
    changed_.NotifyAll();
  }
  absl::Status status() {
    const MutexLock lock(mutex_);
    return status_;
  }

 private:
  const size_t most_;
  Mutex mutex_;
  CondVar changed_;
  std::deque<Record> records_ ABSL_GUARDED_BY(mutex_);
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
};

void CountAll(Records& records, const std::function<bool()>& gives_up, Counts* counts) {
  while (const auto record = records.Take()) {
    if (gives_up && gives_up()) {
      records.Fail(absl::CancelledError("nobody waits for the description any longer"));
      return;
    }
    v1::Scenario scenario;
    if (!scenario.ParseFromString(record->payload)) {
      records.Fail(NotAMessage(record->shard, record->offset, "a Scenario"));
      return;
    }
    counts->Add(scenario);
  }
}

}  // namespace

absl::StatusOr<v1::DatasetSummary> DescribeDataset(const std::filesystem::path& folder,
                                                   const v1::ModelSpec& spec,
                                                   const v1::ExampleSettings& settings, int threads,
                                                   const std::function<bool()>& gives_up) {
  const auto manifest = ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  const auto wanted = static_cast<size_t>(threads > 0 ? threads : machine::UsableCores());
  const size_t useful = std::min(wanted, static_cast<size_t>(manifest->recordings()));
  Records records(kWaitingPerThread * useful);
  std::vector<Counts> counts(useful, Counts(spec, settings));
  std::vector<std::thread> workers;
  workers.reserve(useful);
  for (Counts& each : counts) workers.emplace_back([&] { CountAll(records, gives_up, &each); });
  int64_t skipped = 0;
  records.Fail(ForEachPayload(
      folder, v1::SHARD_CONTENT_SCENARIOS, OnDamage::kStop,
      [&](const v1::Shard& shard, uint64_t offset, std::string&& payload, bool* more) {
        *more = records.Put({shard, offset, std::move(payload)});
        return absl::OkStatus();
      },
      &skipped));
  records.End();
  for (std::thread& worker : workers) worker.join();
  if (absl::Status status = records.status(); !status.ok()) return status;

  v1::DatasetSummary& summary = counts.front().summary();
  for (size_t i = 1; i < counts.size(); ++i) counts.front().Add(counts[i].summary());
  *summary.mutable_dataset() = *manifest;
  const absl::Status status =
      ForEachAnnotation(folder, OnDamage::kStop, [&](v1::ManeuverAnnotation&& annotation) {
        ++(*summary.mutable_maneuvers())[annotation.maneuver()];
        return true;
      });
  if (!status.ok()) return status;
  return std::move(summary);
}

}  // namespace maneuver::data
