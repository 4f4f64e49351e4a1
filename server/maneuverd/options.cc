#include "server/maneuverd/options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <string>
#include <thread>

namespace maneuver {
namespace {

constexpr int kUsageError = 2;

const std::map<std::string, inference::Precision> kPrecisions = {
    {"auto", inference::Precision::kAuto},
    {"bf16", inference::Precision::kBf16},
    {"f32", inference::Precision::kF32}};
const std::map<std::string, monitoring::LogFormat> kLogFormats = {
    {"text", monitoring::LogFormat::kText}, {"json", monitoring::LogFormat::kJson}};
const std::map<std::string, monitoring::LogLevel> kLogLevels = {
    {"debug", monitoring::LogLevel::kDebug},
    {"info", monitoring::LogLevel::kInfo},
    {"warning", monitoring::LogLevel::kWarning},
    {"error", monitoring::LogLevel::kError}};

std::filesystem::path BesideThisProgram(const char* name) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? std::filesystem::path(name) : self.parent_path() / name;
}

std::chrono::nanoseconds Milliseconds(double milliseconds) {
  return std::chrono::nanoseconds(std::llround(milliseconds * 1e6));
}

absl::StatusOr<security::ListenAddress> ParseExposed(const std::string& text, bool insecure) {
  auto address = security::ParseListenAddress(text);
  if (!address.ok()) return address.status();
  if (auto status = security::CheckExposure(*address, insecure); !status.ok()) return status;
  return address;
}

}  // namespace

std::variant<ServerOptions, int> ParseCommandLine(int argc, char** argv) {
  ServerOptions options;
  std::string listen = "127.0.0.1:8470";
  std::string metrics_listen = "127.0.0.1:9470";
  int workers = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  double max_queue_delay_ms = 0.0;
  double shutdown_timeout_s = 10.0;
  std::string precision = "auto";
  std::string log_format = "text";
  std::string log_level = "info";
  bool insecure = false;
  options.jobs.trainer = BesideThisProgram("maneuver-trainer");

  CLI::App app("maneuverd: predicts what drivers do next. Answers over gRPC, learns on request.");
  app.set_version_flag("--version", MANEUVER_VERSION);
  app.add_option("--data-dir", options.data_dir, "Folder of models, datasets and jobs")->required();
  app.add_option("--listen", listen, "HOST:PORT for gRPC; port 0 picks a free one")
      ->capture_default_str();
  app.add_option(
         "--metrics-listen", metrics_listen,
         "HOST:PORT for Prometheus, under /metrics; port 0 picks a free one; \"none\" for no "
         "metrics")
      ->capture_default_str();
  app.add_flag("--insecure", insecure,
               "Allow listening beyond loopback, without encryption or identity");
  app.add_option("--port-file", options.port_file,
                 "Write the addresses that it listens on to this file, as JSON");
  app.add_option("--workers", workers, "Threads that evaluate the model")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--max-batch", options.scheduler.queue.max_batch, "Most targets in a batch")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--max-queue-delay", max_queue_delay_ms,
                 "How long a batch that is not full waits for more, milliseconds")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--max-queue", options.scheduler.queue.max_queue,
                 "Most targets that wait; beyond them calls are refused")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--precision", precision, "Of the engine; auto: bf16 where the processor has it")
      ->check(CLI::IsMember(kPrecisions))
      ->capture_default_str();
  AddJobOptions(app, options.jobs);
  app.add_option("--log-format", log_format, "Of the lines on standard error")
      ->check(CLI::IsMember(kLogFormats))
      ->capture_default_str();
  app.add_option("--log-level", log_level, "Least level that is logged")
      ->check(CLI::IsMember(kLogLevels))
      ->capture_default_str();
  app.add_option("--shutdown-timeout", shutdown_timeout_s,
                 "After SIGTERM, how long calls in flight may take, seconds")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;
  }

  options.scheduler.workers = workers;
  options.scheduler.queue.max_queue_delay = Milliseconds(max_queue_delay_ms);
  options.shutdown_timeout =
      std::chrono::duration_cast<std::chrono::milliseconds>(Milliseconds(shutdown_timeout_s * 1e3));
  options.engine.precision = kPrecisions.at(precision);
  options.log_format = kLogFormats.at(log_format);
  options.log_level = kLogLevels.at(log_level);

  const auto refuse = [](const char* flag, const absl::Status& status) {
    std::cerr << "maneuverd: " << flag << ": " << status.message() << "\n";
    return kUsageError;
  };
  auto address = ParseExposed(listen, insecure);
  if (!address.ok()) return refuse("--listen", address.status());
  options.listen = *std::move(address);
  if (metrics_listen != "none") {
    auto metrics_address = ParseExposed(metrics_listen, insecure);
    if (!metrics_address.ok()) return refuse("--metrics-listen", metrics_address.status());
    options.metrics_listen = *std::move(metrics_address);
  }
  return options;
}

}  // namespace maneuver
