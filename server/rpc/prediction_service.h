#ifndef MANEUVER_SERVER_RPC_PREDICTION_SERVICE_H_
#define MANEUVER_SERVER_RPC_PREDICTION_SERVICE_H_

#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "server/rpc/arena_messages.h"
#include "server/rpc/predict_stream.h"
#include "server/rpc/prediction_run.h"

namespace maneuver::rpc {

// StreamPredict reads and writes bytes, so that it can look at a request before parsing it.
using PredictionMethods = v1::PredictionService::WithCallbackMethod_PredictActionProbabilities<
    v1::PredictionService::WithCallbackMethod_PredictActionDistributions<
        v1::PredictionService::WithCallbackMethod_Predict<
            v1::PredictionService::WithCallbackMethod_ClassifyTrajectories<
                v1::PredictionService::WithRawCallbackMethod_StreamPredict<
                    v1::PredictionService::WithCallbackMethod_RegisterMap<
                        v1::PredictionService::Service>>>>>>;

// Predicts, classifies, and registers maps.
class PredictionService final : public PredictionMethods {
 public:
  // `context` must outlive the service. The .cc defines the constructor and the destructor, for the
  // reason that admin_service.h gives.
  explicit PredictionService(PredictionContext& context);
  ~PredictionService() override;

  grpc::ServerUnaryReactor* PredictActionProbabilities(
      grpc::CallbackServerContext* rpc, const v1::PredictActionProbabilitiesRequest* request,
      v1::PredictActionProbabilitiesResponse* response) override;
  grpc::ServerUnaryReactor* PredictActionDistributions(
      grpc::CallbackServerContext* rpc, const v1::PredictActionDistributionsRequest* request,
      v1::PredictActionDistributionsResponse* response) override;
  grpc::ServerUnaryReactor* Predict(grpc::CallbackServerContext* rpc,
                                    const v1::PredictRequest* request,
                                    v1::PredictResponse* response) override;
  grpc::ServerUnaryReactor* ClassifyTrajectories(
      grpc::CallbackServerContext* rpc, const v1::ClassifyTrajectoriesRequest* request,
      v1::ClassifyTrajectoriesResponse* response) override;
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* StreamPredict(
      grpc::CallbackServerContext* rpc) override;
  grpc::ServerUnaryReactor* RegisterMap(grpc::CallbackServerContext* rpc,
                                        const v1::RegisterMapRequest* request,
                                        v1::RegisterMapResponse* response) override;

  // Ends the streams once their requests are answered. Otherwise open streams would delay the
  // shutdown as long as their callers stay. Call it just before the server refuses new calls.
  void Drain() { streams_.Drain(); }

 private:
  PredictionContext& context_;
  ArenaMessages<v1::PredictActionProbabilitiesRequest, v1::PredictActionProbabilitiesResponse>
      probabilities_messages_;
  ArenaMessages<v1::PredictActionDistributionsRequest, v1::PredictActionDistributionsResponse>
      distributions_messages_;
  ArenaMessages<v1::PredictRequest, v1::PredictResponse> predict_messages_;
  ArenaMessages<v1::ClassifyTrajectoriesRequest, v1::ClassifyTrajectoriesResponse>
      classify_messages_;
  OpenStreams streams_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_SERVICE_H_
