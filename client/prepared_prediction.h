// Predictions that do not block the caller's thread, and cost little to make.

#ifndef MANEUVER_CLIENT_PREPARED_PREDICTION_H_
#define MANEUVER_CLIENT_PREPARED_PREDICTION_H_

#include <cstddef>
#include <functional>
#include <memory>

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::client {

enum class PredictionMethod {
  kPredict,
  kPredictActionProbabilities,  // takes no query
  kPredictActionDistributions,
};

// A request, serialised once, to be sent as often as one likes: see Client::StartPrediction. Cheap
// to copy; copies may be used from any thread.
class PreparedPrediction {
 public:
  explicit PreparedPrediction(const v1::PredictRequest& request,
                              PredictionMethod method = PredictionMethod::kPredict);

  // Size of the message on the wire.
  size_t bytes() const;

 private:
  friend class Client;
  friend class PendingPredictions;
  struct Message;
  std::shared_ptr<const Message> message_;
};

// Told how a started prediction ended. The answers of all three methods are PredictResponses on the
// wire; what a method does not say is not set.
using OnPrediction = std::function<void(absl::StatusOr<v1::PredictResponse> answer)>;

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_PREPARED_PREDICTION_H_
