// What the server is started with, from command line, environment and file together.

#include "server/maneuverd/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "model/machine/usable_cores.h"
#include "model/machine/usable_memory.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::options_test {
namespace {

using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Outcome {
  std::variant<ServerOptions, int> parsed;
  std::string out;
  std::string err;

  const ServerOptions& options() const { return std::get<ServerOptions>(parsed); }
  bool refused() const { return std::holds_alternative<int>(parsed) && std::get<int>(parsed) == 2; }
};

class OptionsTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) {
    const std::filesystem::path file = folder_ / name;
    std::ofstream(file) << text;
    return file.string();
  }

  static Outcome Parse(std::vector<std::string> arguments,
                       std::vector<std::string> environment = {}) {
    std::vector<const char*> argv = {"maneuverd"};
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    std::vector<const char*> variables;
    for (const std::string& variable : environment) variables.push_back(variable.c_str());
    variables.push_back(nullptr);
    ::testing::internal::CaptureStdout();
    ::testing::internal::CaptureStderr();
    auto parsed = ParseCommandLine(static_cast<int>(argv.size()), argv.data(), variables.data());
    return {std::move(parsed), ::testing::internal::GetCapturedStdout(),
            ::testing::internal::GetCapturedStderr()};
  }

  const TemporaryFolder folder_;
};

TEST_F(OptionsTest, TheCommandLineOverridesTheEnvironmentWhichOverridesTheFile) {
  const std::string file =
      Write("m.conf", "data-dir = \"from file\"\nmax-batch = 3\nmax-queue = 33\nworkers = 5\n");
  const Outcome outcome = Parse({"--config", file, "--max-batch", "1"},
                                {"MANEUVERD_MAX_BATCH=2", "MANEUVERD_MAX_QUEUE=22", "HOME=/"});
  ASSERT_EQ(outcome.err, "");
  EXPECT_EQ(outcome.options().scheduler.queue.max_batch, 1);
  EXPECT_EQ(outcome.options().scheduler.queue.max_queue, 22);
  EXPECT_EQ(outcome.options().scheduler.workers, 5);
  EXPECT_EQ(outcome.options().data_dir, "from file");
}

TEST_F(OptionsTest, RefusesAMemoryLimitThatTheServerAloneExceeds) {
  for (const std::string limit : {"1", "63MiB"}) {
    const Outcome outcome = Parse({"--data-dir", "d", "--memory-limit", limit});
    EXPECT_TRUE(outcome.refused()) << limit;
    EXPECT_THAT(outcome.err, HasSubstr("--memory-limit")) << limit;
  }
  EXPECT_FALSE(Parse({"--data-dir", "d", "--memory-limit", "64MiB"}).refused());
  EXPECT_FALSE(Parse({"--data-dir", "d", "--memory-limit", "0"}).refused());
}

TEST_F(OptionsTest, TheEnvironmentCanNameTheFileAndTurnFlagsOff) {
  const std::string file = Write("m.conf", "data-dir = d\ninsecure = true\nlisten = 0.0.0.0:0\n");
  EXPECT_EQ(Parse({}, {"MANEUVERD_CONFIG=" + file}).options().listen.host, "0.0.0.0");
  const Outcome off = Parse({}, {"MANEUVERD_CONFIG=" + file, "MANEUVERD_INSECURE=false"});
  EXPECT_TRUE(off.refused());
  EXPECT_THAT(off.err, HasSubstr("--listen"));
}

TEST_F(OptionsTest, RefusesWhatIsNotANumber) {
  for (const std::string option : {"--rate-limit", "--rate-limit-targets", "--job-time-limit",
                                   "--shutdown-timeout", "--shadow-fraction", "--keep-jobs"}) {
    const Outcome outcome = Parse({"--data-dir", "d", option, "nan"});
    EXPECT_TRUE(outcome.refused()) << option;
    EXPECT_THAT(outcome.err, HasSubstr("is not a number")) << option;
  }
  EXPECT_TRUE(Parse({"--data-dir", "d"}, {"MANEUVERD_RATE_LIMIT=-nan"}).refused());
}

TEST_F(OptionsTest, ARoleNeedsServersThatShare) {
  EXPECT_EQ(Parse({"--data-dir", "d"}).options().role, Role::kAll);
  const Outcome alone = Parse({"--data-dir", "d", "--role", "serve"});
  EXPECT_TRUE(alone.refused());
  EXPECT_THAT(alone.err, HasSubstr("--role serve needs --shared"));
  const std::vector<std::string> shared = {"--data-dir", "d", "--store", "postgresql:///m",
                                           "--shared"};
  const auto with = [&](const std::string& role) {
    std::vector<std::string> arguments = shared;
    arguments.insert(arguments.end(), {"--role", role});
    return Parse(std::move(arguments));
  };
  EXPECT_EQ(with("api").options().role, Role::kApi);
  EXPECT_EQ(with("work").options().role, Role::kWork);
  EXPECT_TRUE(with("worker").refused());
  const std::string file = Write("m.conf", "role = serve\nreplica-name = left\n");
  std::vector<std::string> arguments = shared;
  arguments.insert(arguments.end(), {"--config", file});
  EXPECT_EQ(Parse(arguments).options().role, Role::kServe);
  EXPECT_EQ(Parse(arguments).options().replica_name, "left");
}

TEST_F(OptionsTest, AJobMayHaveWhatTheMachineHasUnlessTheOptionsSayOtherwise) {
  const auto jobs = [](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--data-dir", "d"});
    return Parse(arguments).options().jobs;
  };
  EXPECT_EQ(RanksForAJob(jobs({})), machine::UsableCores());
  EXPECT_EQ(MemoryForAJob(jobs({"--max-running-jobs", "4"})), machine::UsableMemory() / 4);
  EXPECT_EQ(RanksForAJob(jobs({"--job-ranks", "3"})), 3);
  EXPECT_EQ(MemoryForAJob(jobs({"--job-memory", "24GiB"})), int64_t{24} << 30);
  // The ranks run elsewhere.
  EXPECT_GE(RanksForAJob(jobs({"--trainer-command", "srun -n{ranks}"})), 64);
}

TEST_F(OptionsTest, DatasetFoldersAreAbsolutePaths) {
  EXPECT_THAT(Parse({"--data-dir", "d"}).options().datasets.folders, ::testing::IsEmpty());
  EXPECT_THAT(Parse({"--data-dir", "d", "--dataset-folders", "/data/town, /mnt"})
                  .options()
                  .datasets.folders,
              ::testing::ElementsAre("/data/town", "/mnt"));
  const Outcome outcome = Parse({"--data-dir", "d", "--dataset-folders", "/data,town"});
  EXPECT_TRUE(outcome.refused());
  EXPECT_THAT(outcome.err, HasSubstr("--dataset-folders: town is not an absolute path"));
}

TEST_F(OptionsTest, AnEmptyVariableCountsAsUnset) {
  EXPECT_EQ(Parse({"--data-dir", "d"}, {"MANEUVERD_MAX_BATCH=", "MANEUVERD_TOKENS="})
                .options()
                .scheduler.queue.max_batch,
            ServerOptions().scheduler.queue.max_batch);
}

TEST_F(OptionsTest, RefusesUnknownNamesAndSaysWhereTheyAre) {
  const std::string file = Write("m.conf", "data-dir = d\nmax-bach = 3\n");
  const Outcome in_file = Parse({"--config", file});
  EXPECT_TRUE(in_file.refused());
  EXPECT_THAT(in_file.err, HasSubstr("m.conf:2: there is no option max-bach"));
  const Outcome variable = Parse({"--data-dir", "d"}, {"MANEUVERD_MAX_BACH=3"});
  EXPECT_TRUE(variable.refused());
  EXPECT_THAT(variable.err, HasSubstr("MANEUVERD_MAX_BACH: "));
  for (const char* name : {"config", "print-config", "help", "version"}) {
    EXPECT_TRUE(
        Parse({"--config", Write("n.conf", "data-dir = d\n" + std::string(name) + " = true\n")})
            .refused())
        << name;
  }
  EXPECT_TRUE(Parse({"--config", (folder_ / "none.conf").string()}).refused());
}

TEST_F(OptionsTest, RefusesABadValueAndSaysWhereItIs) {
  const std::string file = Write("m.conf", "data-dir = d\nmax-batch = 0\n");
  const Outcome in_file = Parse({"--config", file});
  EXPECT_TRUE(in_file.refused());
  EXPECT_THAT(in_file.err, HasSubstr("m.conf:2: --max-batch: "));
  const Outcome variable = Parse({"--data-dir", "d"}, {"MANEUVERD_WORKERS=many"});
  EXPECT_TRUE(variable.refused());
  EXPECT_THAT(variable.err, AllOf(HasSubstr("MANEUVERD_WORKERS: "), HasSubstr("--workers")));
  const Outcome address = Parse({"--data-dir", "d"}, {"MANEUVERD_METRICS_LISTEN=nowhere"});
  EXPECT_TRUE(address.refused());
  EXPECT_THAT(address.err, HasSubstr("MANEUVERD_METRICS_LISTEN: --metrics-listen: "));
  const Outcome empty = Parse({"--config", Write("e.conf", "data-dir = d\nworkers = \"\"\n")});
  EXPECT_TRUE(empty.refused());
  EXPECT_THAT(empty.err, HasSubstr("e.conf:2: workers needs a value"));
}

TEST_F(OptionsTest, NamesVersionsToServeByModelAndNumber) {
  using security::ModelVersionName;
  EXPECT_THAT(Parse({"--data-dir", "d"}).options().serve, ::testing::IsEmpty());
  EXPECT_THAT(Parse({"--data-dir", "d", "--serve", "town/3, highway/12"}).options().serve,
              ::testing::ElementsAre(ModelVersionName{"town", 3}, ModelVersionName{"highway", 12}));
  for (const char* text : {"town", "town/0", "town/x", "Town/1", "town/1/2", "town@serving"}) {
    const Outcome outcome = Parse({"--data-dir", "d", "--serve", text});
    EXPECT_TRUE(outcome.refused()) << text;
    EXPECT_THAT(outcome.err, HasSubstr("--serve"));
  }
}

TEST_F(OptionsTest, ChoosesPlainKernelsByName) {
  using kernels::KernelChoice;
  EXPECT_EQ(Parse({"--data-dir", "d"}).options().kernels, KernelChoice::kAuto);
  EXPECT_EQ(Parse({"--data-dir", "d", "--kernels", "plain"}).options().kernels,
            KernelChoice::kPlain);
  const std::string file = Write("kernels.conf", "data-dir = d\nkernels = plain\n");
  EXPECT_EQ(Parse({"--config", file}).options().kernels, KernelChoice::kPlain);
  EXPECT_TRUE(Parse({"--data-dir", "d", "--kernels", "AVX2"}).refused());
}

TEST_F(OptionsTest, PrintedSettingsCanBeReadBack) {
  const std::vector<std::string> arguments = {"--data-dir",
                                              "a \"b\" # c\\",
                                              "--workers",
                                              "7",
                                              "--max-queue-delay",
                                              "2.5",
                                              "--insecure",
                                              "--log-format",
                                              "json",
                                              "--precision",
                                              "f32",
                                              "--keep-jobs",
                                              "3",
                                              "--metrics-listen",
                                              "none",
                                              "--listen",
                                              "0.0.0.0:1"};
  std::vector<std::string> print = arguments;
  print.emplace_back("--print-config");
  const Outcome printed = Parse(print);
  ASSERT_EQ(std::get<int>(printed.parsed), 0) << printed.err;
  const std::string file = Write("printed.conf", printed.out);
  const Outcome again = Parse({"--config", file, "--print-config"});
  EXPECT_EQ(again.err, "");
  EXPECT_EQ(again.out, printed.out);
  const Outcome read = Parse({"--config", file});
  EXPECT_EQ(read.options().data_dir, "a \"b\" # c\\");
  EXPECT_EQ(read.options().scheduler.workers, 7);
  EXPECT_EQ(read.options().scheduler.queue.max_queue_delay, std::chrono::microseconds(2500));
  EXPECT_EQ(read.options().jobs.retention.jobs, absl::Hours(72));
  EXPECT_EQ(read.options().listen.host, "0.0.0.0");
  EXPECT_FALSE(read.options().metrics_listen.has_value());
  EXPECT_EQ(read.options().log_format, monitoring::LogFormat::kJson);
}

// The default of an option whose value is converted is stated twice: as text, and as what it means.
TEST_F(OptionsTest, PrintedDefaultsMeanWhatHoldsWithoutThem) {
  const Outcome printed = Parse({"--data-dir", "d", "--print-config"});
  const Outcome without = Parse({"--data-dir", "d"});
  const Outcome with = Parse({"--config", Write("defaults.conf", printed.out)});
  ASSERT_TRUE(std::holds_alternative<ServerOptions>(with.parsed)) << with.err;
  const ServerOptions& unset = without.options();
  const ServerOptions& set = with.options();
  EXPECT_EQ(unset.role, set.role);
  EXPECT_EQ(unset.limits.max_message_bytes, set.limits.max_message_bytes);
  EXPECT_EQ(unset.limits.max_idle, set.limits.max_idle);
  EXPECT_EQ(unset.limits.max_age, set.limits.max_age);
  EXPECT_EQ(unset.limits.handshake, set.limits.handshake);
  EXPECT_EQ(unset.limits.keepalive, set.limits.keepalive);
  EXPECT_EQ(unset.limits.request, set.limits.request);
  EXPECT_EQ(unset.scheduler.queue.max_queue_delay, set.scheduler.queue.max_queue_delay);
  EXPECT_EQ(unset.datasets.keep_uploads, set.datasets.keep_uploads);
  EXPECT_EQ(unset.engine.precision, set.engine.precision);
  EXPECT_EQ(unset.kernels, set.kernels);
  EXPECT_EQ(unset.log_format, set.log_format);
  EXPECT_EQ(unset.log_level, set.log_level);
  EXPECT_EQ(unset.shutdown_delay, set.shutdown_delay);
  EXPECT_EQ(unset.shutdown_timeout, set.shutdown_timeout);
  EXPECT_EQ(unset.jobs.limits.memory_bytes, set.jobs.limits.memory_bytes);
  EXPECT_EQ(unset.jobs.limits.run_time, set.jobs.limits.run_time);
  EXPECT_EQ(unset.jobs.checkpoints.interval, set.jobs.checkpoints.interval);
  EXPECT_EQ(unset.jobs.retention.jobs, set.jobs.retention.jobs);
  EXPECT_EQ(unset.jobs.retention.checkpoints, set.jobs.retention.checkpoints);
}

TEST_F(OptionsTest, HelpIgnoresTheEnvironment) {
  const Outcome help = Parse({"--help"}, {"MANEUVERD_NONSENSE=1"});
  EXPECT_EQ(std::get<int>(help.parsed), 0);
  EXPECT_THAT(help.out, AllOf(HasSubstr("--max-batch"), HasSubstr("MANEUVERD_MAX_BATCH")));
}

TEST_F(OptionsTest, TheDocumentationListsEveryOption) {
  std::ostringstream page;
  page << std::ifstream(MANEUVER_DOCS "/configuration.md").rdbuf();
  const Outcome printed = Parse({"--data-dir", "d", "--print-config"});
  int options = 0;
  for (const absl::string_view line : absl::StrSplit(printed.out, '\n', absl::SkipEmpty())) {
    const std::string name(line.substr(0, line.find(' ')));
    EXPECT_THAT(page.str(), HasSubstr("\n| `" + name + "` |"));
    ++options;
  }
  EXPECT_GT(options, 25);
}

TEST_F(OptionsTest, ServersThatShareAFolderNeedADatabase) {
  const std::string uri = "postgresql://maneuver@db.example/maneuver";
  EXPECT_FALSE(Parse({"--data-dir", "d", "--store", uri}).options().is_shared);
  const Outcome shared = Parse({"--data-dir", "d", "--shared", "--store", uri});
  EXPECT_TRUE(shared.options().is_shared);
  EXPECT_TRUE(shared.options().datasets.is_shared);
  EXPECT_THAT(Parse({"--data-dir", "d", "--shared"}).err, HasSubstr("--shared needs --store"));
}

TEST_F(OptionsTest, TheStoreIsTheEmbeddedOneUnlessADatabaseIsNamed) {
  EXPECT_EQ(Parse({"--data-dir", "d"}).options().store, "");
  const std::string uri = "postgresql://maneuver@db.example/maneuver?passfile=/etc/pgpass";
  EXPECT_EQ(Parse({"--data-dir", "d"}, {"MANEUVERD_STORE=" + uri}).options().store, uri);
  const Outcome other = Parse({"--data-dir", "d", "--store", "mysql://db.example/maneuver"});
  EXPECT_TRUE(other.refused());
  EXPECT_THAT(other.err, HasSubstr("--store: expected a URI such as postgresql://"));
}

TEST_F(OptionsTest, APasswordOfTheStoreIsRefusedAndNotShown) {
  for (const std::string uri :
       {"postgresql://maneuver:hunter2@db.example/maneuver", "postgresql:///m?password=hunter2",
        "postgresql://maneuver:hunter2/7@db.example/maneuver",
        "postgresql:///m?host=/run&PASSWORD=hunter2", "postgresql:///m?p%61ssword=hunter2"}) {
    const Outcome outcome =
        Parse({"--data-dir", "d", "--print-config"}, {"MANEUVERD_STORE=" + uri});
    EXPECT_TRUE(outcome.refused()) << uri;
    EXPECT_THAT(outcome.err, HasSubstr("MANEUVERD_STORE: --store: the URI holds a password"));
    EXPECT_THAT(outcome.out + outcome.err, ::testing::Not(HasSubstr("hunter2")));
  }
}

TEST_F(OptionsTest, RefusesOptionsInTheFormatOfTheLog) {
  const std::string file = Write("m.conf", "data-dir = d\nlog-format = json\n");
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"--config", file, "--max-batch", "0"},
                                             {"--config", file, "--listen", "127.0.0.1"},
                                             {"--log-format", "json", "--max-bach", "1"},
                                             {"--log-format=json", "--config", folder_ / "none"}}) {
    const Outcome outcome = Parse(arguments);
    EXPECT_TRUE(outcome.refused());
    EXPECT_THAT(outcome.err,
                AllOf(StartsWith(R"({"time":")"), HasSubstr(R"("level":"error")"),
                      HasSubstr(R"("message":"cannot serve","reason":")"), EndsWith("\"}\n")));
  }
  const Outcome text = Parse({"--config", file, "--log-format", "text", "--max-batch", "0"});
  EXPECT_THAT(text.err, HasSubstr("--max-batch: Value 0"));
  EXPECT_THAT(text.err, StartsWith("maneuverd: "));
  monitoring::ConfigureLogging(monitoring::LogFormat::kText, monitoring::LogLevel::kInfo);
}

}  // namespace
}  // namespace maneuver::options_test
