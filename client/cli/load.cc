// maneuver load: how much can the server take, and how long do callers wait?

#include <algorithm>
#include <cmath>
#include <memory>
#include <ostream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/interrupt.h"
#include "client/cli/json_files.h"
#include "client/cli/load_arguments.h"
#include "client/cli/load_report.h"
#include "client/cli/load_scenes.h"
#include "client/cli/priority_option.h"
#include "client/cli/progress_line.h"
#include "client/cli/resource_names.h"
#include "client/cli/scenario_source.h"
#include "client/cli/text_format.h"
#include "client/error_details.h"
#include "client/load/metrics_page.h"
#include "client/load/request_mix.h"
#include "client/load/server_callee.h"
#include "client/map_reuse.h"

namespace maneuver::cli {
namespace {

constexpr int64_t kCallers = 32;  // without --concurrency

struct LoadArguments {
  std::vector<std::string> files;
  std::string dataset;
  int64_t scenes = 32;
  std::string model;
  std::string method = "predict";
  std::string targets = "1";
  std::string priority = "interactive";
  bool register_maps = false;
  std::vector<int64_t> actions;
  std::optional<double> min_probability;
  std::optional<int64_t> top_k;

  std::optional<double> rate;
  std::string arrival = "poisson";
  std::optional<int64_t> concurrency;
  std::string rates;
  std::optional<std::string> deadline;
  double warm_up = 2.0;
  double duration = 10.0;
  std::optional<int64_t> calls;
  int64_t seed = 1;

  int64_t connections = 4;
  bool retry = false;
  bool send_all = false;
  int64_t max_in_flight = 10'000;
  std::string metrics;
  std::string json;
  bool markdown = false;
};

std::chrono::nanoseconds Nanoseconds(double seconds) {
  return std::chrono::nanoseconds(std::llround(seconds * 1e9));
}

v1::PredictRequest Pattern(const LoadArguments& arguments) {
  v1::PredictRequest pattern;
  pattern.set_model(ModelResource(arguments.model));
  pattern.set_priority(PriorityNamed(arguments.priority));
  v1::DistributionQuery& query = *pattern.mutable_query();
  for (const int64_t id : arguments.actions) {
    query.mutable_action_ids()->add_ids(static_cast<int32_t>(id));
  }
  if (arguments.top_k) query.set_top_k(static_cast<int32_t>(*arguments.top_k));
  if (arguments.min_probability) query.set_min_probability(*arguments.min_probability);
  return pattern;
}

client::PredictionMethod Method(const std::string& name) {
  if (name == "probability") return client::PredictionMethod::kPredictActionProbabilities;
  if (name == "distribution") return client::PredictionMethod::kPredictActionDistributions;
  return client::PredictionMethod::kPredict;
}

// What all steps have in common.
absl::StatusOr<load::LoadPlan> CommonPlan(const LoadArguments& arguments,
                                          const Environment& environment) {
  load::LoadPlan plan;
  plan.warm_up = Nanoseconds(arguments.warm_up);
  plan.duration = Nanoseconds(arguments.duration);
  plan.calls = arguments.calls;
  plan.max_in_flight = static_cast<int>(arguments.max_in_flight);
  plan.seed = static_cast<uint64_t>(arguments.seed);
  if (environment.timeout) plan.patience = Nanoseconds(*environment.timeout);
  if (arguments.deadline) {
    const auto range = ParseRange("--deadline", *arguments.deadline, 0.01, 1e7);
    if (!range.ok()) return range.status();
    plan.deadline = load::DeadlineRange{range->least, range->most};
  }
  return plan;
}

load::ArrivalProcess Arrival(const LoadArguments& arguments) {
  return arguments.arrival == "constant" ? load::ArrivalProcess::kConstant
                                         : load::ArrivalProcess::kPoisson;
}

bool MeasuresCapacity(const std::vector<SweepRate>& rates) {
  return std::ranges::any_of(rates, &SweepRate::of_capacity);
}

// Runs steps one after another and reports what there is, also when it is interrupted.
class LoadCommand {
 public:
  LoadCommand(const LoadArguments& arguments, Environment& environment)
      : arguments_(arguments), environment_(environment) {}

  int Run() {
    const auto plan = CommonPlan(arguments_, environment_);
    if (!plan.ok()) return Refuse(plan.status());
    const auto targets = ParseWholeRange("--targets", arguments_.targets, 1, 10'000);
    if (!targets.ok()) return Refuse(targets.status());
    if (!arguments_.metrics.empty()) {
      const absl::Status address = load::CheckMetricsAddress(arguments_.metrics);
      if (!address.ok()) return environment_.Refuse(absl::StrCat("--metrics: ", address.message()));
    }
    std::vector<SweepRate> rates;
    if (!arguments_.rates.empty()) {
      auto parsed = ParseRates(arguments_.rates);
      if (!parsed.ok()) return Refuse(parsed.status());
      rates = *std::move(parsed);
    }
    if (!rates.empty() && arguments_.concurrency && !MeasuresCapacity(rates)) {
      return environment_.Refuse(
          "--concurrency: no rate of --rates is a share of what callers get");
    }
    load::RequestMix mix;
    mix.least_targets = static_cast<int>(targets->least);
    mix.most_targets = static_cast<int>(targets->most);
    mix.seed = static_cast<uint64_t>(arguments_.seed);
    const auto scenes = ReadLoadScenes({.files = arguments_.files,
                                        .source = arguments_.dataset,
                                        .most = static_cast<int>(arguments_.scenes),
                                        .most_targets = mix.most_targets,
                                        .seed = mix.seed},
                                       environment_);
    if (!scenes.ok()) return FailToRead(scenes.status());
    absl::Status status = Prepare(*scenes, mix);
    if (status.ok()) status = Probe();
    if (status.ok()) status = Connect();
    if (!status.ok()) return environment_.FailCall(status);

    report_.server = environment_.server;
    {
      const Interrupt interrupt([this] { stop_.Cancel(); });
      status = RunSteps(*plan, rates);
    }
    report_.interrupted = stop_.cancelled();
    return Report(status);
  }

 private:
  int Refuse(const absl::Status& status) {
    return environment_.Refuse(std::string(status.message()));
  }

  // A file or folder that makes no sense is a wrong command line; an error of the server is not.
  int FailToRead(const absl::Status& status) {
    const bool is_wrong = absl::IsInvalidArgument(status) || absl::IsNotFound(status);
    return is_wrong && !IsOnServer(arguments_.dataset)
               ? Refuse(status)
               : FailAtSource(arguments_.dataset, status, environment_);
  }

  // Makes the requests. Errors: those of registering maps.
  absl::Status Prepare(const std::vector<v1::Scenario>& scenes, const load::RequestMix& mix) {
    std::vector<v1::PredictRequest> requests = load::MakeRequests(scenes, Pattern(arguments_), mix);
    if (arguments_.register_maps) {
      const absl::Status registered = RegisterMaps(scenes.size(), &requests);
      if (!registered.ok()) return registered;
    }
    first_ = requests.front();
    double targets_sum = 0.0;
    double bytes = 0.0;
    for (const v1::PredictRequest& request : requests) {
      requests_.emplace_back(request, Method(arguments_.method));
      bytes += static_cast<double>(requests_.back().bytes());
      for (const v1::Scenario& scene : request.scenarios()) targets_sum += scene.target_ids_size();
    }
    const auto count = static_cast<double>(requests.size());
    report_.requests = static_cast<int>(requests.size());
    report_.mean_targets = targets_sum / count;
    report_.mean_bytes = bytes / count;
    return absl::OkStatus();
  }

  // From here on the requests name their maps.
  absl::Status RegisterMaps(size_t most, std::vector<v1::PredictRequest>* requests) {
    client::MapReuse maps(environment_.server_client(), most);
    for (v1::PredictRequest& request : *requests) {
      const absl::Status named =
          maps.NameMaps(request.mutable_scenarios(), environment_.call_options());
      if (!named.ok()) return named;
    }
    return absl::OkStatus();
  }

  // Makes one call, so that an error of every call is told in words, not in a table. An overloaded
  // server is no error here.
  absl::Status Probe() {
    const auto answer = environment_.server_client().Predict(first_, environment_.call_options());
    if (absl::IsResourceExhausted(answer.status()) &&
        client::ErrorDetailsOf(answer.status()).retry_delay) {
      return absl::OkStatus();
    }
    if (!answer.ok()) return answer.status();
    const load::CallOutcome outcome = load::OutcomeOf(answer);
    if (outcome.targets > 0) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("the server refuses the request: ", outcome.refusal));
  }

  absl::Status Connect() {
    client::ClientOptions options = environment_.client_options();
    options.own_connection = true;
    options.retry_started = arguments_.retry;
    options.hold_back = !arguments_.send_all;
    for (int64_t i = 0; i < arguments_.connections; ++i) {
      auto connection = client::Client::Connect(options);
      if (!connection.ok()) return connection.status();
      connections_.push_back(*std::move(connection));
    }
    report_.connections = static_cast<int>(connections_.size());
    return absl::OkStatus();
  }

  absl::Status RunSteps(const load::LoadPlan& common, const std::vector<SweepRate>& rates) {
    load::LoadPlan plan = common;
    const load::ClosedLoop callers{static_cast<int>(arguments_.concurrency.value_or(kCallers))};
    const std::string callers_name = HowMany(callers.callers, "caller");
    if (arguments_.rate) {
      plan.loop = load::OpenLoop{*arguments_.rate, Arrival(arguments_)};
      return RunStep(absl::StrCat(*arguments_.rate, "/s"), plan);
    }
    plan.loop = callers;
    const bool measure_capacity = MeasuresCapacity(rates);
    if (rates.empty() || measure_capacity) {
      // Capacity is measured without a deadline.
      if (measure_capacity) plan.deadline.reset();
      const absl::Status status = RunStep(callers_name, plan);
      if (!status.ok() || stop_.cancelled() || rates.empty()) return status;
      if (report_.steps.back().tally.only_warm_up) {
        return absl::FailedPreconditionError(
            "every call fell into the warm-up, so the capacity is unknown; set --warm-up 0 or more "
            "--calls");
      }
      report_.capacity = report_.steps.back().tally.AnsweredRate();
      if (!(*report_.capacity > 0.0)) {
        return absl::FailedPreconditionError(
            "no call was answered in time, so the capacity is unknown; set a longer --duration");
      }
      plan.deadline = common.deadline;
    }
    for (const SweepRate& rate : rates) {
      plan.loop = load::OpenLoop{rate.of_capacity ? rate.value * *report_.capacity : rate.value,
                                 Arrival(arguments_)};
      const absl::Status status = RunStep(RateName(rate), plan);
      if (!status.ok() || stop_.cancelled()) return status;
    }
    return absl::OkStatus();
  }

  absl::Status RunStep(const std::string& name, const load::LoadPlan& plan) {
    std::unique_ptr<load::ServerWatch> watch;
    if (!arguments_.metrics.empty()) {
      auto started = load::ServerWatch::Start(arguments_.metrics);
      if (!started.ok()) return started.status();
      watch = *std::move(started);
    }
    ProgressLine progress(environment_.errors, environment_.progress_form());
    load::ServerCallee callee(connections_, requests_);
    LoadStep step{
        name, plan, load::RunLoad(plan, callee, timeline_, stop_, [&](const load::Progress& now) {
          progress.Show(now.fraction, absl::StrCat(name, now.warming_up ? ", warming up" : "", ", ",
                                                   now.in_flight, " in flight"));
        })};
    progress.Clear();
    absl::Status status;
    if (watch != nullptr) {
      auto change = watch->End();
      status = change.status();
      if (change.ok()) step.server = *std::move(change);
    }
    report_.steps.push_back(std::move(step));
    return status;
  }

  int Report(const absl::Status& status) {
    const std::string json = LoadReportJson(report_);
    if (environment_.json()) {
      environment_.out << json;
    } else if (!report_.steps.empty()) {
      environment_.out << LoadReportText(report_, arguments_.markdown  ? TableStyle::kMarkdown
                                                  : environment_.color ? TableStyle::kColorText
                                                                       : TableStyle::kText);
    }
    int exit_code = kOk;
    if (!status.ok()) exit_code = environment_.Fail(status);
    for (const LoadStep& step : report_.steps) {
      const absl::Status& failure = step.tally.failure;
      if (failure.ok()) continue;
      environment_.PrintError(absl::StatusCodeToString(failure.code()),
                              client::ErrorDetailsOf(failure).reason,
                              absl::StrCat(step.name, ": ", environment_.Explain(failure)));
      exit_code = kFailed;
    }
    if (report_.interrupted) {
      exit_code = environment_.Fail(
          absl::CancelledError("interrupted; the figures cover the time until then"));
    }
    if (!arguments_.json.empty()) {
      const absl::Status written = WriteFile(arguments_.json, json);
      if (!written.ok()) return environment_.Fail(written);
    }
    return exit_code;
  }

  const LoadArguments& arguments_;
  Environment& environment_;
  LoadReport report_;
  v1::PredictRequest first_;
  std::vector<client::PreparedPrediction> requests_;
  client::Cancellation stop_;
  load::RealTimeline timeline_;
  std::vector<std::unique_ptr<client::Client>> connections_;  // go first: their calls use the rest
};

constexpr char kHelp[] =
    "Sends prediction calls at a rate (--rate, or --rates for several), whether or not the server "
    "keeps\n"
    "up. Without a rate, --concurrency callers each ask again as soon as they are answered, which\n"
    "measures the server's capacity.\n"
    "\n"
    "Latency counts from the moment when a call is due. So if the server stalls for a second, all "
    "calls\n"
    "due in that second count as waiting. OFFERED/s counts calls that were due, ANSWERED/s those "
    "answered\n"
    "in the measured time. REFUSED calls were told to come later; EXPIRED calls were not answered "
    "within\n"
    "their deadline. Refused calls are not repeated.\n"
    "\n"
    "Run it on another machine than the server's, or on other cores, because it takes processor "
    "time from\n"
    "the server. The exit status is 1 if calls failed for other reasons than overload, and on "
    "Ctrl-C,\n"
    "which prints the figures so far.\n"
    "\n"
    "Example: maneuver load --metrics 127.0.0.1:9470\n"
    "         maneuver load --rates 25%,50%,80%,100%,300% --deadline 500 --json load.json\n"
    "         maneuver load --rate 200 --targets 1-16 --dataset city --duration 60\n"
    "         maneuver load scene.json --rate 1000 --calls 10000 --deadline 1-5";

}  // namespace

void AddLoad(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<LoadArguments>();
  Command command = root.Add("load", "How much can the server take?", kHelp);
  command.OptionalArguments(
      "FILE", &arguments->files,
      "Scenarios to ask about, as for maneuver predict [scenes of the synthetic town]");
  command.Option("--dataset", &arguments->dataset,
                 "Ask about scenes of this folder, or of datasets/NAME on the server");
  command.Option("--scenes", &arguments->scenes, 1, 100'000,
                 "Number of scenes of the dataset or the town");
  for (const char* option : {"--dataset", "--scenes"}) command.Exclude(option, "FILE");
  command.Option(
      "--model", &arguments->model,
      "town (the version that serves), town/2 or town@candidate [the only one that serves]");
  command.Choice("--method", &arguments->method, {"predict", "probability", "distribution"},
                 "Method to call");
  command.Option("--targets", &arguments->targets, "Targets of a request: N, or random from A-B");
  AddPriorityOption(command, &arguments->priority);
  command.Flag("--register-maps", &arguments->register_maps,
               "Register the scenes' maps first, and send only their ids, as a planner does");
  command.Option("--actions", &arguments->actions, 0, INT32_MAX,
                 "Describe these actions, such as 1,2");
  command.Option("--min-probability", &arguments->min_probability, 0.0, 1.0,
                 "Describe actions at least this probable [0.05]");
  command.Option("--top-k", &arguments->top_k, 1, 1'000'000,
                 "Describe the k most probable actions");
  command.Exclude("--actions", "--min-probability");
  command.Exclude("--actions", "--top-k");
  command.Exclude("--top-k", "--min-probability");

  command.Option("--rate", &arguments->rate, 1e-3, 1e6, "Calls a second");
  command.Choice("--arrival", &arguments->arrival, {"poisson", "constant"},
                 "Random times, as of many callers, or evenly spaced");
  command.Option(
      "--concurrency", &arguments->concurrency, 1, 100'000,
      absl::StrCat("Callers who each wait for an answer before they ask again [", kCallers, "]"));
  command.Option("--rates", &arguments->rates,
                 "Several runs, each at a rate in calls a second, or a share of what --concurrency "
                 "callers get");
  command.Exclude("--rate", "--rates");
  command.Exclude("--rate", "--concurrency");
  command.Option(
      "--deadline", &arguments->deadline,
      "Milliseconds from when a call is due: N, or random from A-B [--timeout, or 30 s]");
  command.Option("--warm-up", &arguments->warm_up, 0.0, 1e5, "Seconds before the measurement");
  command.Option("--duration", &arguments->duration, 0.1, 1e6, "Seconds to measure");
  command.Option("--calls", &arguments->calls, 1, 1'000'000'000'000,
                 "End after this many calls, including the warm-up");
  command.Option("--seed", &arguments->seed, 0, INT64_MAX,
                 "Seed of the town, the choice of requests and the times");

  command.Option("--connections", &arguments->connections, 1, 1'000,
                 "Connections to use; a server limits the calls at once on each");
  command.Flag("--retry", &arguments->retry,
               "Retry calls that fail with UNAVAILABLE, as the other commands do");
  command.Flag(
      "--send-all", &arguments->send_all,
      "Also send calls that the client library holds back from a server that refuses too many");
  command.Option("--max-in-flight", &arguments->max_in_flight, 1, 1'000'000,
                 "Most calls at once; further calls wait and are late");
  command.Option("--metrics", &arguments->metrics,
                 "Address of the server's metrics page; adds a table of its metrics");
  command.Option("--json", &arguments->json, "Also write all figures to this file");
  command.Flag("--markdown", &arguments->markdown, "Tables as Markdown");
  command.Run([arguments, &environment] { return LoadCommand(*arguments, environment).Run(); });
}

}  // namespace maneuver::cli
