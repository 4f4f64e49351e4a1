#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "client/cli/command.h"
#include "client/cli/load_arguments.h"
#include "client/cli/load_report.h"
#include "client/cli/maneuver.h"
#include "client/cli/table.h"
#include "model/data/dataset_folder.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/client/test_server.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::load_command_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(LoadArgumentsTest, ARangeIsOneNumberOrTwo) {
  const auto one = ParseRange("--targets", "5", 1, 10);
  ASSERT_TRUE(one.ok());
  EXPECT_EQ(one->least, 5.0);
  EXPECT_EQ(one->most, 5.0);
  const auto two = ParseRange("--deadline", "0.5-7.5", 0.1, 10);
  ASSERT_TRUE(two.ok());
  EXPECT_EQ(two->least, 0.5);
  EXPECT_EQ(two->most, 7.5);
  for (const char* text : {"", "-", "5-", "-5", "5-4", "0-4", "5-11", "a", "1-b", "nan", "1-nan"}) {
    const auto range = ParseRange("--targets", text, 1, 10);
    ASSERT_FALSE(range.ok()) << text;
    EXPECT_THAT(std::string(range.status().message()), HasSubstr("--targets"));
  }
}

TEST(LoadArgumentsTest, RatesAreCallsPerSecondOrSharesOfTheCapacity) {
  const auto rates = ParseRates("25%, 300%,200,0.5");
  ASSERT_TRUE(rates.ok());
  ASSERT_EQ(rates->size(), 4U);
  EXPECT_TRUE((*rates)[0].of_capacity);
  EXPECT_DOUBLE_EQ((*rates)[0].value, 0.25);
  EXPECT_EQ(RateName((*rates)[1]), "300 %");
  EXPECT_FALSE((*rates)[2].of_capacity);
  EXPECT_EQ(RateName((*rates)[2]), "200/s");
  EXPECT_EQ(RateName((*rates)[3]), "0.5/s");
  for (const char* text : {"", "0", "-5", "25%%", "25,", "%", "inf", "fast"}) {
    EXPECT_FALSE(ParseRates(text).ok()) << text;
  }
}

TEST(LoadCommandTest, ContradictionsAndWrongRangesAreUsageErrors) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"load", "--rate", "5", "--rates", "25%"},
                                             {"load", "--rate", "5", "--concurrency", "3"},
                                             {"load", "--rate", "0"},
                                             {"load", "--rates", "none"},
                                             {"load", "--rates", "100", "--concurrency", "3"},
                                             {"load", "--targets", "5-1"},
                                             {"load", "--targets", "1.5"},
                                             {"load", "--deadline", "soon"},
                                             {"load", "--metrics", "localhost"},
                                             {"load", "--dataset", "/nowhere"},
                                             {"load", "/nowhere/scene.json"}}) {
    std::istringstream in;
    std::ostringstream out;
    std::ostringstream err;
    Environment environment(in, out, err);
    environment.server = "127.0.0.1:1";  // not even called
    EXPECT_EQ(RunManeuver(arguments, environment), kUsage) << testing::PrintToString(arguments);
    EXPECT_EQ(out.str(), "");
  }
}

TEST(LoadCommandTest, NamesAMetricsPageThatIsAwayAndNotTheServer) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, v1::PredictResponse* response) {
    response->add_predictions()->add_targets();
    return grpc::Status::OK;
  };
  // Nobody listens on port 1 of this machine.
  const Result result = Maneuver({"--server", server.address(), "load", "--scenes", "1", "--calls",
                                  "1", "--metrics", "127.0.0.1:1"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_EQ(result.err, "maneuver: no metrics at 127.0.0.1:1: nobody listens there\n");
}

TEST(LoadCommandTest, AnErrorOfTheServerIsNoWrongCommandLine) {
  client::TestServer server;
  server.on_register_map = [](const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::NOT_FOUND, "there is no such store");
  };
  const Result result =
      Maneuver({"--server", server.address(), "load", "--scenes", "1", "--register-maps"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_EQ(result.err, "maneuver: there is no such store\n");
}

TEST(LoadCommandTest, ScenesOfFilesExcludeThoseOfADataset) {
  for (const std::string option : {"--dataset", "--scenes"}) {
    const Result result = Maneuver({"load", "scene.json", option, "5"});
    EXPECT_EQ(result.status, kUsage);
    EXPECT_THAT(result.err, AllOf(HasSubstr(option), HasSubstr("excludes")));
  }
}

TEST(LoadCommandTest, ReadsADatasetFolderWithoutAnIndex) {
  const TemporaryFolder folder;
  auto writer = data::DatasetWriter::Create(folder / "town", "a test");
  for (const char* id : {"r0", "r1"}) {
    ASSERT_TRUE((*writer)->Add(data::SmallRecording(id)).ok());
  }
  ASSERT_TRUE((*writer)->Commit().ok());
  const std::filesystem::path index = folder / "town/.scenarios-00000.tfrecord.index";
  ASSERT_TRUE(std::filesystem::remove(index));
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, v1::PredictResponse* response) {
    response->add_predictions()->add_targets();
    return grpc::Status::OK;
  };
  const Result result = Maneuver({"--server", server.address(), "load", "--dataset",
                                  folder / "town", "--calls", "2", "--warm-up", "0"});
  EXPECT_EQ(result.status, kOk) << result.err;
  // Reading recordings by their ids would have written it, once for each of them.
  EXPECT_FALSE(std::filesystem::exists(index));
}

// Answers the first call, which finds out whether the server can be asked at all.
TEST(LoadCommandTest, WithJsonOutputFailuresAreJson) {
  client::TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, v1::PredictResponse* response) -> grpc::Status {
    if (calls++ > 0) return {grpc::StatusCode::INTERNAL, "the engine failed"};
    response->add_predictions()->add_targets();
    return grpc::Status::OK;
  };
  const Result run = Maneuver({"--server", server.address(), "--output", "json", "load", "--scenes",
                               "1", "--concurrency", "1", "--calls", "3", "--warm-up", "0"});
  EXPECT_EQ(run.status, kFailed);
  const auto line = nlohmann::json::parse(run.err, nullptr, /*allow_exceptions=*/false);
  ASSERT_FALSE(line.is_discarded()) << run.err;
  EXPECT_EQ(line["error"]["code"], "INTERNAL");
  EXPECT_EQ(line["error"]["message"], "1 caller: the engine failed");
}

TEST(LoadCommandTest, WithoutACapacityItAdvisesALongerDurationAlone) {
  client::TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](grpc::ServerContext* context, const auto&,
                          v1::PredictResponse* response) -> grpc::Status {
    while (calls > 0 && !context->IsCancelled()) {
      std::this_thread::sleep_for(milliseconds(1));
    }
    ++calls;
    response->add_predictions()->add_targets();
    return grpc::Status::OK;
  };
  const Result run =
      Maneuver({"--server", server.address(), "--timeout", "2", "load", "--scenes", "1", "--rates",
                "50%", "--concurrency", "1", "--duration", "0.1", "--warm-up", "0"});
  EXPECT_EQ(run.status, kFailed);
  EXPECT_THAT(run.err, AllOf(HasSubstr("set a longer --duration"), Not(HasSubstr("--timeout"))));
}

TEST(LoadCommandTest, NamesAServerThatDoesNotAnswerBeforeSendingLoad) {
  std::istringstream in;
  std::ostringstream out;
  std::ostringstream err;
  Environment environment(in, out, err);
  EXPECT_EQ(RunManeuver({"--server", "127.0.0.1:1", "--timeout", "0.05", "load", "--scenes", "1"},
                        environment),
            kFailed);
  EXPECT_EQ(out.str(), "");
  EXPECT_THAT(err.str(), HasSubstr("127.0.0.1:1"));
}

TEST(LoadCommandTest, SaysThatAllCallsFellIntoTheWarmUp) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, v1::PredictResponse* response) {
    response->add_predictions()->add_targets();
    return grpc::Status::OK;
  };
  const Result run = Maneuver(
      {"--server", server.address(), "load", "--scenes", "1", "--calls", "5", "--warm-up", "60"});
  EXPECT_EQ(run.status, kOk) << run.err;
  EXPECT_THAT(run.out, HasSubstr("32 callers: every call fell into the warm-up; set --warm-up 0 or "
                                 "more --calls"));
  const Result sweep = Maneuver({"--server", server.address(), "load", "--scenes", "1", "--calls",
                                 "5", "--warm-up", "60", "--rates", "50%"});
  EXPECT_EQ(sweep.status, kFailed);
  EXPECT_THAT(sweep.err, HasSubstr("every call fell into the warm-up, so the capacity is unknown"));
}

// Two hundred calls at even times in 2 s: number i took i + 1 ms; every tenth was refused instead.
LoadReport ExampleReport() {
  LoadStep step{"80 %", {.loop = load::OpenLoop{.rate = 100.0}}, {}};
  const load::TimePoint start;
  const load::Window window{start, start + seconds(2)};
  for (int i = 0; i < 200; ++i) {
    const load::TimePoint due = start + milliseconds(10 * i);
    const absl::Status status = i % 10 == 9 ? absl::ResourceExhaustedError("full") : absl::Status();
    step.tally.Add(window, due, due, due + milliseconds(i + 1), {status, 2});
  }
  step.tally.length = seconds(2);
  const char* page = R"(maneuver_stage_duration_seconds_count{stage="queue"} %1
maneuver_stage_duration_seconds_sum{stage="queue"} %2
maneuver_targets_total{outcome="answered"} %1
process_resident_memory_bytes 5e6
)";
  const auto at = [&](const std::string& count, const std::string& sum) {
    std::string text = page;
    for (const auto& [mark, value] : {std::pair("%1", count), std::pair("%2", sum)}) {
      for (size_t where = text.find(mark); where != std::string::npos; where = text.find(mark)) {
        text.replace(where, 2, value);
      }
    }
    return load::MetricsPage::Parse(text);
  };
  step.server = load::ServerChange{at("100", "1"), at("460", "1.9"), {.memory_bytes = 7e6}};
  LoadReport report{.server = "here:1", .requests = 64, .steps = {step}};
  report.capacity = 125.0;
  return report;
}

TEST(LoadReportTest, TablesShowMeasurementsOfCallersAndOfTheServer) {
  const std::string text = LoadReportText(ExampleReport(), TableStyle::kText);
  // Offered 100/s. Due before 2 s and answered by then: those with 11 i + 1 < 2000, of 182 a tenth
  // was refused. p50 of 180 answers: number 90, after nine refusals before it, 1 ms each.
  EXPECT_THAT(text, HasSubstr("80 %        100        82.0        164       20        0       0"));
  EXPECT_THAT(text, HasSubstr("80 %              2.50"));  // 0.9 s over 360 targets
  EXPECT_THAT(text, HasSubstr("7.0 MB"));
  EXPECT_THAT(text, HasSubstr("0 of 20 refused calls were told to wait"));
}

TEST(LoadReportTest, MarkdownHasARuleBelowItsTitles) {
  const std::string text = LoadReportText(ExampleReport(), TableStyle::kMarkdown);
  EXPECT_THAT(text, HasSubstr("| LOAD | OFFERED/s |"));
  EXPECT_THAT(text, HasSubstr("\n|---|---:|"));
  EXPECT_THAT(text, HasSubstr("\n| 80 % | 100 | 82.0 |"));
}

TEST(LoadReportTest, JsonHasTheFiguresAndNoNaN) {
  const nlohmann::json json = nlohmann::json::parse(LoadReportJson(ExampleReport()));
  EXPECT_EQ(json["capacity"], 125.0);
  const auto& step = json["steps"][0];
  EXPECT_EQ(step["name"], "80 %");
  EXPECT_EQ(step["calls_due"], 200);
  EXPECT_EQ(step["ended"]["RESOURCE_EXHAUSTED"], 20);
  EXPECT_NEAR(step["latency_ms"]["max"], 199.0, 1e-9);
  EXPECT_NEAR(step["latency_ms"]["p50"], 99.0, 0.1);
  EXPECT_EQ(step["server"]["targets"]["answered"], 360.0);
  EXPECT_NEAR(step["server"]["stages_ms"]["queue"]["mean"], 2.5, 1e-9);
  EXPECT_TRUE(step["server"]["targets"]["expired"].is_null());
  EXPECT_TRUE(step["server"]["batch_size_mean"].is_null());
}

TEST(LoadReportTest, SaysWhyCallsWereSentLate) {
  LoadStep step{"9/s", {.max_in_flight = 7}, {}};
  const load::TimePoint start;
  const load::Window window{start, start + seconds(2)};
  for (int i = 0; i < 100; ++i) {
    step.tally.Add(window, start, start + milliseconds(50), start + milliseconds(60), {{}, 1});
  }
  LoadReport report;
  report.steps = {step};
  EXPECT_THAT(LoadReportText(report, TableStyle::kText),
              HasSubstr("the load generator lacks processor time"));
  report.steps[0].tally.waited = 90;
  const std::string text = LoadReportText(report, TableStyle::kText);
  EXPECT_THAT(text, HasSubstr("90 waited because 7 were in flight (--max-in-flight)"));
  EXPECT_THAT(text, Not(HasSubstr("processor time")));
}

TEST(LoadReportTest, EscapesAMessageOfTheServer) {
  LoadReport report;
  LoadStep& step = report.steps.emplace_back();
  step.tally.refused_targets = 1;
  step.tally.failure = absl::InvalidArgumentError("no \x1b[2J");
  EXPECT_THAT(LoadReportText(report, TableStyle::kText), HasSubstr("no \\x1b[2J"));
}

TEST(LoadReportTest, ShowsMissingFiguresAsDashes) {
  LoadReport report;
  report.steps.push_back({"5/s", {}, {}});
  const std::string text = LoadReportText(report, TableStyle::kText);
  EXPECT_THAT(text, HasSubstr(" -"));
  EXPECT_THAT(text, Not(HasSubstr("nan")));
  EXPECT_THAT(text, Not(HasSubstr("SERVER UNDER")));  // its metrics were not read
}

}  // namespace
}  // namespace maneuver::cli::load_command_test
