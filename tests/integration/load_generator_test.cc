// Checks maneuver load against a real server: both must count the same.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/load/metrics_page.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "tests/integration/trained_server.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::load_generator_test {
namespace {

using ::testing::HasSubstr;
using Arguments = std::vector<std::string>;

constexpr int kMostQueued = 24;  // targets

class LoadGeneratorTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    v1::TrainingSettings settings;
    ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(kTinySettings, &settings).ok());
    const auto model =
        inference::RandomModel(artifact::ResolveTrainingSettings(settings).model(), 1);
    const std::filesystem::path data = folder_->path() / "data";
    std::filesystem::create_directories(data / "models" / "tiny");
    ASSERT_TRUE(artifact::WriteModelFolder(data / "models" / "tiny" / "1", model).ok());
    server_ = std::make_unique<ServerProcess>(
        data, Arguments{"--workers", "1", "--max-queue", std::to_string(kMostQueued)});
    std::string output;
    ASSERT_EQ(RunManeuver(*server_, {"model", "promote", "tiny/1"}, &output), 0) << output;
  }
  static void TearDownTestSuite() {
    server_.reset();
    folder_.reset();
  }

  // Runs the command and reads the figures that it wrote.
  static nlohmann::json Load(Arguments arguments, int expected_status = 0) {
    const std::filesystem::path file = folder_->path() / "load.json";
    std::filesystem::remove(file);
    arguments.insert(arguments.begin(), "load");
    for (const std::string& more : Arguments{"--scenes", "4", "--metrics",
                                             server_->metrics_address(), "--json", file.string()}) {
      arguments.push_back(more);
    }
    EXPECT_EQ(RunManeuver(*server_, arguments, &output_), expected_status) << output_;
    std::ifstream stream(file);
    return nlohmann::json::parse(stream, nullptr, /*allow_exceptions=*/false);
  }

  static load::MetricsPage Metrics() {
    auto page = load::FetchMetrics(server_->metrics_address());
    EXPECT_TRUE(page.ok()) << page.status();
    return page.ok() ? *page : load::MetricsPage();
  }
  // Returns the number of calls that ended with a code; of Predict unless said otherwise.
  static int Calls(const load::MetricsPage& page, const std::string& code,
                   const std::string& method = "Predict") {
    return static_cast<int>(page.Sum("maneuver_requests_total",
                                     {{"method", "PredictionService/" + method}, {"code", code}})
                                .value_or(0.0));
  }
  static int Targets(const load::MetricsPage& page, const std::string& outcome) {
    return static_cast<int>(page.Sum("maneuver_targets_total", {{"outcome", outcome}}).value());
  }

  static std::unique_ptr<TemporaryFolder> folder_;
  static std::unique_ptr<ServerProcess> server_;
  static std::string output_;
};

std::unique_ptr<TemporaryFolder> LoadGeneratorTest::folder_;
std::unique_ptr<ServerProcess> LoadGeneratorTest::server_;
std::string LoadGeneratorTest::output_;

TEST_F(LoadGeneratorTest, AClosedLoopAgreesWithTheServersCounters) {
  const load::MetricsPage before = Metrics();
  const nlohmann::json report =
      Load({"--concurrency", "4", "--calls", "200", "--warm-up", "0", "--targets", "1-3"});
  const load::MetricsPage after = Metrics();
  ASSERT_EQ(report["steps"].size(), 1U) << output_;
  const auto& step = report["steps"][0];
  EXPECT_EQ(step["calls_due"], 200);
  EXPECT_EQ(step["ended"], nlohmann::json({{"OK", 200}}));
  EXPECT_EQ(step["latency_ms"]["count"], 200);
  EXPECT_EQ(Calls(after, "OK") - Calls(before, "OK"), 200 + 1);  // and one to try
  const int targets = step["targets_answered"];
  EXPECT_GT(targets, 250);
  EXPECT_LT(targets, 550);
  // The command reads the metrics only after its trial call, so that call does not count here.
  EXPECT_EQ(step["server"]["targets"]["answered"], targets);
  EXPECT_EQ(step["server"]["batched_targets"], targets);
  EXPECT_GT(step["server"]["stages_ms"]["encode"]["mean"], 0.0);
  EXPECT_THAT(output_, HasSubstr("4 callers"));
  EXPECT_THAT(output_, HasSubstr("SERVER UNDER"));
}

TEST_F(LoadGeneratorTest, AnOpenLoopCallsAtItsRate) {
  const load::MetricsPage before = Metrics();
  const nlohmann::json report = Load({"--rate", "50", "--arrival", "constant", "--warm-up", "0.2",
                                      "--duration", "1", "--method", "probability"});
  const load::MetricsPage after = Metrics();
  const auto& step = report["steps"][0];
  EXPECT_EQ(step["calls_due"], 50);
  EXPECT_EQ(step["offered_per_second"], 50.0);
  EXPECT_EQ(step["ended"], nlohmann::json({{"OK", 50}}));
  const char* method = "PredictActionProbabilities";
  EXPECT_EQ(Calls(after, "OK", method) - Calls(before, "OK", method), 60);
}

TEST_F(LoadGeneratorTest, SendsTheIdsOfRegisteredMapsInsteadOfTheMaps) {
  const Arguments calls = {"--calls", "20", "--warm-up", "0"};
  const nlohmann::json whole = Load(calls);
  const load::MetricsPage before = Metrics();
  Arguments named = calls;
  named.emplace_back("--register-maps");
  const nlohmann::json report = Load(named);
  const load::MetricsPage after = Metrics();
  EXPECT_EQ(report["steps"][0]["ended"], nlohmann::json({{"OK", 20}}));
  // The rest is mostly the agents' histories.
  EXPECT_LT(report["bytes_per_request"], 0.9 * whole["bytes_per_request"].get<double>());
  const auto hits = [](const load::MetricsPage& page) {
    return page.Sum("maneuver_map_lookups_total", {{"result", "hit"}}).value_or(0.0);
  };
  EXPECT_EQ(hits(after) - hits(before), 20 + 1);
}

TEST_F(LoadGeneratorTest, CountsRefusalsAndTheirDelaysButNotAsFailures) {
  const load::MetricsPage before = Metrics();
  // Each call takes a third of the queue, so most of sixteen callers are refused.
  const nlohmann::json report = Load(
      {"--concurrency", "16", "--targets", "8", "--warm-up", "0", "--calls", "300", "--send-all"});
  const load::MetricsPage after = Metrics();
  const auto& step = report["steps"][0];
  const int refused = step["ended"].value("RESOURCE_EXHAUSTED", 0);
  EXPECT_GT(refused, 0);
  EXPECT_EQ(step["refused_with_delay"], refused);
  EXPECT_EQ(step["held_back"], 0);
  EXPECT_GT(step["retry_delay_ms"]["least"], 0.0);
  EXPECT_EQ(refused + step["ended"].value("OK", 0), 300);
  EXPECT_EQ(Calls(after, "RESOURCE_EXHAUSTED") - Calls(before, "RESOURCE_EXHAUSTED"), refused);
  EXPECT_EQ(Targets(after, "refused") - Targets(before, "refused"), 8 * refused);
  EXPECT_LE(step["server"]["most_queued_targets"], kMostQueued);
}

TEST_F(LoadGeneratorTest, CountsCallsThatTheClientHeldBackAsRefused) {
  const load::MetricsPage before = Metrics();
  const nlohmann::json report = Load({"--rate", "2000", "--targets", "8", "--warm-up", "0",
                                      "--duration", "1", "--connections", "1"});
  const load::MetricsPage after = Metrics();
  const auto& step = report["steps"][0];
  const int refused = step["ended"].value("RESOURCE_EXHAUSTED", 0);
  const int held_back = step["held_back"];
  EXPECT_GT(held_back, 0);
  EXPECT_EQ(step["refused_with_delay"], refused);
  EXPECT_EQ(Calls(after, "RESOURCE_EXHAUSTED") - Calls(before, "RESOURCE_EXHAUSTED"),
            refused - held_back);
  EXPECT_THAT(output_, HasSubstr("--send-all"));
}

TEST_F(LoadGeneratorTest, CountsExpiredCallsButNotAsFailures) {
  const nlohmann::json report =
      Load({"--rate", "400", "--deadline", "0.1-0.3", "--warm-up", "0", "--calls", "200"});
  const auto& step = report["steps"][0];
  EXPECT_GT(step["ended"].value("DEADLINE_EXCEEDED", 0), 0);
  EXPECT_EQ(step["calls_due"], 200);
  // Every call that reached the server has ended there in some way.
  const auto& targets = step["server"]["targets"];
  EXPECT_LE(targets["answered"].get<int>() + targets["expired"].get<int>() +
                targets["cancelled"].get<int>() + targets["refused"].get<int>(),
            200);
}

TEST_F(LoadGeneratorTest, ASweepMeasuresTheCapacityAndThenFractionsOfIt) {
  const nlohmann::json report = Load({"--rates", "50%,20", "--concurrency", "4", "--warm-up", "0.1",
                                      "--duration", "0.5", "--arrival", "constant"});
  ASSERT_EQ(report["steps"].size(), 3U) << output_;
  const double capacity = report["capacity"];
  EXPECT_EQ(report["steps"][0]["answered_per_second"], capacity);
  EXPECT_EQ(report["steps"][0]["callers"], 4);
  EXPECT_DOUBLE_EQ(report["steps"][1]["rate"], 0.5 * capacity);
  EXPECT_NEAR(report["steps"][1]["offered_per_second"], 0.5 * capacity, 2.0);
  EXPECT_EQ(report["steps"][2]["calls_due"], 10);
}

TEST_F(LoadGeneratorTest, FailsAtOnceIfTheModelDoesNotExist) {
  Load({"--model", "nobody", "--duration", "60"}, 1);
  EXPECT_THAT(output_, HasSubstr("nobody"));
}

TEST_F(LoadGeneratorTest, StartsEvenIfTheServerIsTooBusyForTheFirstCall) {
  // The only call that the server accepts for a while is the one that promotes the model.
  const std::filesystem::path data = folder_->path() / "busy";
  std::filesystem::create_directories(data / "models");
  std::filesystem::copy(folder_->path() / "data" / "models" / "tiny", data / "models" / "tiny",
                        std::filesystem::copy_options::recursive);
  const ServerProcess busy(data, Arguments{"--rate-limit", "0.001"});
  std::string output;
  ASSERT_EQ(RunManeuver(busy, {"--output", "json", "model", "promote", "tiny/1"}, &output), 0)
      << output;
  EXPECT_EQ(RunManeuver(busy,
                        {"load", "--concurrency", "1", "--duration", "0.5", "--warm-up", "0",
                         "--scenes", "1", "--send-all"},
                        &output),
            0)
      << output;
  EXPECT_THAT(output, HasSubstr("1 caller"));
}

TEST_F(LoadGeneratorTest, CtrlCPrintsWhatWasMeasuredSoFar) {
  const std::filesystem::path file = folder_->path() / "interrupted.json";
  const std::filesystem::path log = folder_->path() / "interrupted.log";
  const int before = Calls(Metrics(), "OK");
  ChildProcess command({MANEUVER, "--server", server_->address(), "load", "--rate", "100",
                        "--warm-up", "0", "--duration", "100", "--json", file.string()},
                       log);
  ASSERT_TRUE(
      WaitFor([&] { return Calls(Metrics(), "OK") > before + 20; }, std::chrono::seconds(20)));
  command.Signal(SIGINT);
  EXPECT_EQ(command.Wait(std::chrono::seconds(10)), 1);
  const auto report = nlohmann::json::parse(std::ifstream(file));
  EXPECT_EQ(report["interrupted"], true);
  EXPECT_GE(report["steps"][0]["ended"]["OK"], 15);
  EXPECT_LT(report["steps"][0]["seconds"], 20.0);
  std::stringstream text;
  text << std::ifstream(log).rdbuf();
  EXPECT_THAT(text.str(), HasSubstr("100/s"));
  EXPECT_THAT(text.str(), HasSubstr("interrupted"));
}

}  // namespace
}  // namespace maneuver::integration::load_generator_test
