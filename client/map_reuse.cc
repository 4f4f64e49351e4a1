#include "client/map_reuse.h"

#include <algorithm>
#include <functional>
#include <string_view>
#include <utility>

#include "absl/time/clock.h"
#include "client/error_details.h"

namespace maneuver::client {
namespace {

using Features = google::protobuf::RepeatedPtrField<v1::MapFeature>;

std::string_view BytesOf(const google::protobuf::RepeatedField<double>& values) {
  return {reinterpret_cast<const char*>(values.data()),
          static_cast<size_t>(values.size()) * sizeof(double)};
}

size_t Hash(const Features& features) {
  size_t hash = static_cast<size_t>(features.size());
  const auto mix = [&hash](size_t part) { hash = hash * 1'099'511'628'211u ^ part; };
  for (const v1::MapFeature& feature : features) {
    mix(std::hash<int64_t>()(feature.id()));
    mix(std::hash<std::string_view>()(BytesOf(feature.x())));
    mix(std::hash<std::string_view>()(BytesOf(feature.y())));
  }
  return hash;
}

bool EqualIds(const google::protobuf::RepeatedField<int64_t>& a,
              const google::protobuf::RepeatedField<int64_t>& b) {
  return std::ranges::equal(a, b);
}

bool Equal(const Features& a, const Features& b) {
  return std::ranges::equal(a, b, [](const v1::MapFeature& one, const v1::MapFeature& other) {
    return one.id() == other.id() && one.type() == other.type() &&
           one.speed_limit() == other.speed_limit() && BytesOf(one.x()) == BytesOf(other.x()) &&
           BytesOf(one.y()) == BytesOf(other.y()) &&
           EqualIds(one.successor_ids(), other.successor_ids()) &&
           EqualIds(one.left_neighbor_ids(), other.left_neighbor_ids()) &&
           EqualIds(one.right_neighbor_ids(), other.right_neighbor_ids());
  });
}

// Once no map was missing for so many calls, every server has them.
constexpr int kCallsToTrust = 64;

bool IsNotRegistered(const absl::Status& status) {
  return absl::IsFailedPrecondition(status) &&
         ErrorDetailsOf(status).reason == "MAP_NOT_REGISTERED";
}

// Returns whether registering failed because of the map or the server. The map then travels with
// each request.
bool CannotBeHeld(const absl::Status& status) {
  return absl::IsInvalidArgument(status) || absl::IsUnimplemented(status) ||
         ErrorDetailsOf(status).reason == "MAP_TOO_LARGE";
}

CallOptions Until(absl::Time deadline, CallOptions call) {
  call.timeout = deadline - absl::Now();
  return call;
}

}  // namespace

MapReuse::MapReuse(Client& client, size_t max_maps) : client_(client), max_maps_(max_maps) {}

void MapReuse::Forget() {
  const MutexLock lock(mutex_);
  known_.clear();
}

void MapReuse::Note(bool was_missing) {
  const MutexLock lock(mutex_);
  // The first time it was lost by a server that was started again.
  if (was_missing) spreads_ = found_ < kCallsToTrust;
  found_ = was_missing ? 0 : std::min(found_ + 1, kCallsToTrust);
  if (found_ == kCallsToTrust) spreads_ = false;
}

absl::StatusOr<std::string> MapReuse::IdOf(std::shared_ptr<const Features>* features,
                                           absl::Time deadline, const CallOptions& call) {
  const size_t hash = Hash(**features);
  int times = 1;
  {
    const MutexLock lock(mutex_);
    const auto known = std::ranges::find_if(known_, [&](const KnownMap& map) {
      return map.hash == hash && Equal(*map.features, **features);
    });
    // By chance: a balancer that takes turns would always pass over the same server.
    const bool spreads = spreads_ && std::bernoulli_distribution(0.5)(random_);
    if (known != known_.end() && spreads) {
      known_.erase(known);
    } else if (known != known_.end()) {
      known_.splice(known_.begin(), known_, known);
      *features = known->features;
      return known->map_id;
    } else if (spreads) {
      times = 2;
    }
  }
  v1::RegisterMapRequest request;
  *request.mutable_map_features() = **features;
  auto registered = client_.RegisterMap(request, Until(deadline, call));
  if (times == 2 && registered.ok()) {
    registered = client_.RegisterMap(request, Until(deadline, call));
  }
  if (CannotBeHeld(registered.status())) return std::string();
  if (!registered.ok()) return registered.status();
  const MutexLock lock(mutex_);
  known_.push_front({hash, *features, registered->map_id()});
  if (known_.size() > max_maps_) known_.pop_back();
  return registered->map_id();
}

absl::StatusOr<std::vector<MapReuse::Aside>> MapReuse::SetAside(Scenarios* scenarios,
                                                                absl::Time deadline,
                                                                const CallOptions& call) {
  std::vector<Aside> aside;
  for (int i = 0; i < scenarios->size(); ++i) {
    v1::Scenario& scenario = (*scenarios)[i];
    // A scenario with both is invalid; the server refuses it.
    if (scenario.map_features().empty() || !scenario.map_id().empty()) continue;
    std::shared_ptr<const Features> features =
        std::make_shared<const Features>(std::move(*scenario.mutable_map_features()));
    auto id = IdOf(&features, deadline, call);
    if (!id.ok() || id->empty()) {
      *scenario.mutable_map_features() = *features;
      if (!id.ok()) return id.status();
      continue;
    }
    scenario.clear_map_features();
    scenario.set_map_id(*std::move(id));
    aside.push_back({i, std::move(features)});
  }
  return aside;
}

absl::Status MapReuse::NameMaps(Scenarios* scenarios, const CallOptions& call) {
  const absl::Duration timeout = call.timeout.value_or(client_.options().deadlines.prediction);
  return SetAside(scenarios, absl::Now() + timeout, call).status();
}

template <typename Request, typename Response>
absl::StatusOr<Response> MapReuse::Call(
    absl::StatusOr<Response> (Client::*method)(const Request&, const CallOptions&), Request request,
    const CallOptions& call) {
  const absl::Time deadline =
      absl::Now() + call.timeout.value_or(client_.options().deadlines.prediction);
  const auto restore = [&request](const std::vector<Aside>& maps) {
    for (const Aside& map : maps) {
      v1::Scenario* scenario = request.mutable_scenarios(map.scenario);
      scenario->clear_map_id();
      *scenario->mutable_map_features() = *map.features;
    }
  };
  // The second attempt registers every map again.
  for (int attempt = 0; attempt < 2; ++attempt) {
    const auto aside = SetAside(request.mutable_scenarios(), deadline, call);
    if (!aside.ok()) return aside.status();
    auto response = (client_.*method)(request, Until(deadline, call));
    const bool is_missing = !aside->empty() && IsNotRegistered(response.status());
    if (!aside->empty()) Note(is_missing);
    if (!is_missing) return response;
    Forget();
    restore(*aside);
  }
  // The server has no room for all maps at once, so the request carries them.
  return (client_.*method)(request, Until(deadline, call));
}

absl::StatusOr<v1::PredictActionProbabilitiesResponse> MapReuse::PredictActionProbabilities(
    v1::PredictActionProbabilitiesRequest request, const CallOptions& call) {
  return Call(&Client::PredictActionProbabilities, std::move(request), call);
}

absl::StatusOr<v1::PredictActionDistributionsResponse> MapReuse::PredictActionDistributions(
    v1::PredictActionDistributionsRequest request, const CallOptions& call) {
  return Call(&Client::PredictActionDistributions, std::move(request), call);
}

absl::StatusOr<v1::PredictResponse> MapReuse::Predict(v1::PredictRequest request,
                                                      const CallOptions& call) {
  return Call(&Client::Predict, std::move(request), call);
}

absl::StatusOr<v1::ClassifyTrajectoriesResponse> MapReuse::ClassifyTrajectories(
    v1::ClassifyTrajectoriesRequest request, const CallOptions& call) {
  return Call(&Client::ClassifyTrajectories, std::move(request), call);
}

}  // namespace maneuver::client
