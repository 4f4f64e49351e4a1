// What is asked: requests made of scenes, once, before the load begins.

#ifndef MANEUVER_CLIENT_LOAD_REQUEST_MIX_H_
#define MANEUVER_CLIENT_LOAD_REQUEST_MIX_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::load {

struct RequestMix {
  // In each request; drawn uniformly.
  int least_targets = 1;
  int most_targets = 1;
  int requests = 64;  // different ones
  uint64_t seed = 1;
};

// Requests, each with random targets of random scenes: of as few scenes as have enough. What lies
// after the prediction time is left out.
//   scenes: each with at least one target; at least one.
//   pattern: model and query of each.
std::vector<v1::PredictRequest> MakeRequests(const std::vector<v1::Scenario>& scenes,
                                             const v1::PredictRequest& pattern,
                                             const RequestMix& mix);

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_REQUEST_MIX_H_
