// A peer for the client's tests: the real generated services in this process, on a free port, which
// answer as each test says.

#ifndef MANEUVER_TESTS_UNIT_CLIENT_TEST_SERVER_H_
#define MANEUVER_TESTS_UNIT_CLIENT_TEST_SERVER_H_

#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"

namespace maneuver::client {

class TestServer final {
 public:
  // Sees each call before it is answered; may be empty.
  std::function<void(const grpc::ServerContext&)> on_call;
  // What the services do. Called on gRPC's threads.
  std::function<grpc::Status(grpc::ServerContext*, const v1::PredictRequest&, v1::PredictResponse*)>
      on_predict;
  std::function<grpc::Status(const v1::ClassifyTrajectoriesRequest&,
                             v1::ClassifyTrajectoriesResponse*)>
      on_classify;
  std::function<grpc::Status(const v1::RegisterMapRequest&, v1::RegisterMapResponse*)>
      on_register_map;
  std::function<grpc::Status(const v1::ReportOutcomesRequest&, v1::ReportOutcomesResponse*)>
      on_report_outcomes;
  std::function<grpc::Status(
      grpc::ServerReaderWriter<v1::StreamOutcomesResponse, v1::StreamOutcomesRequest>*)>
      on_stream_outcomes;
  std::function<grpc::Status(const v1::TrainRequest&, v1::Job*)> on_train;
  // Empty: on_start_job.
  std::function<grpc::Status(const v1::EvaluateRequest&, v1::Job*)> on_evaluate;
  // Fills in a job of another kind than training that is started, or resumed.
  std::function<void(v1::Job*)> on_start_job;
  std::function<grpc::Status(const v1::DeleteJobRequest&)> on_delete_job;
  std::function<grpc::Status(const v1::WatchJobRequest&, grpc::ServerWriter<v1::WatchJobResponse>*)>
      on_watch;
  std::function<grpc::Status(grpc::ServerReader<v1::UploadDatasetRequest>*, v1::Dataset*)>
      on_upload;
  // Empty: UNIMPLEMENTED, as from a server of an earlier release.
  std::function<grpc::Status(const v1::QueryUploadRequest&, v1::QueryUploadResponse*)>
      on_query_upload;
  std::function<grpc::Status(
      grpc::ServerReaderWriter<v1::StreamPredictResponse, v1::StreamPredictRequest>*)>
      on_stream;

  // `port` 0: any free one.
  //   health: serves grpc.health.v1, where PredictionService is not ready until SetReady.
  explicit TestServer(int port = 0, bool health = false)
      : predictions_(this), outcomes_(this), training_(this), datasets_(this) {
    grpc::EnableDefaultHealthCheckService(health);
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:" + std::to_string(port), grpc::InsecureServerCredentials(),
                             &port_);
    builder.RegisterService(&predictions_);
    builder.RegisterService(&outcomes_);
    builder.RegisterService(&training_);
    builder.RegisterService(&datasets_);
    server_ = builder.BuildAndStart();
    grpc::EnableDefaultHealthCheckService(false);
    if (health) SetReady(false);
  }
  ~TestServer() {
    if (server_ != nullptr) server_->Shutdown(std::chrono::system_clock::now());
  }

  void SetReady(bool ready) {
    server_->GetHealthCheckService()->SetServingStatus("maneuver.v1.PredictionService", ready);
  }

  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

 private:
  void See(const grpc::ServerContext& context) const {
    if (on_call) on_call(context);
  }

  class Predictions final : public v1::PredictionService::Service {
   public:
    explicit Predictions(TestServer* owner) : owner_(owner) {}
    grpc::Status Predict(grpc::ServerContext* context, const v1::PredictRequest* request,
                         v1::PredictResponse* response) override {
      owner_->See(*context);
      return owner_->on_predict(context, *request, response);
    }
    grpc::Status ClassifyTrajectories(grpc::ServerContext* context,
                                      const v1::ClassifyTrajectoriesRequest* request,
                                      v1::ClassifyTrajectoriesResponse* response) override {
      owner_->See(*context);
      return owner_->on_classify(*request, response);
    }
    grpc::Status RegisterMap(grpc::ServerContext* context, const v1::RegisterMapRequest* request,
                             v1::RegisterMapResponse* response) override {
      owner_->See(*context);
      return owner_->on_register_map(*request, response);
    }
    grpc::Status StreamPredict(
        grpc::ServerContext* context,
        grpc::ServerReaderWriter<v1::StreamPredictResponse, v1::StreamPredictRequest>* stream)
        override {
      owner_->See(*context);
      return owner_->on_stream(stream);
    }

   private:
    TestServer* const owner_;
  };
  class Outcomes final : public v1::OutcomeService::Service {
   public:
    explicit Outcomes(TestServer* owner) : owner_(owner) {}
    grpc::Status ReportOutcomes(grpc::ServerContext* context,
                                const v1::ReportOutcomesRequest* request,
                                v1::ReportOutcomesResponse* response) override {
      owner_->See(*context);
      return owner_->on_report_outcomes(*request, response);
    }
    grpc::Status StreamOutcomes(
        grpc::ServerContext* context,
        grpc::ServerReaderWriter<v1::StreamOutcomesResponse, v1::StreamOutcomesRequest>* stream)
        override {
      owner_->See(*context);
      return owner_->on_stream_outcomes(stream);
    }

   private:
    TestServer* const owner_;
  };
  class Training final : public v1::TrainingService::Service {
   public:
    explicit Training(TestServer* owner) : owner_(owner) {}
    grpc::Status Train(grpc::ServerContext* context, const v1::TrainRequest* request,
                       v1::Job* job) override {
      owner_->See(*context);
      return owner_->on_train(*request, job);
    }
    grpc::Status Evaluate(grpc::ServerContext* context, const v1::EvaluateRequest* request,
                          v1::Job* job) override {
      if (!owner_->on_evaluate) return Start(*context, job);
      owner_->See(*context);
      return owner_->on_evaluate(*request, job);
    }
    grpc::Status CrossValidate(grpc::ServerContext* context, const v1::CrossValidateRequest*,
                               v1::Job* job) override {
      return Start(*context, job);
    }
    grpc::Status Recalibrate(grpc::ServerContext* context, const v1::RecalibrateRequest*,
                             v1::Job* job) override {
      return Start(*context, job);
    }
    grpc::Status Tag(grpc::ServerContext* context, const v1::TagRequest*, v1::Job* job) override {
      return Start(*context, job);
    }
    grpc::Status ResumeJob(grpc::ServerContext* context, const v1::ResumeJobRequest*,
                           v1::Job* job) override {
      return Start(*context, job);
    }
    grpc::Status DeleteJob(grpc::ServerContext* context, const v1::DeleteJobRequest* request,
                           google::protobuf::Empty*) override {
      owner_->See(*context);
      return owner_->on_delete_job(*request);
    }
    grpc::Status WatchJob(grpc::ServerContext* context, const v1::WatchJobRequest* request,
                          grpc::ServerWriter<v1::WatchJobResponse>* writer) override {
      owner_->See(*context);
      return owner_->on_watch(*request, writer);
    }

   private:
    grpc::Status Start(const grpc::ServerContext& context, v1::Job* job) {
      owner_->See(context);
      owner_->on_start_job(job);
      return grpc::Status::OK;
    }

    TestServer* const owner_;
  };
  class Datasets final : public v1::DatasetService::Service {
   public:
    explicit Datasets(TestServer* owner) : owner_(owner) {}
    grpc::Status UploadDataset(grpc::ServerContext* context,
                               grpc::ServerReader<v1::UploadDatasetRequest>* reader,
                               v1::Dataset* dataset) override {
      owner_->See(*context);
      return owner_->on_upload(reader, dataset);
    }
    grpc::Status QueryUpload(grpc::ServerContext* context, const v1::QueryUploadRequest* request,
                             v1::QueryUploadResponse* response) override {
      owner_->See(*context);
      if (!owner_->on_query_upload) return {grpc::StatusCode::UNIMPLEMENTED, "no such method"};
      return owner_->on_query_upload(*request, response);
    }
    grpc::Status DescribeDataset(grpc::ServerContext* context, const v1::DescribeDatasetRequest*,
                                 v1::DatasetSummary*) override {
      owner_->See(*context);
      return grpc::Status::OK;
    }

   private:
    TestServer* const owner_;
  };

  Predictions predictions_;
  Outcomes outcomes_;
  Training training_;
  Datasets datasets_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace maneuver::client

#endif  // MANEUVER_TESTS_UNIT_CLIENT_TEST_SERVER_H_
