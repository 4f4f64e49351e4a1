#include "server/maneuverd/options.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "model/machine/usable_cores.h"
#include "server/jobs/trainer/number_checks.h"
#include "server/jobs/trainer/unknown_words.h"
#include "server/maneuverd/configuration.h"
#include "server/maneuverd/option_kinds.h"
#include "server/store/store_address.h"

namespace maneuver {
namespace {

constexpr int kUsageError = 2;
constexpr int64_t kLeastMemoryLimit = int64_t{64} << 20;  // with less, every call would be refused

const std::map<std::string, Role> kRoles = {
    {"all", Role::kAll}, {"api", Role::kApi}, {"serve", Role::kServe}, {"work", Role::kWork}};
const std::map<std::string, inference::Precision> kPrecisions = {
    {"auto", inference::Precision::kAuto},
    {"bf16", inference::Precision::kBf16},
    {"f32", inference::Precision::kF32}};
const std::map<std::string, kernels::KernelChoice> kKernels = {
    {"auto", kernels::KernelChoice::kAuto}, {"plain", kernels::KernelChoice::kPlain}};
const std::map<std::string, monitoring::LogFormat> kLogFormats = {
    {"text", monitoring::LogFormat::kText}, {"json", monitoring::LogFormat::kJson}};
const std::map<std::string, monitoring::LogLevel> kLogLevels = {
    {"debug", monitoring::LogLevel::kDebug},
    {"info", monitoring::LogLevel::kInfo},
    {"warning", monitoring::LogLevel::kWarning},
    {"error", monitoring::LogLevel::kError}};

std::string HostName() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

std::filesystem::path BesideThisProgram(const char* name) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? std::filesystem::path(name) : self.parent_path() / name;
}

absl::StatusOr<security::ListenAddress> ParseExposed(const std::string& text, bool encrypted,
                                                     bool insecure) {
  auto address = security::ParseListenAddress(text);
  if (!address.ok()) return address.status();
  const auto status = security::CheckExposure(*address, encrypted, insecure);
  if (!status.ok()) return status;
  return address;
}

bool AsksForHelp(const std::vector<std::string>& arguments) {
  return std::ranges::any_of(arguments, [](const std::string& argument) {
    return argument == "--help" || argument == "-h" || argument == "--version";
  });
}

bool AsksForJson(const std::vector<std::string>& line) {
  constexpr std::string_view kOption = "--log-format";
  bool json = false;
  for (size_t i = 0; i < line.size(); ++i) {
    if (line[i] == kOption && i + 1 < line.size()) json = line[i + 1] == "json";
    if (absl::StartsWith(line[i], "--log-format=")) json = line[i].ends_with("=json");
  }
  return json;
}

// Says what is wrong with the options, as `line` wants its log: text, or a line of JSON. Returns
// the exit status.
//   hint: follows the error in text alone.
int RefuseOptions(const std::vector<std::string>& line, const std::string& error,
                  std::string_view hint = "") {
  if (AsksForJson(line)) {
    monitoring::ConfigureLogging(monitoring::LogFormat::kJson, monitoring::LogLevel::kInfo);
    Log(monitoring::LogLevel::kError, "cannot serve", {{"reason", error}});
  } else {
    std::cerr << "maneuverd: " << error << hint << "\n";
  }
  return kUsageError;
}

// What is checked and converted once the whole command line is read.
struct RawOptions {
  std::string listen = "127.0.0.1:8470";
  std::string metrics_listen = "127.0.0.1:9470";
  security::CertificateFiles tls;
  bool insecure = false;
  std::string dataset_folders;
  std::string serve;
};

// Parsing writes to `raw` and `options`: both must live until then. So with the functions below.
void AddPlaceOptions(CLI::App& app, ServerOptions& options, bool needs_data_dir) {
  app.add_option("--data-dir", options.data_dir, "Folder of models, datasets and jobs")
      ->required(needs_data_dir);
  app.add_option("--store", options.store,
                 "Database of jobs and aliases, such as "
                 "postgresql://maneuver@db.example/maneuver?sslmode=verify-full, made by "
                 "\"maneuverd store migrate\"; without it they are in the data folder");
  app.add_flag("--shared", options.is_shared,
               "Share the data folder and the database of --store with other servers, which are "
               "shared too");
  AddChoice(app, "--role", kRoles, "all", options.role,
            "What this server is for, of several that share: serve answers predictions, work "
            "runs jobs, all does both, api neither; each answers all other calls");
  app.add_option("--replica-name", options.replica_name,
                 "Name that \"maneuver model show\" gives to this server, of several that share; "
                 "without it the name of the machine");
}

void AddSecurityOptions(CLI::App& app, RawOptions& raw, ServerOptions& options) {
  app.add_option("--listen", raw.listen, "HOST:PORT for gRPC; port 0 picks a free one")
      ->capture_default_str();
  app.add_option(
         "--metrics-listen", raw.metrics_listen,
         "HOST:PORT for HTTP: /metrics for Prometheus, /healthz and /readyz for probes; port 0 "
         "picks a free one; \"none\" for none of them")
      ->capture_default_str();
  app.add_option("--tls-certificate", raw.tls.certificate,
                 "Serve over TLS with this certificate, PEM; reloaded when it changes");
  app.add_option("--tls-key", raw.tls.key, "The certificate's private key, PEM");
  app.add_option("--tls-client-ca", raw.tls.client_ca,
                 "Require client certificates of this authority, PEM (mutual TLS)");
  app.add_option(
      "--tokens", options.access.identities,
      "File of callers by token or client certificate, with lines as \"maneuverd token create\" "
      "writes them; reloaded when it changes. Without it every caller may do everything");
  app.add_flag("--insecure", raw.insecure, "Allow listening beyond loopback in plain text");
  app.add_option("--rate-limit", options.access.calls_per_second,
                 "Most calls a second of each client; 0: any number")
      ->check(FiniteRange(0.0, 1e9))
      ->capture_default_str();
  app.add_option("--rate-limit-targets", options.access.targets_per_second,
                 "Most targets a second of each client; 0: any number")
      ->check(FiniteRange(0.0, 1e9))
      ->capture_default_str();
}

void AddConnectionOptions(CLI::App& app, rpc::ConnectionLimits& limits) {
  AddScaled<int>(app, "--max-message", "64", CLI::Range(1, 1024), "Largest message accepted, MiB",
                 [&limits](int mebibytes) { limits.max_message_bytes = mebibytes << 20; });
  app.add_option("--max-connections", limits.max_connections,
                 "Most connections; if there are more, the newest are closed")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--max-streams", limits.max_streams, "Most calls at once on one connection")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  const auto add_seconds = [&app](const char* name, std::chrono::seconds& value, int most,
                                  const char* help) {
    AddScaled<int64_t>(app, name, std::to_string(value.count()), CLI::Range(1, most), help,
                       [&value](int64_t seconds) { value = std::chrono::seconds(seconds); });
  };
  add_seconds("--max-connection-idle", limits.max_idle, 1'000'000,
              "Close a connection after this many seconds without a call");
  add_seconds("--max-connection-age", limits.max_age, 1'000'000,
              "Stop new calls on a connection after this many seconds; calls in flight continue");
  add_seconds("--handshake-timeout", limits.handshake, 3600,
              "Close a connection whose handshake takes more seconds than this");
  add_seconds("--keepalive", limits.keepalive, 100'000,
              "Ping a connection after this many seconds of silence, and close it if it does "
              "not answer within a third of that");
  add_seconds("--request-timeout", limits.request, 100'000,
              "Refuse a request that takes more seconds than this to arrive; streams may take any "
              "time");
  AddBytes(app, "--max-receive-memory", limits.max_receive_bytes,
           "Most memory for incomplete messages of all connections, such as 1GiB; above it "
           "calls are broken off");
}

void AddSchedulerOptions(CLI::App& app, serving::SchedulerOptions& scheduler) {
  app.add_option("--workers", scheduler.workers, "Threads that evaluate the model")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--max-batch", scheduler.queue.max_batch, "Most targets in a batch")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  AddScaled<double>(app, "--max-queue-delay", "0", FiniteRange(0.0, 1000.0),
                    "Milliseconds that a batch below --max-batch waits for more targets",
                    [&queue = scheduler.queue](double milliseconds) {
                      queue.max_queue_delay =
                          std::chrono::nanoseconds(std::llround(milliseconds * 1e6));
                    });
  app.add_option("--max-queue", scheduler.queue.max_queue,
                 "Most waiting targets of each priority; above it calls are refused")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  AddBytes(app, "--max-queue-bytes", scheduler.queue.max_queue_bytes,
           "Most bytes of waiting requests of each priority, such as 256MiB");
}

void AddMemoryOptions(CLI::App& app, ServerOptions& options) {
  AddBytes(app, "--max-response-bytes", options.sends.max_response_bytes,
           "Most bytes of one answer, such as 256MiB; calls whose answer is larger are refused, "
           "and prediction calls whose answer could be");
  AddBytes(app, "--max-send-memory", options.sends.max_send_memory,
           "Most bytes of all answers that callers have not read yet, such as 1GiB; above it "
           "calls are refused, except those that stop or remove something");
  AddBytes(app, "--memory-limit", options.memory_limit,
           "Most memory of the server, without its jobs, such as 512MiB; near it calls are "
           "refused, and the limits of its buffers are lowered to parts of it; 0: any",
           Least::kZero);
  app.add_option("--max-maps", options.maps.max_maps,
                 "Most registered maps; the least recently used one is dropped first")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  AddBytes(app, "--max-map-bytes", options.maps.max_bytes,
           "Most memory of registered maps, such as 256MiB");
}

void AddOutcomeOptions(CLI::App& app, ServerOptions& options) {
  app.add_option("--shadow-fraction", options.shadow.fraction,
                 "Share of the requests, 0 to 1, that the alias candidate answers too, after the "
                 "caller has its answer; metrics show how far both answers differ")
      ->check(FiniteRange(0.0, 1.0))
      ->capture_default_str();
  AddBytes(app, "--outcome-memory", options.outcome_memory,
           "Most memory of answers that are kept so that their outcomes can be reported by "
           "the scenario's id, such as 64MiB; the oldest are dropped first; 0: keep none",
           Least::kZero);
  AddBytes(app, "--outcome-recordings", options.outcome_recordings,
           "Most disk space of reported outcomes that are kept for a dataset, such as 1GiB: "
           "the most surprising ones, and a sample of the others; 0: keep none",
           Least::kZero);
}

void AddDatasetOptions(CLI::App& app, RawOptions& raw, data::DatasetStoreOptions& datasets) {
  AddBytes(app, "--dataset-quota", datasets.quota_bytes,
           "Most bytes of all datasets together, such as 50GiB; 0: no limit but the disk",
           Least::kZero);
  app.add_option("--dataset-folders", raw.dataset_folders,
                 "Folders, such as /data/town,/mnt/waymo, that administrators may register as "
                 "datasets in place, with all that is below them; without it none");
  AddScaled<double>(app, "--keep-uploads", "24", FiniteRange(0.0, 1e5),
                    "Hours to keep an interrupted upload after its last byte; 0: for ever",
                    [&datasets](double hours) {
                      datasets.keep_uploads = std::chrono::seconds(std::llround(3600.0 * hours));
                    });
}

void AddModelOptions(CLI::App& app, RawOptions& raw, ServerOptions& options) {
  app.add_option("--serve", raw.serve,
                 "Versions of models, such as town/3,highway/2, that get the alias serving when "
                 "the server starts; without it the alias stays as it was");
  AddChoice(app, "--precision", kPrecisions, "auto", options.engine.precision,
            "Precision of the engine; auto: bf16 if the processor has it, else f32");
  AddChoice(app, "--kernels", kKernels, "auto", options.kernels,
            "Vector code of server and jobs; auto: the processor's best; plain: none, slow, to "
            "rule it out in an incident");
}

void AddLogAndShutdownOptions(CLI::App& app, ServerOptions& options) {
  AddChoice(app, "--log-format", kLogFormats, "text", options.log_format,
            "Format of the log on standard error");
  AddChoice(app, "--log-level", kLogLevels, "info", options.log_level,
            "Lowest level that is logged");
  AddScaled<double>(app, "--shutdown-delay", "0", FiniteRange(0.0, 3600.0),
                    "Seconds after SIGTERM in which new calls are still accepted while health says "
                    "NOT_SERVING; set it to the time that a balancer takes to notice",
                    [&options](double seconds) { options.shutdown_delay = Seconds(seconds); });
  AddScaled<double>(app, "--shutdown-timeout", "10", FiniteRange(0.0, 3600.0),
                    "Seconds after --shutdown-delay for calls in flight to finish",
                    [&options](double seconds) { options.shutdown_timeout = Seconds(seconds); });
}

// "town/3,highway/2"; INVALID_ARGUMENT for anything else.
absl::StatusOr<std::vector<security::ModelVersionName>> ParseVersions(const std::string& text) {
  std::vector<security::ModelVersionName> versions;
  for (const absl::string_view word : absl::StrSplit(text, ',', absl::SkipWhitespace())) {
    const std::vector<std::string> parts =
        absl::StrSplit(absl::StripAsciiWhitespace(word), absl::MaxSplits('/', 1));
    const int number = parts.size() == 2 ? security::ParseVersion(parts[1]) : 0;
    if (number == 0 || !security::IsResourceId(parts[0])) {
      return absl::InvalidArgumentError(
          absl::StrCat(text, " does not name versions of models, such as town/3,highway/2"));
    }
    versions.push_back({parts[0], number});
  }
  return versions;
}

// "/data/town,/mnt/waymo"; INVALID_ARGUMENT for a path that is not absolute.
absl::StatusOr<std::vector<std::filesystem::path>> ParseFolders(const std::string& text) {
  std::vector<std::filesystem::path> folders;
  for (const absl::string_view word : absl::StrSplit(text, ',', absl::SkipWhitespace())) {
    const std::string folder(absl::StripAsciiWhitespace(word));
    if (!folder.starts_with('/')) {
      return absl::InvalidArgumentError(absl::StrCat(folder, " is not an absolute path"));
    }
    folders.emplace_back(folder);
  }
  return folders;
}

// The error of what an option names.
absl::Status WithOption(const char* name, const absl::Status& status) {
  return {status.code(), absl::StrCat(name, ": ", status.message())};
}

// Lowers the limits of the buffers to their parts of the memory limit. Together, with what an answer
// takes while it is written (three times its size), they may fill half of it. The exception is
// gRPC's own limit of what it receives: rpc::MessageGate keeps single requests far below it, and
// above it gRPC breaks off calls of innocent clients.
void FitBuffers(ServerOptions& options) {
  const int64_t limit = options.memory_limit;
  const auto fit = [limit](int parts, auto& buffer) {
    buffer = static_cast<std::remove_reference_t<decltype(buffer)>>(
        serving::ShareOf(limit, parts, static_cast<int64_t>(buffer)));
  };
  fit(4, options.limits.max_receive_bytes);
  fit(32, options.limits.max_message_bytes);
  fit(16, options.sends.max_send_memory);
  fit(16, options.sends.max_response_bytes);
  fit(16, options.scheduler.queue.max_queue_bytes);
  fit(16, options.maps.max_bytes);
}

// Takes the certificates. Errors name the option, here and below.
absl::Status TakeCertificates(const RawOptions& raw, ServerOptions& options) {
  const security::CertificateFiles& tls = raw.tls;
  if (tls.certificate.empty() != tls.key.empty()) {
    return absl::FailedPreconditionError(
        "--tls-certificate and --tls-key need each other: name both files or neither");
  }
  if (!tls.client_ca.empty() && tls.certificate.empty()) {
    return absl::FailedPreconditionError(
        "--tls-client-ca needs TLS: name --tls-certificate and --tls-key as well");
  }
  if (!tls.client_ca.empty() && options.access.identities.empty()) {
    return absl::FailedPreconditionError(
        "--tls-client-ca needs --tokens FILE, which says what each certificate may do, in lines "
        "such as: planner predict cn:planner");
  }
  if (!tls.certificate.empty()) options.tls = tls;
  return absl::OkStatus();
}

absl::Status CheckLimits(const ServerOptions& options) {
  if (options.limits.max_receive_bytes < 2 * int64_t{options.limits.max_message_bytes}) {
    return absl::FailedPreconditionError(
        "--max-receive-memory must be at least twice --max-message: raise the former or lower the "
        "latter");
  }
  return absl::OkStatus();
}

absl::Status TakeAddresses(const RawOptions& raw, ServerOptions& options) {
  auto address = ParseExposed(raw.listen, options.tls.has_value(), raw.insecure);
  if (!address.ok()) return WithOption("--listen", address.status());
  options.listen = *std::move(address);
  if (raw.metrics_listen == "none") return absl::OkStatus();
  // The metrics page knows no TLS.
  auto metrics_address = ParseExposed(raw.metrics_listen, /*encrypted=*/false, raw.insecure);
  if (!metrics_address.ok()) return WithOption("--metrics-listen", metrics_address.status());
  options.metrics_listen = *std::move(metrics_address);
  return absl::OkStatus();
}

absl::Status FitMemory(ServerOptions& options) {
  if (options.memory_limit > 0 && options.memory_limit < kLeastMemoryLimit) {
    return absl::FailedPreconditionError(
        absl::StrCat("--memory-limit is less than the server takes by itself: name at least ",
                     kLeastMemoryLimit >> 20, "MiB, or 0 for no limit"));
  }
  FitBuffers(options);
  if (options.sends.max_send_memory < options.sends.max_response_bytes) {
    return absl::FailedPreconditionError(
        "--max-send-memory must be at least --max-response-bytes: raise the former or lower the "
        "latter");
  }
  return absl::OkStatus();
}

absl::Status CheckSharing(const ServerOptions& options) {
  if (const auto status = store::CheckStoreAddress(options.store); !status.ok()) {
    return WithOption("--store", status);
  }
  if (options.is_shared && options.store.empty()) {
    return absl::FailedPreconditionError(
        "--shared needs --store: the servers agree by its database");
  }
  if (options.role != Role::kAll && !options.is_shared) {
    return absl::FailedPreconditionError(
        absl::StrCat("--role ", std::string(RoleName(options.role)),
                     " needs --shared: other servers do what this one leaves out"));
  }
  if (options.is_shared && options.outcome_recordings > 0) {
    return absl::FailedPreconditionError(
        "--outcome-recordings does not go with --shared: each outcome would be with the server "
        "that it was reported to; collect them on a server of its own");
  }
  return absl::OkStatus();
}

// Checks what was parsed, and completes `options`.
absl::Status Complete(const RawOptions& raw, ServerOptions& options) {
  if (const auto status = TakeCertificates(raw, options); !status.ok()) return status;
  if (const auto status = CheckLimits(options); !status.ok()) return status;
  if (const auto status = TakeAddresses(raw, options); !status.ok()) return status;
  if (const auto status = FitMemory(options); !status.ok()) return status;
  if (const auto status = CheckSharing(options); !status.ok()) return status;
  if (options.replica_name.empty()) options.replica_name = HostName();
  options.datasets.is_shared = options.is_shared;
  auto folders = ParseFolders(raw.dataset_folders);
  if (!folders.ok()) return WithOption("--dataset-folders", folders.status());
  options.datasets.folders = *std::move(folders);
  auto versions = ParseVersions(raw.serve);
  if (!versions.ok()) return WithOption("--serve", versions.status());
  options.serve = *std::move(versions);
  return absl::OkStatus();
}

}  // namespace

std::variant<ServerOptions, int> ParseCommandLine(int argc, const char* const* argv,
                                                  const char* const* environment,
                                                  bool needs_data_dir) {
  ServerOptions options;
  RawOptions raw;
  options.scheduler.workers = machine::UsableCores();
  options.jobs.trainer = BesideThisProgram("maneuver-trainer");

  CLI::App app(
      "maneuverd predicts what drivers do next. It answers over gRPC and trains models on request.",
      "maneuverd");
  app.footer(
      "\nEvery option can also be an environment variable (--max-batch is MANEUVERD_MAX_BATCH) or "
      "a line\n"
      "of the file that --config names (max-batch = 32). The command line overrides the "
      "environment,\n"
      "which overrides the file.\n\n"
      "maneuverd token create, list and revoke manage the file of --tokens;\n"
      "maneuverd store migrate, check and copy manage the database of --store;\n"
      "maneuverd repair brings a damaged database of the data folder back;\n"
      "maneuverd health [SERVICE] [OPTIONS] asks the server with these options "
      "whether it is ready.");
  app.get_help_ptr()->configurable(false);
  app.set_version_flag("--version", MANEUVER_VERSION)->configurable(false);
  std::string configuration_file;
  bool print_settings = false;
  app.add_option("--config", configuration_file, "File with one option a line")
      ->configurable(false);
  app.add_flag("--print-config", print_settings,
               "Print the value of every option, as --config reads it, and exit")
      ->configurable(false);
  AddPlaceOptions(app, options, needs_data_dir);
  AddSecurityOptions(app, raw, options);
  AddConnectionOptions(app, options.limits);
  app.add_option("--port-file", options.port_file,
                 "Write the addresses that the server listens on to this file, as JSON");
  AddSchedulerOptions(app, options.scheduler);
  AddMemoryOptions(app, options);
  AddOutcomeOptions(app, options);
  AddDatasetOptions(app, raw, options.datasets);
  AddModelOptions(app, raw, options);
  AddJobOptions(app, options.jobs);
  AddLogAndShutdownOptions(app, options);
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  // Help is given even where the environment is wrong.
  const char* const no_environment = nullptr;
  const bool only_asks = AsksForHelp(arguments);
  const auto configuration =
      Configuration::Read(app, arguments, only_asks ? &no_environment : environment);
  if (!configuration.ok()) {
    return RefuseOptions(arguments, std::string(configuration.status().message()));
  }
  const std::vector<std::string> line = configuration->CommandLine();
  try {
    app.parse(std::vector<std::string>(line.rbegin(), line.rend()));  // as CLI11 wants it
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app.exit(error);
    const std::string unknown = UnknownWord(app);
    return RefuseOptions(line, configuration->WithSource(unknown.empty() ? error.what() : unknown),
                         "\nRun maneuverd --help for more information.");
  }

  if (const auto status = Complete(raw, options); !status.ok()) {
    return RefuseOptions(line, configuration->WithSource(std::string(status.message())));
  }
  if (print_settings) {
    std::cout << PrintSettings(app);
    if (std::cout.flush()) return 0;
    std::cerr << "maneuverd: cannot write to standard output\n";
    return 1;
  }
  return options;
}

}  // namespace maneuver
