// Predictions that do not block the caller's thread and cost little to send.

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

// A request that is serialised once and can be sent any number of times: see
// Client::StartPrediction. Cheap to copy; each thread may use its own copy.
class PreparedPrediction {
 public:
  explicit PreparedPrediction(const v1::PredictRequest& request,
                              PredictionMethod method = PredictionMethod::kPredict);

  // Returns the size of the message on the wire.
  size_t bytes() const;

 private:
  friend class Client;
  friend class PendingPredictions;
  struct Message;
  std::shared_ptr<const Message> message_;
};

// Called with the result of a started prediction. On the wire, the answers of all three methods are
// PredictResponses; fields that a method does not answer are not set.
using OnPrediction = std::function<void(absl::StatusOr<v1::PredictResponse> answer)>;

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_PREPARED_PREDICTION_H_
