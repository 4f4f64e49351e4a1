// maneuver job, against a server that has the jobs of each test.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "tests/unit/client/run_maneuver.h"

namespace maneuver::cli::job_command_test {
namespace {

using testing::AllOf;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

class Training final : public v1::TrainingService::Service {
 public:
  v1::ListJobsResponse jobs;

 private:
  grpc::Status ListJobs(grpc::ServerContext*, const v1::ListJobsRequest*,
                        v1::ListJobsResponse* response) override {
    *response = jobs;
    return grpc::Status::OK;
  }
};

class JobListTest : public testing::Test {
 protected:
  JobListTest() {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(&training_);
    server_ = builder.BuildAndStart();
  }
  ~JobListTest() override { server_->Shutdown(std::chrono::system_clock::now()); }

  void AddSound(const std::string& name) {
    v1::Job* const job = training_.jobs.add_jobs();
    job->set_name(name);
    job->mutable_train()->set_model("models/town");
    job->set_state(v1::JOB_STATE_SUCCEEDED);
    job->mutable_create_time()->set_seconds(1'800'000'000);
  }
  void AddDamaged(const std::string& name) {
    v1::Job* const job = training_.jobs.add_jobs();
    job->set_name(name);
    job->mutable_error()->set_code(15);
    job->mutable_error()->set_message("the job store holds a job that is damaged: " + name);
  }

  Result List(std::vector<std::string> arguments) {
    std::vector<std::string> all = {"--server", "127.0.0.1:" + std::to_string(port_)};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return Maneuver(all);
  }

  Training training_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

TEST_F(JobListTest, ShowsADamagedJobAsDamaged) {
  AddSound("jobs/new");
  AddDamaged("jobs/broken");
  AddDamaged("");
  AddDamaged("jobs/\x1b[2J");
  AddSound("jobs/old");
  const Result table = List({"job", "list"});
  EXPECT_EQ(table.status, kOk) << table.err;
  EXPECT_THAT(
      table.out,
      AllOf(ContainsRegex("new +train +town +succeeded"), ContainsRegex("broken +- +- +damaged"),
            ContainsRegex("\\? +- +- +damaged"), ContainsRegex("old +train +town +succeeded")));
  EXPECT_THAT(table.err, HasSubstr("damaged: the job store holds a job that is damaged: jobs/bro"));
  EXPECT_THAT(table.err, Not(HasSubstr("\x1b")));

  const Result json = List({"job", "list", "--output", "json"});
  EXPECT_EQ(json.status, kOk) << json.err;
  EXPECT_THAT(json.out, AllOf(HasSubstr("jobs/broken"), HasSubstr("that is damaged: jobs/broken"),
                              HasSubstr("jobs/old")));
}

TEST_F(JobListTest, CountsADamagedJobToNoOtherStateAndNoTime) {
  AddSound("jobs/new");
  AddDamaged("jobs/broken");
  AddSound("jobs/old");
  const Result damaged = List({"job", "list", "--state", "damaged"});
  EXPECT_THAT(damaged.out, AllOf(HasSubstr("broken"), Not(HasSubstr("old"))));
  const Result succeeded = List({"job", "list", "--state", "succeeded"});
  EXPECT_THAT(succeeded.out, AllOf(HasSubstr("old"), Not(HasSubstr("broken"))));
  // It does not end the list either.
  const Result since = List({"job", "list", "--since", "2027-01-01"});
  EXPECT_THAT(since.out, AllOf(HasSubstr("new"), HasSubstr("broken"), HasSubstr("old")));
}

}  // namespace
}  // namespace maneuver::cli::job_command_test
