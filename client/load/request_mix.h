// The requests of a load run, made from scenes before the load begins.

#ifndef MANEUVER_CLIENT_LOAD_REQUEST_MIX_H_
#define MANEUVER_CLIENT_LOAD_REQUEST_MIX_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::load {

struct RequestMix {
  // Targets of each request, drawn uniformly.
  int least_targets = 1;
  int most_targets = 1;
  int requests = 64;  // number of different requests
  uint64_t seed = 1;
};

// Makes requests with random targets of random scenes: adds scenes until a request has enough
// targets. Removes what lies after the prediction time.
//   scenes: at least one; each with at least one target.
//   pattern: model and query of every request.
std::vector<v1::PredictRequest> MakeRequests(const std::vector<v1::Scenario>& scenes,
                                             const v1::PredictRequest& pattern,
                                             const RequestMix& mix);

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_REQUEST_MIX_H_
