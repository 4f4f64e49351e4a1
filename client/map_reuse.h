// Sends each road once, to planners' servers that see the same one ten times a second.
//
//   maneuver::client::MapReuse maps(*client);
//   while (driving) auto answer = maps.Predict(request);  // as client->Predict(request)
//
// A scenario's map_features are registered with the server when they are seen for the first time;
// from then on requests name the map by its id, which is twenty times smaller on real scenes. When
// the server does not hold a map any more it is registered again, and the request repeated. A map
// that cannot be registered is sent along as if MapReuse were not there.

#ifndef MANEUVER_CLIENT_MAP_REUSE_H_
#define MANEUVER_CLIENT_MAP_REUSE_H_

#include <cstddef>
#include <list>
#include <memory>
#include <mutex>
#include <vector>

#include "client/client.h"

namespace maneuver::client {

// Thread-safe. The client has to outlive it.
class MapReuse {
 public:
  // Remembers the `max_maps` maps that were used last, with their features.
  explicit MapReuse(Client& client, size_t max_maps = 16);

  // As those of Client. CallOptions::timeout is for all that is sent for the request.
  absl::StatusOr<v1::PredictActionProbabilitiesResponse> PredictActionProbabilities(
      v1::PredictActionProbabilitiesRequest request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictActionDistributionsResponse> PredictActionDistributions(
      v1::PredictActionDistributionsRequest request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictResponse> Predict(v1::PredictRequest request,
                                              const CallOptions& call = {});
  absl::StatusOr<v1::ClassifyTrajectoriesResponse> ClassifyTrajectories(
      v1::ClassifyTrajectoriesRequest request, const CallOptions& call = {});

  // For a stream: puts map ids in the place of maps, and registers those that are new. When an
  // answer's error has the reason MAP_NOT_REGISTERED: Forget, and send the scenarios anew.
  // An error only if the server cannot be asked.
  using Scenarios = google::protobuf::RepeatedPtrField<v1::Scenario>;
  absl::Status NameMaps(Scenarios* scenarios, const CallOptions& call = {});
  // Every map is registered again before it is named the next time.
  void Forget();

 private:
  using Features = google::protobuf::RepeatedPtrField<v1::MapFeature>;

  struct KnownMap {
    size_t hash = 0;
    std::shared_ptr<const Features> features;
    std::string map_id;
  };
  // A scenario's map, set aside while its id stands for it.
  struct Aside {
    int scenario = 0;
    std::shared_ptr<const Features> features;
  };

  absl::StatusOr<std::vector<Aside>> SetAside(Scenarios* scenarios, absl::Time deadline,
                                              const CallOptions& call);
  // The id of a map; empty if it cannot be registered. Where an equal map is known, *features
  // becomes that one.
  absl::StatusOr<std::string> IdOf(std::shared_ptr<const Features>* features, absl::Time deadline,
                                   const CallOptions& call);
  template <typename Request, typename Response>
  absl::StatusOr<Response> Call(absl::StatusOr<Response> (Client::*method)(const Request&,
                                                                           const CallOptions&),
                                Request request, const CallOptions& call);

  Client& client_;
  const size_t max_maps_;
  std::mutex mutex_;           // guards what follows
  std::list<KnownMap> known_;  // the one used last first
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_MAP_REUSE_H_
