#include "server/serving/shadow.h"

#include <algorithm>
#include <bit>
#include <exception>
#include <utility>

#include "absl/strings/str_cat.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/machine/thread_priority.h"
#include "server/errors/error_details.h"
#include "server/monitoring/logging.h"

namespace maneuver::serving {
namespace {

using monitoring::Log;
using monitoring::LogLevel;
using std::chrono::duration;
using std::chrono::nanoseconds;

// After which the thread looks again whether the server has become less busy.
constexpr auto kBetweenLooks = std::chrono::milliseconds(1);
// After which a version that was not compared is released.
constexpr auto kForgets = std::chrono::seconds(10);

// FNV-1a over 8 bytes at a time, then the finalizer of MurmurHash3, so that all bits count.
class RequestHash {
 public:
  void Add(uint64_t value) { state_ = (state_ ^ value) * 0x100000001b3; }
  void Add(double value) { Add(std::bit_cast<uint64_t>(value)); }
  void Add(const std::string& text) {
    for (const char c : text) Add(static_cast<uint64_t>(static_cast<unsigned char>(c)));
    Add(uint64_t{text.size()});
  }

  // Uniform in [0, 1).
  double Fraction() const {
    uint64_t h = state_;
    h = (h ^ (h >> 33)) * 0xff51afd7ed558ccd;
    h = (h ^ (h >> 33)) * 0xc4ceb9fe1a85ec53;
    h ^= h >> 33;
    return static_cast<double>(h >> 11) * 0x1p-53;
  }

 private:
  uint64_t state_ = 0xcbf29ce484222325;
};

monitoring::Counter& ShadowedTargets(monitoring::MetricRegistry& metrics, const char* outcome) {
  return metrics.AddCounter(
      "maneuver_shadow_targets_total",
      "Targets that the candidate was to be asked for as well: compared; dropped because the "
      "server had no room for them; failed because the candidate could not answer.",
      {{"outcome", outcome}});
}

// Half a decade apart.
std::vector<double> MetreBuckets() { return {0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0}; }

monitoring::Histogram& MetreHistogram(monitoring::MetricRegistry& metrics, const char* what,
                                      const char* help, const std::string& model) {
  return metrics.AddHistogram(absl::StrCat("maneuver_shadow_", what, "_distance_meters"), help,
                              MetreBuckets(), {{"model", model}});
}

monitoring::Histogram& EntropyHistogram(monitoring::MetricRegistry& metrics, const char* of,
                                        const std::string& model) {
  return metrics.AddHistogram("maneuver_shadow_entropy_nats",
                              "Entropy of p(y|s): of the version that answered, and of the "
                              "candidate.",
                              {0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0},
                              {{"model", model}, {"of", of}});
}

// The last to go. Not SCHED_IDLE: in a short critical section of the allocator or of Offer that
// could keep others waiting for long.
constexpr int kNicest = 19;

}  // namespace

Shadow::Differences::Differences(monitoring::MetricRegistry& metrics, const std::string& model)
    : expected(MetreHistogram(metrics, "expected_trajectory",
                              "Average distance of the versions' expected trajectories.", model)),
      likeliest(MetreHistogram(
          metrics, "likeliest_trajectory",
          "Average distance of the mean trajectories of the versions' most probable actions.",
          model)),
      energy(MetreHistogram(metrics, "energy",
                            "Energy distance of the versions' mixtures of mean trajectories.",
                            model)),
      divergence(metrics.AddHistogram(
          "maneuver_shadow_divergence_nats",
          "Jensen-Shannon divergence of the versions' p(y|s), over actions that are matched by "
          "what they do; 0 to 0.693.",
          {0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7}, {{"model", model}})),
      answered_entropy(EntropyHistogram(metrics, "answered", model)),
      candidate_entropy(EntropyHistogram(metrics, "candidate", model)) {}

void Shadow::Differences::Observe(const evaluation::AnswerDifference& difference) {
  expected.Observe(difference.expected);
  likeliest.Observe(difference.likeliest);
  energy.Observe(difference.energy);
  if (difference.divergence) divergence.Observe(*difference.divergence);
  answered_entropy.Observe(difference.first_entropy);
  candidate_entropy.Observe(difference.second_entropy);
}

Shadow::Shadow(const ShadowOptions& options, ServingTable& models, std::function<bool()> busy,
               monitoring::MetricRegistry& metrics)
    : options_(options),
      models_(models),
      busy_(std::move(busy)),
      metrics_(metrics),
      compared_(ShadowedTargets(metrics, "compared")),
      dropped_(ShadowedTargets(metrics, "dropped")),
      failed_(ShadowedTargets(metrics, "failed")),
      seconds_(metrics.AddCounter("maneuver_shadow_seconds_total",
                                  "Time for which the shadow's thread was at work.")),
      thread_([this] { Work(); }) {}

Shadow::~Shadow() {
  {
    const MutexLock lock(mutex_);
    stopping_ = true;
  }
  wake_.NotifyAll();
  thread_.join();
}

bool Shadow::Samples(std::span<const Target> targets) const {
  if (options_.fraction >= 1.0) return true;
  RequestHash hash;
  for (const Target& target : targets) {
    hash.Add(target.scenario->scenario_id());
    hash.Add(target.scenario->prediction_time());
    hash.Add(static_cast<uint64_t>(target.id));
    hash.Add(target.X_WT.x());
    hash.Add(target.X_WT.y());
    hash.Add(target.X_WT.heading());
  }
  return hash.Fraction() < options_.fraction;
}

void Shadow::Offer(const PredictionCall& call, std::vector<TargetAnswer> answers,
                   std::shared_ptr<const void> kept) {
  const security::ModelVersionName& answered = call.model->name();
  auto candidate = models_.Find(
      security::ModelAliasName{answered.model, std::string(security::kCandidateAlias)});
  if (errors::ReasonOf(candidate.status()) == "MODEL_ALIAS_NOT_FOUND") return;
  if (!candidate.ok() || *candidate == nullptr) {
    failed_.Increment(static_cast<double>(call.targets.size()));
    return;
  }
  if ((*candidate)->name() == answered) return;

  AnsweredRequest request{.answered = call.model,
                          .candidate = *std::move(candidate),
                          .targets = {},
                          .bytes = call.bytes,
                          .kept = std::move(kept)};
  for (size_t i = 0; i < answers.size(); ++i) {
    if (!answers[i].status.ok()) continue;
    request.targets.push_back({call.targets[i], std::move(answers[i].encoding)});
  }
  const size_t asked = request.targets.size();
  const size_t taken = Push(request);
  if (asked > taken) dropped_.Increment(static_cast<double>(asked - taken));
}

size_t Shadow::Push(AnsweredRequest& request) {
  // The shadow's thread may be preempted while it holds the lock. A caller does not wait for that.
  for (int i = 0; i < options_.max_tries; ++i) {
    if (i > 0) std::this_thread::yield();
    if (!mutex_.TryLock()) continue;
    const size_t taken = PushLocked(request);
    mutex_.Unlock();
    return taken;
  }
  return 0;
}

size_t Shadow::PushLocked(AnsweredRequest& request) {
  if (stopping_ || held_bytes_ + request.bytes > options_.max_bytes) return 0;
  const size_t room = static_cast<size_t>(options_.max_targets) - held_targets_;
  const size_t taken = std::min(room, request.targets.size());
  if (taken == 0) return 0;
  request.targets.erase(request.targets.begin() + static_cast<std::ptrdiff_t>(taken),
                        request.targets.end());
  held_targets_ += taken;
  held_bytes_ += request.bytes;
  waiting_.push_back(std::move(request));
  wake_.NotifyOne();
  return taken;
}

void Shadow::Work() {
  machine::AddNiceness(kNicest);
  MutexLock lock(mutex_);
  while (!stopping_) {
    if (waiting_.empty()) {
      if (comparisons_.empty()) {
        wake_.Wait(mutex_);
      } else if (!wake_.WaitFor(mutex_, kForgets)) {
        lock.Unlock();
        ForgetComparisons();
        lock.Lock();
      }
      continue;
    }
    AnsweredRequest request = std::move(waiting_.front());
    waiting_.pop_front();
    lock.Unlock();
    const size_t targets = request.targets.size();
    const int64_t bytes = request.bytes;
    Compare(request);
    ForgetComparisons();
    // Freed without the lock, and last of all what others can see being freed.
    std::shared_ptr<const void> kept = std::move(request.kept);
    request = {};
    lock.Lock();
    held_targets_ -= targets;
    held_bytes_ -= bytes;
    lock.Unlock();
    kept = nullptr;
    lock.Lock();
  }
}

void Shadow::Compare(AnsweredRequest& request) {
  ShadowComparison* versions = nullptr;
  if (!InTurn([&] { versions = ComparisonOf(request); })) return;
  if (versions == nullptr) {
    failed_.Increment(static_cast<double>(request.targets.size()));
    return;
  }
  const std::string& model = request.answered->name().model;
  Differences& differences = DifferencesOf(model);
  size_t begun = 0;
  try {
    while (begun < request.targets.size()) {
      if (!CompareTarget(*versions, differences, request.targets[begun++])) return;
    }
  } catch (const std::exception& error) {  // dnnl::error, std::bad_alloc
    // Its engines are not used again.
    comparisons_.erase(model);
    failed_.Increment(static_cast<double>(request.targets.size() - begun + 1));
    Log(LogLevel::kError, "shadow failed",
        {{"model_version", request.answered->name().ToString()},
         {"candidate", request.candidate->name().ToString()},
         {"reason", error.what()}});
  }
}

bool Shadow::CompareTarget(ShadowComparison& versions, Differences& differences,
                           const AnsweredTarget& target) {
  absl::Status status;
  if (!InTurn([&] { status = versions.Read(target.target); })) return false;
  if (status.ok() && !InTurn([&] { status = versions.Encode(); })) return false;
  if (status.ok() && !InTurn([&] {
        const auto difference = versions.Compare(target.encoding);
        status = difference.status();
        if (status.ok()) differences.Observe(*difference);
      })) {
    return false;
  }
  (status.ok() ? compared_ : failed_).Increment();
  return true;
}

bool Shadow::InTurn(const std::function<void()>& step) {
  {
    const MutexLock lock(mutex_);
    while (true) {
      if (stopping_) return false;
      if (const TimePoint now = options_.now(); now < rests_until_) {
        wake_.WaitFor(mutex_, rests_until_ - now);
      } else if (busy_()) {
        wake_.WaitFor(mutex_, kBetweenLooks);
      } else {
        break;
      }
    }
  }
  const TimePoint begin = options_.now();
  step();
  const TimePoint end = options_.now();
  seconds_.Increment(duration<double>(end - begin).count());
  rests_until_ = end + std::chrono::duration_cast<nanoseconds>((1.0 / options_.max_share - 1.0) *
                                                               (end - begin));
  return true;
}

ShadowComparison* Shadow::ComparisonOf(const AnsweredRequest& request) {
  const security::ModelVersionName& answered = request.answered->name();
  Comparison& comparison = comparisons_[answered.model];
  comparison.last_used = options_.now();
  if (comparison.answered == request.answered && comparison.candidate == request.candidate) {
    return comparison.versions.get();
  }
  comparison.answered = request.answered;
  comparison.candidate = request.candidate;
  comparison.versions = nullptr;
  auto made = ShadowComparison::Make(request.answered, request.candidate);
  if (!made.ok()) {
    Log(LogLevel::kWarning, "shadow cannot compare",
        {{"model_version", answered.ToString()},
         {"candidate", request.candidate->name().ToString()},
         {"reason", std::string(made.status().message())}});
    return nullptr;
  }
  comparison.versions = *std::move(made);
  Log(LogLevel::kInfo, "shadow compares",
      {{"model_version", answered.ToString()},
       {"candidate", request.candidate->name().ToString()},
       {"agreeing_actions", comparison.versions->comparison().agreeing_pairs()}});
  return comparison.versions.get();
}

void Shadow::ForgetComparisons() {
  const TimePoint oldest = options_.now() - kForgets;
  std::erase_if(comparisons_,
                [oldest](const auto& each) { return each.second.last_used <= oldest; });
}

Shadow::Differences& Shadow::DifferencesOf(const std::string& model) {
  if (const auto found = differences_.find(model); found != differences_.end()) {
    return found->second;
  }
  // No model can have this name.
  const bool room = differences_.size() < static_cast<size_t>(options_.max_models);
  const std::string label = room ? model : "_others";
  return differences_.try_emplace(label, metrics_, label).first->second;
}

}  // namespace maneuver::serving
