// Sends each map only once, for planners that see the same road ten times a second.
//
//   maneuver::client::MapReuse maps(*client);
//   while (driving) auto answer = maps.Predict(request);  // like client->Predict(request)
//
// Registers a scenario's map_features with the server when it first sees them. Later requests name
// the map by its id, which makes them twenty times smaller on real scenes. When the server no
// longer has a map, it is registered again and the request is repeated. A map that the server
// refuses, or cannot hold, travels with the request, as without MapReuse.
//
// Behind a balancer each call may reach another server, and each server has the maps that were
// registered with it. While servers without a map keep turning up, it is registered again and again
// until all have it. A request is answered meanwhile, too; it only takes more calls.

#ifndef MANEUVER_CLIENT_MAP_REUSE_H_
#define MANEUVER_CLIENT_MAP_REUSE_H_

#include <cstddef>
#include <list>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "client/client.h"
#include "locks/mutex.h"

namespace maneuver::client {

// Thread-safe. The client must outlive it.
class MapReuse {
 public:
  // Remembers the `max_maps` most recently used maps, with their features.
  explicit MapReuse(Client& client, size_t max_maps = 16);

  // Behave like the calls of Client. CallOptions::timeout covers everything that is sent for the
  // request, including the registration of maps.
  absl::StatusOr<v1::PredictActionProbabilitiesResponse> PredictActionProbabilities(
      v1::PredictActionProbabilitiesRequest request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictActionDistributionsResponse> PredictActionDistributions(
      v1::PredictActionDistributionsRequest request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictResponse> Predict(v1::PredictRequest request,
                                              const CallOptions& call = {});
  absl::StatusOr<v1::ClassifyTrajectoriesResponse> ClassifyTrajectories(
      v1::ClassifyTrajectoriesRequest request, const CallOptions& call = {});

  // For a stream: replaces maps by map ids and registers those that are new. When an answer's error
  // has the reason MAP_NOT_REGISTERED, call Forget and send the scenarios again. A map that the
  // server refuses or cannot hold stays in its scenario; other errors of registering are returned.
  using Scenarios = google::protobuf::RepeatedPtrField<v1::Scenario>;
  absl::Status NameMaps(Scenarios* scenarios, const CallOptions& call = {});
  // Registers every map again before it is named the next time.
  void Forget();

 private:
  using Features = google::protobuf::RepeatedPtrField<v1::MapFeature>;

  struct KnownMap {
    size_t hash = 0;
    std::shared_ptr<const Features> features;
    std::string map_id;
  };
  // A scenario's map, set aside while its id replaces it.
  struct Aside {
    int scenario = 0;
    std::shared_ptr<const Features> features;
  };

  absl::StatusOr<std::vector<Aside>> SetAside(Scenarios* scenarios, absl::Time deadline,
                                              const CallOptions& call);
  // Returns the id of a map; empty if it cannot be registered. If an equal map is known, *features
  // becomes that one.
  absl::StatusOr<std::string> IdOf(std::shared_ptr<const Features>* features, absl::Time deadline,
                                   const CallOptions& call);
  template <typename Request, typename Response>
  absl::StatusOr<Response> Call(absl::StatusOr<Response> (Client::*method)(const Request&,
                                                                           const CallOptions&),
                                Request request, const CallOptions& call);

  // Learns from a call whether servers without a map keep turning up.
  void Note(bool was_missing);

  Client& client_;
  const size_t max_maps_;
  Mutex mutex_;
  // Calls since a map was missing; Note counts up to kCallsToTrust. At first none has been missing.
  int found_ ABSL_GUARDED_BY(mutex_) = 1'000;
  bool spreads_ ABSL_GUARDED_BY(mutex_) = false;  // whether maps go missing again and again
  std::minstd_rand random_ ABSL_GUARDED_BY(mutex_);
  std::list<KnownMap> known_ ABSL_GUARDED_BY(mutex_);  // most recently used first
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_MAP_REUSE_H_
