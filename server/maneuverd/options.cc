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

std::chrono::nanoseconds Milliseconds(double milliseconds) {
  return std::chrono::nanoseconds(std::llround(milliseconds * 1e6));
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

struct SecurityFlags {
  security::CertificateFiles tls;
  int max_message_mib = 64;
  int64_t max_idle_s = 900;
  int64_t max_age_s = 3600;
  int64_t handshake_s = 10;
  int64_t keepalive_s = 60;
  int64_t request_s = 300;
  bool insecure = false;
};

void AddSecurityFlags(CLI::App& app, SecurityFlags* flags, ServerOptions* options) {
  app.add_option("--tls-certificate", flags->tls.certificate,
                 "Serve over TLS with this certificate, PEM; reloaded when it changes");
  app.add_option("--tls-key", flags->tls.key, "The certificate's private key, PEM");
  app.add_option("--tls-client-ca", flags->tls.client_ca,
                 "Require client certificates of this authority, PEM (mutual TLS)");
  app.add_option(
      "--tokens", options->access.identities,
      "File of callers by token or client certificate, with lines as \"maneuverd token create\" "
      "writes them; reloaded when it changes. Without it every caller may do everything");
  app.add_flag("--insecure", flags->insecure, "Allow listening beyond loopback in plain text");
  app.add_option("--rate-limit", options->access.calls_per_second,
                 "Most calls a second of each client; 0: any number")
      ->check(FiniteRange(0.0, 1e9))
      ->capture_default_str();
  app.add_option("--rate-limit-targets", options->access.targets_per_second,
                 "Most targets a second of each client; 0: any number")
      ->check(FiniteRange(0.0, 1e9))
      ->capture_default_str();
  app.add_option("--max-message", flags->max_message_mib, "Largest message accepted, MiB")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--max-connections", options->limits.max_connections,
                 "Most connections; if there are more, the newest are closed")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--max-streams", options->limits.max_streams,
                 "Most calls at once on one connection")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--max-connection-idle", flags->max_idle_s,
                 "Close a connection after this many seconds without a call")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--max-connection-age", flags->max_age_s,
                 "Stop new calls on a connection after this many seconds; calls in flight continue")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--handshake-timeout", flags->handshake_s,
                 "Close a connection whose handshake takes more seconds than this")
      ->check(CLI::Range(1, 3600))
      ->capture_default_str();
  app.add_option("--keepalive", flags->keepalive_s,
                 "Ping a connection after this many seconds of silence, and close it if it does "
                 "not answer within a third of that")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  app.add_option(
         "--request-timeout", flags->request_s,
         "Refuse a request that takes more seconds than this to arrive; streams may take any "
         "time")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  app.add_option("--max-receive-memory", options->limits.max_receive_bytes,
                 "Most memory for incomplete messages of all connections, such as 1GiB; above it "
                 "calls are broken off")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
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

// Returns FAILED_PRECONDITION for flags that make no sense together.
absl::Status TakeSecurityFlags(const SecurityFlags& flags, ServerOptions* options) {
  const security::CertificateFiles& tls = flags.tls;
  if (tls.certificate.empty() != tls.key.empty()) {
    return absl::FailedPreconditionError(
        "--tls-certificate and --tls-key need each other: name both files or neither");
  }
  if (!tls.client_ca.empty() && tls.certificate.empty()) {
    return absl::FailedPreconditionError(
        "--tls-client-ca needs TLS: name --tls-certificate and --tls-key as well");
  }
  if (!tls.client_ca.empty() && options->access.identities.empty()) {
    return absl::FailedPreconditionError(
        "--tls-client-ca needs --tokens FILE, which says what each certificate may do, in lines "
        "such as: planner predict cn:planner");
  }
  if (!tls.certificate.empty()) options->tls = tls;
  options->limits.max_message_bytes = flags.max_message_mib << 20;
  options->limits.max_idle = std::chrono::seconds(flags.max_idle_s);
  options->limits.max_age = std::chrono::seconds(flags.max_age_s);
  options->limits.handshake = std::chrono::seconds(flags.handshake_s);
  options->limits.keepalive = std::chrono::seconds(flags.keepalive_s);
  options->limits.request = std::chrono::seconds(flags.request_s);
  if (options->limits.max_receive_bytes < 2 * int64_t{options->limits.max_message_bytes}) {
    return absl::FailedPreconditionError(
        "--max-receive-memory must be at least twice --max-message: raise the former or lower the "
        "latter");
  }
  return absl::OkStatus();
}

}  // namespace

std::variant<ServerOptions, int> ParseCommandLine(int argc, const char* const* argv,
                                                  const char* const* environment,
                                                  bool needs_data_dir) {
  ServerOptions options;
  std::string listen = "127.0.0.1:8470";
  std::string metrics_listen = "127.0.0.1:9470";
  int workers = machine::UsableCores();
  double max_queue_delay_ms = 0.0;
  double shutdown_delay_s = 0.0;
  double shutdown_timeout_s = 10.0;
  std::string dataset_folders;
  std::string serve;
  std::string role = "all";
  std::string precision = "auto";
  std::string kernel_choice = "auto";
  std::string log_format = "text";
  std::string log_level = "info";
  SecurityFlags security_flags;
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
  app.add_option("--data-dir", options.data_dir, "Folder of models, datasets and jobs")
      ->required(needs_data_dir);
  app.add_option("--store", options.store,
                 "Database of jobs and aliases, such as "
                 "postgresql://maneuver@db.example/maneuver?sslmode=verify-full, made by "
                 "\"maneuverd store migrate\"; without it they are in the data folder");
  app.add_flag("--shared", options.is_shared,
               "Share the data folder and the database of --store with other servers, which are "
               "shared too");
  app.add_option("--role", role,
                 "What this server is for, of several that share: serve answers predictions, work "
                 "runs jobs, all does both, api neither; each answers all other calls")
      ->check(CLI::IsMember(kRoles))
      ->capture_default_str();
  app.add_option("--replica-name", options.replica_name,
                 "Name that \"maneuver model show\" gives to this server, of several that share; "
                 "without it the name of the machine");
  app.add_option("--listen", listen, "HOST:PORT for gRPC; port 0 picks a free one")
      ->capture_default_str();
  app.add_option(
         "--metrics-listen", metrics_listen,
         "HOST:PORT for HTTP: /metrics for Prometheus, /healthz and /readyz for probes; port 0 "
         "picks a free one; \"none\" for none of them")
      ->capture_default_str();
  AddSecurityFlags(app, &security_flags, &options);
  app.add_option("--port-file", options.port_file,
                 "Write the addresses that the server listens on to this file, as JSON");
  app.add_option("--workers", workers, "Threads that evaluate the model")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--max-batch", options.scheduler.queue.max_batch, "Most targets in a batch")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--max-queue-delay", max_queue_delay_ms,
                 "Milliseconds that a batch below --max-batch waits for more targets")
      ->check(FiniteRange(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--max-queue", options.scheduler.queue.max_queue,
                 "Most waiting targets of each priority; above it calls are refused")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--max-queue-bytes", options.scheduler.queue.max_queue_bytes,
                 "Most bytes of waiting requests of each priority, such as 256MiB")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option(
         "--max-response-bytes", options.sends.max_response_bytes,
         "Most bytes of one answer, such as 256MiB; calls whose answer is larger are refused, "
         "and prediction calls whose answer could be")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--max-send-memory", options.sends.max_send_memory,
                 "Most bytes of all answers that callers have not read yet, such as 1GiB; above it "
                 "calls are refused, except those that stop or remove something")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--memory-limit", options.memory_limit,
                 "Most memory of the server, without its jobs, such as 512MiB; near it calls are "
                 "refused, and the limits of its buffers are lowered to parts of it; 0: any")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--max-maps", options.maps.max_maps,
                 "Most registered maps; the least recently used one is dropped first")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--max-map-bytes", options.maps.max_bytes,
                 "Most memory of registered maps, such as 256MiB")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--shadow-fraction", options.shadow.fraction,
                 "Share of the requests, 0 to 1, that the alias candidate answers too, after the "
                 "caller has its answer; metrics show how far both answers differ")
      ->check(FiniteRange(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--outcome-memory", options.outcome_memory,
                 "Most memory of answers that are kept so that their outcomes can be reported by "
                 "the scenario's id, such as 64MiB; the oldest are dropped first; 0: keep none")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--outcome-recordings", options.outcome_recordings,
                 "Most disk space of reported outcomes that are kept for a dataset, such as 1GiB: "
                 "the most surprising ones, and a sample of the others; 0: keep none")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--dataset-quota", options.datasets.quota_bytes,
                 "Most bytes of all datasets together, such as 50GiB; 0: no limit but the disk")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--dataset-folders", dataset_folders,
                 "Folders, such as /data/town,/mnt/waymo, that administrators may register as "
                 "datasets in place, with all that is below them; without it none");
  app.add_option_function<double>(
         "--keep-uploads",
         [&options](double hours) {
           options.datasets.keep_uploads = std::chrono::seconds(std::llround(3600.0 * hours));
         },
         "Hours to keep an interrupted upload after its last byte; 0: for ever")
      ->check(FiniteRange(0.0, 1e5))
      ->default_str("24");
  app.add_option("--serve", serve,
                 "Versions of models, such as town/3,highway/2, that get the alias serving when "
                 "the server starts; without it the alias stays as it was");
  app.add_option("--precision", precision,
                 "Precision of the engine; auto: bf16 if the processor has it, else f32")
      ->check(CLI::IsMember(kPrecisions))
      ->capture_default_str();
  app.add_option(
         "--kernels", kernel_choice,
         "Vector code of server and jobs; auto: the processor's best; plain: none, slow, to "
         "rule it out in an incident")
      ->check(CLI::IsMember(kKernels))
      ->capture_default_str();
  AddJobOptions(app, options.jobs);
  app.add_option("--log-format", log_format, "Format of the log on standard error")
      ->check(CLI::IsMember(kLogFormats))
      ->capture_default_str();
  app.add_option("--log-level", log_level, "Lowest level that is logged")
      ->check(CLI::IsMember(kLogLevels))
      ->capture_default_str();
  app.add_option("--shutdown-delay", shutdown_delay_s,
                 "Seconds after SIGTERM in which new calls are still accepted while health says "
                 "NOT_SERVING; set it to the time that a balancer takes to notice")
      ->check(FiniteRange(0.0, 3600.0))
      ->capture_default_str();
  app.add_option("--shutdown-timeout", shutdown_timeout_s,
                 "Seconds after --shutdown-delay for calls in flight to finish")
      ->check(FiniteRange(0.0, 3600.0))
      ->capture_default_str();
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

  options.scheduler.workers = workers;
  options.scheduler.queue.max_queue_delay = Milliseconds(max_queue_delay_ms);
  options.shutdown_delay =
      std::chrono::duration_cast<std::chrono::milliseconds>(Milliseconds(shutdown_delay_s * 1e3));
  options.shutdown_timeout =
      std::chrono::duration_cast<std::chrono::milliseconds>(Milliseconds(shutdown_timeout_s * 1e3));
  options.engine.precision = kPrecisions.at(precision);
  options.kernels = kKernels.at(kernel_choice);
  options.log_format = kLogFormats.at(log_format);
  options.log_level = kLogLevels.at(log_level);

  const auto refuse = [&](const char* flag, const absl::Status& status) {
    return RefuseOptions(line, configuration->WithSource(flag + std::string(status.message())));
  };
  if (const auto status = TakeSecurityFlags(security_flags, &options); !status.ok()) {
    return refuse("", status);
  }
  const bool insecure = security_flags.insecure;
  auto address = ParseExposed(listen, options.tls.has_value(), insecure);
  if (!address.ok()) return refuse("--listen: ", address.status());
  options.listen = *std::move(address);
  if (metrics_listen != "none") {
    // The metrics page knows no TLS.
    auto metrics_address = ParseExposed(metrics_listen, /*encrypted=*/false, insecure);
    if (!metrics_address.ok()) return refuse("--metrics-listen: ", metrics_address.status());
    options.metrics_listen = *std::move(metrics_address);
  }
  if (options.memory_limit > 0 && options.memory_limit < kLeastMemoryLimit) {
    return refuse("", absl::FailedPreconditionError(absl::StrCat(
                          "--memory-limit is less than the server takes by itself: name at least ",
                          kLeastMemoryLimit >> 20, "MiB, or 0 for no limit")));
  }
  FitBuffers(options);
  if (options.sends.max_send_memory < options.sends.max_response_bytes) {
    return refuse("", absl::FailedPreconditionError(
                          "--max-send-memory must be at least --max-response-bytes: raise the "
                          "former or lower the latter"));
  }
  if (const auto status = store::CheckStoreAddress(options.store); !status.ok()) {
    return refuse("--store: ", status);
  }
  if (options.is_shared && options.store.empty()) {
    return refuse("", absl::FailedPreconditionError(
                          "--shared needs --store: the servers agree by its database"));
  }
  options.role = kRoles.at(role);
  if (options.role != Role::kAll && !options.is_shared) {
    return refuse(
        "", absl::FailedPreconditionError(absl::StrCat(
                "--role ", role, " needs --shared: other servers do what this one leaves out")));
  }
  if (options.replica_name.empty()) options.replica_name = HostName();
  if (options.is_shared && options.outcome_recordings > 0) {
    return refuse("", absl::FailedPreconditionError(
                          "--outcome-recordings does not go with --shared: each outcome would be "
                          "with the server that it was reported to; collect them on a server of "
                          "its own"));
  }
  options.datasets.is_shared = options.is_shared;
  auto folders = ParseFolders(dataset_folders);
  if (!folders.ok()) return refuse("--dataset-folders: ", folders.status());
  options.datasets.folders = *std::move(folders);
  auto versions = ParseVersions(serve);
  if (!versions.ok()) return refuse("--serve: ", versions.status());
  options.serve = *std::move(versions);
  if (print_settings) {
    std::cout << PrintSettings(app);
    if (std::cout.flush()) return 0;
    std::cerr << "maneuverd: cannot write to standard output\n";
    return 1;
  }
  return options;
}

}  // namespace maneuver
