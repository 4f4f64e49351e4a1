// Checks on a real server who may call what: every method that its reflection lists, with every
// identity.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <string>
#include <vector>

#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/status.pb.h"
#include "tests/integration/raw_call.h"
#include "tests/integration/secured_server.h"

namespace maneuver::integration::access_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// The roles are repeated here on purpose, so that a new method's role is decided twice.
// "" means anyone.
const std::map<std::string, std::string> kExpectedRoles = {
    {"/grpc.health.v1.Health/Check", ""},
    {"/grpc.health.v1.Health/Watch", ""},
    {"/grpc.reflection.v1.ServerReflection/ServerReflectionInfo", ""},
    {"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", ""},
    {"/maneuver.v1.PredictionService/PredictActionProbabilities", "predict"},
    {"/maneuver.v1.PredictionService/PredictActionDistributions", "predict"},
    {"/maneuver.v1.PredictionService/Predict", "predict"},
    {"/maneuver.v1.PredictionService/ClassifyTrajectories", "predict"},
    {"/maneuver.v1.PredictionService/RegisterMap", "predict"},
    {"/maneuver.v1.PredictionService/StreamPredict", "predict"},
    {"/maneuver.v1.OutcomeService/ReportOutcomes", "predict"},
    {"/maneuver.v1.OutcomeService/StreamOutcomes", "predict"},
    {"/maneuver.v1.OutcomeService/CollectOutcomes", "train"},
    {"/maneuver.v1.ModelService/ListModelVersions", "predict"},
    {"/maneuver.v1.ModelService/GetModelVersion", "predict"},
    {"/maneuver.v1.ModelService/GetActionSet", "predict"},
    {"/maneuver.v1.ModelService/ListEvaluationReports", "predict"},
    {"/maneuver.v1.ModelService/GetEvaluationReport", "predict"},
    {"/maneuver.v1.ModelService/LabelAction", "train"},
    {"/maneuver.v1.ModelService/DownloadModelVersion", "train"},
    {"/maneuver.v1.ModelService/UploadModelVersion", "admin"},
    {"/maneuver.v1.ModelService/QueryModelUpload", "admin"},
    {"/maneuver.v1.ModelService/SetModelAlias", "admin"},
    {"/maneuver.v1.ModelService/DeleteModelAlias", "admin"},
    {"/maneuver.v1.ModelService/DeleteModelVersion", "admin"},
    {"/maneuver.v1.DatasetService/UploadDataset", "train"},
    {"/maneuver.v1.DatasetService/QueryUpload", "train"},
    {"/maneuver.v1.DatasetService/RegisterDataset", "admin"},
    {"/maneuver.v1.DatasetService/ListDatasets", "train"},
    {"/maneuver.v1.DatasetService/GetDataset", "train"},
    {"/maneuver.v1.DatasetService/DescribeDataset", "train"},
    {"/maneuver.v1.DatasetService/ListScenarios", "train"},
    {"/maneuver.v1.DatasetService/GetScenario", "train"},
    {"/maneuver.v1.DatasetService/DeleteDataset", "admin"},
    {"/maneuver.v1.TrainingService/Train", "train"},
    {"/maneuver.v1.TrainingService/Evaluate", "train"},
    {"/maneuver.v1.TrainingService/CrossValidate", "train"},
    {"/maneuver.v1.TrainingService/Recalibrate", "train"},
    {"/maneuver.v1.TrainingService/Tag", "train"},
    {"/maneuver.v1.TrainingService/GetJob", "train"},
    {"/maneuver.v1.TrainingService/ListJobs", "train"},
    {"/maneuver.v1.TrainingService/WatchJob", "train"},
    {"/maneuver.v1.TrainingService/CancelJob", "train"},
    {"/maneuver.v1.TrainingService/ResumeJob", "train"},
    {"/maneuver.v1.TrainingService/DeleteJob", "admin"},
    {"/maneuver.v1.ReplicaService/ListReplicas", "predict"},
    {"/maneuver.v1.TagService/ListTags", "train"},
    {"/maneuver.v1.TagService/GetTags", "train"},
    {"/maneuver.v1.TagService/DownloadTags", "train"},
    {"/maneuver.v1.TagService/DeleteTags", "admin"},
    {"/maneuver.v1.AdminService/GetLogLevel", "admin"},
    {"/maneuver.v1.AdminService/SetLogLevel", "admin"},
};

Headers Bearer(const std::string& token) { return {{"authorization", "Bearer " + token}}; }

RawAnswer CallEmpty(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                    const Headers& headers, const std::string& request = "") {
  return Call(channel, {.method = method,
                        .request = request,
                        .headers = headers,
                        .stop_after_first = method == "/grpc.health.v1.Health/Watch"});
}

// A caller, and the answer that each of its calls must get.
struct Caller {
  std::string what;
  std::shared_ptr<grpc::Channel> channel;
  Headers headers;
  std::vector<std::string> roles;  // of whom is known
  std::string refusal;             // reason of whom is not
};

void ExpectAsTheTableSays(const Caller& caller) {
  for (const auto& [method, role] : kExpectedRoles) {
    SCOPED_TRACE(caller.what + " calls " + method);
    const grpc::Status status = CallEmpty(caller.channel, method, caller.headers).status;
    const bool has_role = std::ranges::find(caller.roles, role) != caller.roles.end();
    if (role.empty() || has_role) {
      EXPECT_NE(status.error_code(), grpc::StatusCode::UNAUTHENTICATED) << status.error_message();
      EXPECT_NE(status.error_code(), grpc::StatusCode::PERMISSION_DENIED) << status.error_message();
      EXPECT_NE(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
      EXPECT_NE(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
      EXPECT_NE(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
    } else if (!caller.refusal.empty()) {
      const bool unknown = caller.refusal != "CERTIFICATE_NOT_LISTED";
      EXPECT_EQ(status.error_code(),
                unknown ? grpc::StatusCode::UNAUTHENTICATED : grpc::StatusCode::PERMISSION_DENIED);
      EXPECT_EQ(Reason(status), caller.refusal) << status.error_message();
    } else {
      EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED);
      EXPECT_EQ(Reason(status), "ROLE_MISSING") << status.error_message();
      EXPECT_THAT(status.error_message(), HasSubstr("the role " + role));
    }
  }
}

class AccessTest : public ::testing::Test {
 protected:
  TestAuthority authority_{"authority"};
  SecuredFolder folder_;
};

TEST_F(AccessTest, EveryMethodListedByReflectionHasARole) {
  const auto server = folder_.Start();
  std::vector<std::string> declared;
  for (const auto& [method, role] : kExpectedRoles) declared.push_back(method);
  std::ranges::sort(declared);
  for (const std::string version : {"v1", "v1alpha"}) {
    std::vector<std::string> methods = MethodsByReflection(Connect(*server, ""), version);
    std::ranges::sort(methods);
    EXPECT_EQ(methods, declared) << version;
  }
}

TEST_F(AccessTest, EveryMethodAnswersEachTokenAsTheRoleTableSays) {
  folder_.Install(authority_.Issue("server", "IP:127.0.0.1"));
  const std::string predict = folder_.CreateToken("planner", "predict");
  const std::string train = folder_.CreateToken("researcher", "train");
  const std::string admin = folder_.CreateToken("operator", "admin");
  const std::string all = folder_.CreateToken("owner", "predict,train,admin");
  const auto server = folder_.StartTls({"--tokens", folder_.file("tokens").string()});
  const auto channel = Connect(*server, authority_.certificate());
  Headers twice = Bearer(all);
  twice.insert({"authorization", "Bearer " + all});
  for (const Caller& caller : std::vector<Caller>{
           {"nobody", channel, {}, {}, "CREDENTIALS_MISSING"},
           {"a wrong token", channel, Bearer("mvr_" + std::string(64, '0')), {}, "TOKEN_UNKNOWN"},
           {"an empty token", channel, Bearer(""), {}, "TOKEN_UNKNOWN"},
           {"half a token", channel, Bearer(all.substr(0, 30)), {}, "TOKEN_UNKNOWN"},
           {"another scheme", channel, {{"authorization", "Basic " + all}}, {}, "TOKEN_UNKNOWN"},
           {"two tokens", channel, twice, {}, "TOKEN_UNKNOWN"},
           {"predict", channel, Bearer(predict), {"predict"}, ""},
           {"train", channel, Bearer(train), {"train"}, ""},
           {"admin", channel, Bearer(admin), {"admin"}, ""},
           {"all roles", channel, Bearer(all), {"predict", "train", "admin"}, ""},
           {"another case", channel, {{"authorization", "bearer " + predict}}, {"predict"}, ""},
       }) {
    ExpectAsTheTableSays(caller);
  }
  // The log has the refusals but no secrets.
  for (const std::string& token : {predict, train, admin, all}) {
    EXPECT_THAT(folder_.log_text(), Not(HasSubstr(token.substr(4))));
  }
  EXPECT_THAT(folder_.log_text(), HasSubstr("call refused"));
}

TEST_F(AccessTest, EveryMethodAnswersEachCertificateAsTheRoleTableSays) {
  TestAuthority clients("clients");
  folder_.Install(authority_.Issue("server", "IP:127.0.0.1"));
  folder_.Write("ca.crt", clients.certificate());
  const std::string token = folder_.CreateToken("operator", "admin");
  std::string lines = "# who may call\nplanner predict san:planner.example\n";
  lines += "fleet predict,train san:spiffe://example/fleet\nada train cn:Ada Lovelace\n";
  lines += "box predict san:10.1.2.3\nsix predict san:2001:DB8::1\n";
  folder_.Write("tokens", lines + folder_.Read("tokens"));
  const auto server = folder_.StartTls({"--tokens", folder_.file("tokens").string(),
                                        "--tls-client-ca", folder_.file("ca.crt").string()});
  const auto with = [&](const std::string& name, const std::string& alternatives) {
    return Connect(*server, authority_.certificate(), clients.Issue(name, alternatives));
  };
  const auto listed = with("x", "DNS:other.example,DNS:planner.example");
  for (const Caller& caller : std::vector<Caller>{
           {"by DNS name", listed, {}, {"predict"}, ""},
           {"by URI", with("x", "URI:spiffe://example/fleet"), {}, {"predict", "train"}, ""},
           {"by address", with("x", "IP:10.1.2.3"), {}, {"predict"}, ""},
           {"by IPv6 address", with("x", "IP:2001:db8::1"), {}, {"predict"}, ""},
           {"by common name", with("Ada Lovelace", ""), {}, {"train"}, ""},
           {"not listed", with("stranger", "DNS:x.example"), {}, {}, "CERTIFICATE_NOT_LISTED"},
           {"a DNS name as common name",
            with("planner.example", ""),
            {},
            {},
            "CERTIFICATE_NOT_LISTED"},
           {"an e-mail name", with("x", "email:planner.example"), {}, {}, "CERTIFICATE_NOT_LISTED"},
           {"an address as DNS name", with("x", "DNS:10.1.2.3"), {}, {}, "CERTIFICATE_NOT_LISTED"},
           {"a URI as DNS name",
            with("x", "DNS:spiffe://example/fleet"),
            {},
            {},
            "CERTIFICATE_NOT_LISTED"},
           {"a DNS name as URI",
            with("x", "URI:planner.example"),
            {},
            {},
            "CERTIFICATE_NOT_LISTED"},
           {"names of other kinds",
            with("x", "otherName:1.2.3.4;UTF8:planner.example,RID:1.2.3.4"),
            {},
            {},
            "CERTIFICATE_NOT_LISTED"},
           {"certificate and token", listed, Bearer(token), {"admin"}, ""},
           {"certificate and wrong token", listed, Bearer("x"), {}, "TOKEN_UNKNOWN"},
       }) {
    ExpectAsTheTableSays(caller);
  }
}

TEST_F(AccessTest, ARefusalDoesNotRevealWhetherAResourceExists) {
  folder_.CreateToken("planner", "predict");
  const auto server = folder_.Start({"--tokens", folder_.file("tokens").string()});
  const auto channel = Connect(*server, "");
  const std::string name =
      std::string("\x0a\x08") + "models/a";  // field 1 of every request by name
  for (const auto& [method, role] : kExpectedRoles) {
    if (role.empty()) continue;
    SCOPED_TRACE(method);
    const grpc::Status first = CallEmpty(channel, method, {}).status;
    EXPECT_EQ(first.error_code(), grpc::StatusCode::UNAUTHENTICATED);
    // The answer is the same to the last byte for any request, even for bytes that are not a
    // message.
    for (const std::string& request : {name, std::string("\xff\xff\xff")}) {
      const grpc::Status other = CallEmpty(channel, method, {}, request).status;
      EXPECT_EQ(other.error_code(), first.error_code());
      EXPECT_EQ(other.error_message(), first.error_message());
      EXPECT_EQ(other.error_details(), first.error_details());
    }
  }
}

TEST_F(AccessTest, TokensAreAddedAndRevokedWhileTheServerRuns) {
  const std::string first = folder_.CreateToken("first", "predict");
  const auto server = folder_.Start({"--tokens", folder_.file("tokens").string()});
  const auto channel = Connect(*server, "");
  const auto code = [&](const std::string& token) {
    return CallEmpty(channel, "/maneuver.v1.PredictionService/Predict", Bearer(token))
        .status.error_code();
  };
  // An empty request is invalid. Only an admitted caller is told so.
  EXPECT_EQ(code(first), grpc::StatusCode::INVALID_ARGUMENT);

  const auto stub = v1::PredictionService::NewStub(channel);
  grpc::ClientContext context;
  context.AddMetadata("authorization", "Bearer " + first);
  const auto stream = stub->StreamPredict(&context);
  v1::StreamPredictResponse response;
  ASSERT_TRUE(stream->Write({}));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.error().code(), static_cast<int>(grpc::StatusCode::INVALID_ARGUMENT));

  grpc::ClientContext outcomes_context;
  outcomes_context.AddMetadata("authorization", "Bearer " + first);
  const auto outcomes = v1::OutcomeService::NewStub(channel)->StreamOutcomes(&outcomes_context);
  v1::StreamOutcomesResponse scores;
  ASSERT_TRUE(outcomes->Write({}));
  ASSERT_TRUE(outcomes->Read(&scores));
  EXPECT_EQ(scores.error().code(), static_cast<int>(grpc::StatusCode::INVALID_ARGUMENT));

  const std::string second = folder_.CreateToken("second", "predict");
  const auto patience = std::chrono::seconds(10);
  EXPECT_TRUE(
      WaitFor([&] { return code(second) == grpc::StatusCode::INVALID_ARGUMENT; }, patience));

  // A file that does not parse changes nothing.
  const std::string lines = folder_.Read("tokens");
  folder_.Write("tokens", "second predict sha256:oops\n");
  EXPECT_TRUE(WaitFor([&] { return folder_.log_text().find("cannot reload") != std::string::npos; },
                      patience));
  EXPECT_THAT(folder_.log_text(), HasSubstr("line 1: "));
  EXPECT_THAT(folder_.log_text(), Not(HasSubstr("oops")));
  EXPECT_EQ(code(first), grpc::StatusCode::INVALID_ARGUMENT);

  // The first token is revoked, also for open streams.
  folder_.Write("tokens", lines.substr(lines.find('\n') + 1));
  EXPECT_TRUE(WaitFor([&] { return code(first) == grpc::StatusCode::UNAUTHENTICATED; }, patience));
  EXPECT_EQ(code(second), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_FALSE(stream->Read(&response));
  const grpc::Status end = stream->Finish();
  EXPECT_EQ(end.error_code(), grpc::StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(Reason(end), "TOKEN_UNKNOWN");
  EXPECT_FALSE(outcomes->Read(&scores));
  EXPECT_EQ(Reason(outcomes->Finish()), "TOKEN_UNKNOWN");
}

TEST_F(AccessTest, OnlyTheLogTellsAnExpiredTokenFromAnUnknownOne) {
  const std::string token = folder_.CreateToken("guest", "predict");
  const std::string line = folder_.Read("tokens");
  folder_.Write("tokens", line.substr(0, line.size() - 1) + " expires=2020-01-01T00:00:00Z\n");
  const auto server = folder_.Start({"--tokens", folder_.file("tokens").string()});
  const auto answer = [&](const std::string& shown) {
    return CallEmpty(Connect(*server, ""), "/maneuver.v1.PredictionService/Predict", Bearer(shown))
        .status;
  };
  const grpc::Status expired = answer(token);
  const grpc::Status unknown = answer("mvr_0");
  EXPECT_EQ(expired.error_code(), grpc::StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(expired.error_message(), unknown.error_message());
  EXPECT_EQ(expired.error_details(), unknown.error_details());
  EXPECT_TRUE(WaitFor([&] { return folder_.log_text().find("TOKEN_EXPIRED") != std::string::npos; },
                      std::chrono::seconds(10)));
  EXPECT_THAT(folder_.log_text(), HasSubstr("name:guest"));
}

std::chrono::milliseconds RetryDelay(const grpc::Status& status) {
  v1::Status details;
  v1::RetryInfo info;
  details.ParseFromString(status.error_details());
  for (const auto& any : details.details()) {
    if (any.type_url() == "type.googleapis.com/google.rpc.RetryInfo") {
      info.ParseFromString(any.value());
    }
  }
  return std::chrono::milliseconds(info.retry_delay().seconds() * 1000 +
                                   info.retry_delay().nanos() / 1'000'000);
}

TEST_F(AccessTest, ARateLimitTellsItsCallerWhenToRetryAndSparesOthers) {
  const std::string busy = folder_.CreateToken("busy", "predict");
  const std::string calm = folder_.CreateToken("calm", "predict");
  const auto server = folder_.Start({"--tokens", folder_.file("tokens").string(), "--rate-limit",
                                     "2", "--rate-limit-targets", "1"});
  const auto channel = Connect(*server, "");
  const std::string method = "/maneuver.v1.PredictionService/Predict";
  grpc::Status refused;
  for (int i = 0; i < 20 && refused.error_code() != grpc::StatusCode::RESOURCE_EXHAUSTED; ++i) {
    refused = CallEmpty(channel, method, Bearer(busy)).status;
  }
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(Reason(refused), "RATE_LIMITED");
  EXPECT_GT(RetryDelay(refused), std::chrono::milliseconds(0));
  EXPECT_LE(RetryDelay(refused), std::chrono::milliseconds(500));
  EXPECT_EQ(CallEmpty(channel, method, Bearer(calm)).status.error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);

  // A thousand targets at one per second: the first call is admitted (and told that no model
  // serves). The next one is refused for a thousand seconds.
  v1::PredictRequest request;
  for (int i = 0; i < 1000; ++i) request.add_scenarios()->add_target_ids(1);
  const std::string bytes = request.SerializeAsString();
  EXPECT_EQ(CallEmpty(channel, method, Bearer(calm), bytes).status.error_code(),
            grpc::StatusCode::FAILED_PRECONDITION);
  grpc::Status paid;
  EXPECT_TRUE(WaitFor(
      [&] {
        paid = CallEmpty(channel, method, Bearer(calm), bytes).status;
        return RetryDelay(paid) > std::chrono::seconds(900);
      },
      std::chrono::seconds(5)));
  EXPECT_EQ(Reason(paid), "RATE_LIMITED");
}

}  // namespace
}  // namespace maneuver::integration::access_test
