// maneuver outcomes: did predictions come true?

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <ostream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/interrupt.h"
#include "client/cli/json_files.h"
#include "client/cli/progress_line.h"
#include "client/cli/resource_names.h"
#include "client/cli/scenario_files.h"
#include "client/cli/scenario_source.h"
#include "client/cli/settings_argument.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/error_details.h"
#include "client/observed_scenario.h"
#include "google/protobuf/struct.pb.h"
#include "model/data/dataset_folder.h"
#include "model/data/example_index.h"
#include "model/evaluation/strata.h"
#include "model/scene/target_frame.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;

// One report has at most so many targets, and stops to grow at so many bytes.
constexpr int kTargetsPerReport = 64;
constexpr size_t kBytesPerReport = size_t{4} << 20;

struct OutcomesArguments {
  std::vector<std::string> sources;
  std::string model;
  std::vector<std::string> assignments;
  bool kept = false;
};

// Sums over outcomes.
struct Sums {
  int64_t outcomes = 0;
  std::map<std::string, double> metrics;

  void Add(const v1::TargetScore& score) {
    ++outcomes;
    for (const auto& [name, value] : score.metrics()) metrics[name] += value;
  }
  double Mean(const std::string& name) const {
    const auto sum = metrics.find(name);
    return sum == metrics.end() ? 0.0 : sum->second / static_cast<double>(outcomes);
  }
};

// The scores of all outcomes.
class ScoreSums {
 public:
  void Add(const v1::TargetScore& score) {
    all_.Add(score);
    strata_[score.speed_stratum()].Add(score);
    ++actions_[{score.model_version(), score.action_id()}];
  }
  int64_t outcomes() const { return all_.outcomes; }
  // The outcomes by version and action.
  const std::map<std::pair<std::string, int>, int64_t>& actions() const { return actions_; }
  const Sums& all() const { return all_; }

  // Calls `visit` with each speed stratum that has outcomes, slowest first.
  void ForEachStratum(const std::function<void(const std::string&, const Sums&)>& visit) const {
    for (const evaluation::Stratification& each : evaluation::Stratifications()) {
      if (each.dimension != "speed") continue;
      for (const std::string_view name : each.names) {
        const auto found = strata_.find(std::string(name));
        if (found != strata_.end()) visit(found->first, found->second);
      }
    }
  }

 private:
  Sums all_;
  std::map<std::string, Sums> strata_;
  std::map<std::pair<std::string, int>, int64_t> actions_;
};

google::protobuf::RepeatedPtrField<v1::AgentState> StatesAfter(const v1::Scenario& recording,
                                                               int64_t target_id, double time) {
  google::protobuf::RepeatedPtrField<v1::AgentState> states;
  if (const v1::Agent* agent = scene::FindAgent(recording, target_id)) {
    for (const v1::AgentState& state : agent->states()) {
      if (state.time() > time + scene::kSameTime) *states.Add() = state;
    }
  }
  return states;
}

// Reports the outcomes of recordings over one stream.
class OutcomesCommand {
 public:
  OutcomesCommand(const OutcomesArguments& arguments, Environment& environment)
      : arguments_(arguments),
        environment_(environment),
        progress_(environment.errors, environment.progress_form()) {}

  int Run() {
    for (const std::string& assignment : arguments_.assignments) {
      const absl::Status status = SetExampleField(assignment, &examples_);
      if (!status.ok()) return environment_.Refuse(std::string(status.message()));
    }
    const auto settings = ResolveExamples(examples_);
    if (!settings.ok()) return environment_.Refuse(std::string(settings.status().message()));
    examples_ = settings->examples();
    client::CallOptions call = environment_.call_options();
    call.cancellation = &cancellation_;
    v1::GetModelVersionRequest wanted;
    wanted.set_name(ModelResource(arguments_.model));
    auto version = environment_.server_client().GetModelVersion(wanted, call);
    if (!version.ok()) return Fail(version.status());
    version_ = *std::move(version);
    stream_ = environment_.server_client().StreamOutcomes(
        [this](const v1::ReportOutcomesRequest& report, const auto& answer) {
          AddScores(report, answer);
        },
        call);
    absl::Status status;
    for (const std::string& source : arguments_.sources) {
      status = ReportSource(source);
      if (!status.ok()) break;
    }
    if (status.ok()) status = Send();
    if (status.ok()) status = stream_->Finish();
    if (status.ok()) status = refusal_;
    progress_.Clear();
    if (!status.ok()) return Fail(status);
    if (sums_.outcomes() == 0 && failed_ == 0) {
      return environment_.Fail(absl::FailedPreconditionError(
          "the recordings hold no outcome: no target has a past and a whole horizon of future"));
    }
    Print();
    return failed_ == 0 ? kOk : kFailed;
  }

 private:
  int Fail(const absl::Status& status) {
    if (interrupt_.happened()) return environment_.Fail(absl::CancelledError("interrupted"));
    return unread_.ok() ? environment_.FailCall(status) : environment_.Fail(unread_);
  }

  // Reports each recording of a source.
  absl::Status ReportSource(const std::string& source) {
    if (IsOnServer(source)) return ReportDataset(source);
    std::error_code error;
    if (source != "-" && !fs::exists(source, error)) {
      return unread_ = error ? absl::NotFoundError(absl::StrCat(source, ": ", error.message()))
                             : MissingSource(source);
    }
    if (fs::is_directory(source, error)) {
      const auto manifest = data::LoadDatasetManifest(source);
      if (!manifest.ok()) return unread_ = manifest.status();
      absl::Status status;
      int64_t done = 0;
      const absl::Status read =
          data::ForEachScenario(source, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
            status = Report(recording);
            ShowProgress(source, ++done, manifest->recordings());
            return status.ok();
          });
      return read.ok() ? status : unread_ = read;
    }
    v1::Scenario recording;
    if (absl::Status status = ReadJson(source, environment_, &recording); !status.ok()) {
      return unread_ = status;
    }
    return Report(recording);
  }

  // Reports each recording of a dataset on the server.
  absl::Status ReportDataset(const std::string& dataset) {
    const auto list = ListScenarios(dataset, 0, environment_);
    if (!list.ok()) return list.status();
    for (int i = 0; i < list->scenarios_size(); ++i) {
      const auto recording = GetScenario(dataset, list->scenarios(i).scenario_id(), environment_);
      if (!recording.ok()) return recording.status();
      if (absl::Status status = Report(*recording); !status.ok()) return status;
      ShowProgress(dataset, i + 1, list->scenarios_size());
    }
    return absl::OkStatus();
  }

  void ShowProgress(const std::string& source, int64_t done, int64_t total) {
    progress_.Show(static_cast<double>(done) / static_cast<double>(std::max<int64_t>(1, total)),
                   absl::StrCat(source, ": ", done, " of ", total, " recordings, ",
                                sums_.outcomes(), " outcomes"));
  }

  // Adds the outcomes of one recording to the request; sends it when it is large.
  absl::Status Report(const v1::Scenario& recording) {
    if (interrupt_.happened()) return absl::CancelledError("interrupted");
    std::map<double, std::vector<int64_t>> targets;  // by prediction time
    if (arguments_.kept) {
      for (const int64_t id : recording.target_ids()) {
        targets[recording.prediction_time()].push_back(id);
      }
    } else {
      for (const data::Example& example :
           data::EnumerateExamples(recording, 0, version_.manifest().spec(), examples_)) {
        targets[example.time].push_back(example.target_id);
      }
    }
    for (const auto& [time, ids] : targets) {
      for (size_t begin = 0; begin < ids.size(); begin += kTargetsPerReport) {
        const size_t end = std::min(ids.size(), begin + kTargetsPerReport);
        if (targets_ + static_cast<int>(end - begin) > kTargetsPerReport ||
            bytes_ > kBytesPerReport) {
          if (absl::Status status = Send(); !status.ok()) return status;
        }
        AddOutcome(recording, time,
                   {ids.begin() + static_cast<std::ptrdiff_t>(begin),
                    ids.begin() + static_cast<std::ptrdiff_t>(end)});
      }
    }
    return absl::OkStatus();
  }

  void AddOutcome(const v1::Scenario& recording, double time, const std::vector<int64_t>& ids) {
    v1::Outcome& outcome = *request_.add_outcomes();
    if (arguments_.kept) {
      outcome.set_scenario_id(recording.scenario_id());
      outcome.set_prediction_time(time);
      outcome.set_model(version_.name());
    } else {
      v1::Scenario& scene = *outcome.mutable_scenario();
      scene = recording;
      scene.set_prediction_time(time);
      scene.mutable_target_ids()->Assign(ids.begin(), ids.end());
      client::StripFuture(&scene);
    }
    for (const int64_t id : ids) {
      v1::TargetOutcome& target = *outcome.add_targets();
      target.set_target_id(id);
      *target.mutable_states() = StatesAfter(recording, id, time);
    }
    targets_ += static_cast<int>(ids.size());
    bytes_ += outcome.ByteSizeLong();
  }

  // Sends what is collected.
  absl::Status Send() {
    if (request_.outcomes().empty()) return absl::OkStatus();
    request_.set_model(version_.name());
    const absl::Status status = stream_->Send(std::exchange(request_, {}));
    targets_ = 0;
    bytes_ = 0;
    return status.ok() ? refusal_ : status;
  }

  // Adds up the scores of a report.
  void AddScores(const v1::ReportOutcomesRequest& report,
                 const absl::StatusOr<v1::ReportOutcomesResponse>& answer) {
    if (!answer.ok()) {
      refusal_.Update(answer.status());
      return;
    }
    for (const v1::OutcomeScore& score : answer->scores()) {
      if (score.outcome_index() < 0 || score.outcome_index() >= report.outcomes_size()) continue;
      const v1::Outcome& outcome = report.outcomes(score.outcome_index());
      const std::string& name =
          outcome.has_scenario() ? outcome.scenario().scenario_id() : outcome.scenario_id();
      if (score.has_error()) {
        progress_.Clear();
        ReportItemError(name, score.error(), environment_);
        failed_ += outcome.targets_size();
      }
      for (const v1::TargetScore& target : score.targets()) {
        if (target.has_error()) {
          progress_.Clear();
          ReportItemError(TargetName(name, target.target_id()), target.error(), environment_);
          ++failed_;
        } else {
          sums_.Add(target);
        }
      }
    }
  }

  void Print() const {
    if (environment_.json()) return PrintJson();
    Table table({{"speed"},
                 {"outcomes", Align::kRight},
                 {"nll", Align::kRight},
                 {"ade, m", Align::kRight},
                 {"fde, m", Align::kRight},
                 {"best of 6: ade", Align::kRight},
                 {"fde", Align::kRight},
                 {"in 1 sigma", Align::kRight},
                 {"in 2 sigma", Align::kRight}});
    const auto add = [&table](const std::string& name, const Sums& sums) {
      table.Add({name, absl::StrCat(sums.outcomes), Fixed(sums.Mean("nll"), 3),
                 Fixed(sums.Mean("ade_1"), 2), Fixed(sums.Mean("fde_1"), 2),
                 Fixed(sums.Mean("min_ade_6"), 2), Fixed(sums.Mean("min_fde_6"), 2),
                 Share(sums.Mean("coverage_1sigma")), Share(sums.Mean("coverage_2sigma"))});
    };
    sums_.ForEachStratum(add);
    if (sums_.outcomes() > 0) add("all", sums_.all());
    environment_.out << table.Text(environment_.color);
    PrintActions();
  }

  // Prints the actions of `version_` that were taken, the most frequent first.
  void PrintActions() const {
    std::vector<std::pair<int64_t, int>> taken;
    int64_t outcomes = 0;
    for (const auto& [action, count] : sums_.actions()) {
      if (action.first != version_.name()) continue;
      taken.emplace_back(-count, action.second);
      outcomes += count;
    }
    if (taken.empty()) return;
    std::sort(taken.begin(), taken.end());
    Table table({{"action", Align::kRight},
                 {"name"},
                 {"taken", Align::kRight},
                 {"in validation", Align::kRight}});
    constexpr size_t kShown = 10;
    if (taken.size() > kShown) taken.resize(kShown);
    for (const auto& [negative, id] : taken) {
      const auto& actions = version_.manifest().actions();
      const bool known = id < actions.size();
      table.Add({absl::StrCat(id), known ? actions[id].display_name() : "",
                 Share(static_cast<double>(-negative) / static_cast<double>(outcomes)),
                 known ? Share(actions[id].usage()) : "-"});
    }
    environment_.out << "\n" << table.Text(environment_.color);
  }

  void PrintJson() const {
    google::protobuf::Struct printed;
    auto& fields = *printed.mutable_fields();
    const auto write = [](const Sums& sums, google::protobuf::Struct* part) {
      auto& into = *part->mutable_fields();
      into["outcomes"].set_number_value(static_cast<double>(sums.outcomes));
      auto& metrics = *into["metrics"].mutable_struct_value()->mutable_fields();
      for (const auto& [name, sum] : sums.metrics) metrics[name].set_number_value(sums.Mean(name));
    };
    write(sums_.all(), &printed);
    fields["failed"].set_number_value(static_cast<double>(failed_));
    auto& strata = *fields["strata"].mutable_list_value();
    sums_.ForEachStratum([&](const std::string& name, const Sums& sums) {
      google::protobuf::Struct& part = *strata.add_values()->mutable_struct_value();
      (*part.mutable_fields())["name"].set_string_value(name);
      write(sums, &part);
    });
    auto& actions = *fields["actions"].mutable_list_value();
    for (const auto& [action, count] : sums_.actions()) {
      auto& part = *actions.add_values()->mutable_struct_value()->mutable_fields();
      part["modelVersion"].set_string_value(action.first);
      part["actionId"].set_number_value(action.second);
      part["outcomes"].set_number_value(static_cast<double>(count));
    }
    environment_.PrintJson(printed);
  }

  const OutcomesArguments& arguments_;
  Environment& environment_;
  ProgressLine progress_;
  client::Cancellation cancellation_;  // of a call that waits for the server
  const Interrupt interrupt_{[this] { cancellation_.Cancel(); }};
  v1::ExampleSettings examples_;
  v1::ModelVersion version_;
  v1::ReportOutcomesRequest request_;
  int targets_ = 0;       // of request_
  size_t bytes_ = 0;      // of request_
  absl::Status refusal_;  // of the first report that the server refused
  absl::Status unread_;   // why a source on this machine cannot be read
  int64_t failed_ = 0;    // targets
  ScoreSums sums_;
  std::unique_ptr<client::OutcomeStream> stream_;  // last: calls AddScores
};

struct CollectArguments {
  std::string dataset;
  bool forget = false;
};

int Collect(const CollectArguments& arguments, Environment& environment) {
  v1::CollectOutcomesRequest request;
  request.set_dataset(DatasetResource(arguments.dataset));
  request.set_forget(arguments.forget);
  const auto response =
      environment.server_client().CollectOutcomes(request, environment.call_options());
  if (!response.ok()) return environment.FailCall(response.status());
  if (environment.json()) {
    environment.PrintJson(*response);
  } else {
    environment.out << response->dataset().name() << ": "
                    << HowMany(response->dataset().recordings(), "recording") << ", "
                    << response->surprising_recordings()
                    << " of them the most surprising outcomes, " << response->sampled_recordings()
                    << " a sample of the others\n";
  }
  return kOk;
}

}  // namespace

void AddOutcomes(Command& root, Environment& environment) {
  Command group = root.Add("outcomes", "Learn whether predictions came true",
                           "Compares predictions with what happened; the server's metrics page "
                           "shows the scores.");
  const auto arguments = std::make_shared<OutcomesArguments>();
  Command report = group.Add(
      "report", "Report what happened in recordings",
      "Sends each scene of the recordings with what its targets did next. The server predicts and "
      "scores\nthe predictions. Targets and times are those of maneuver evaluate.\n"
      "Example: maneuver outcomes report yesterday --model town\n"
      "         maneuver outcomes report scene.json --model town --kept");
  report.Arguments("SOURCE", &arguments->sources,
                   "Dataset folders; files with one Scenario as proto3 JSON each; datasets/NAME on "
                   "the server");
  report.Argument("--model", &arguments->model,
                  "town (the version that serves), town/2 or town@candidate");
  report.Option("--set", &arguments->assignments,
                "FIELD=VALUE of the examples to report: examples.stride=1s, ...");
  report.Flag("--kept", &arguments->kept,
              "Score the answers that the server gave: name each scene by its id and prediction "
              "time, and send its targets' futures alone (maneuverd --outcome-memory)");
  report.Exclude("--kept", "--set");
  report.Run([arguments, &environment] { return OutcomesCommand(*arguments, environment).Run(); });
  const auto collected = std::make_shared<CollectArguments>();
  Command collect = group.Add(
      "collect", "Make a dataset of the outcomes that the server collected",
      "A server that runs with --outcome-recordings keeps reported scenes with what followed them: "
      "the\nmost surprising ones, and a sample of the others. This makes a dataset of them, to "
      "train "
      "and to\nrecalibrate on.\n"
      "Example: maneuver outcomes collect surprises\n"
      "         maneuver train town --start-from town --dataset town --dataset surprises");
  collect.Argument("DATASET", &collected->dataset, "Dataset to make; must not exist");
  collect.Flag("--forget", &collected->forget,
               "Remove the outcomes from the collection: the next dataset holds only later ones");
  collect.Run([collected, &environment] { return Collect(*collected, environment); });
}

}  // namespace maneuver::cli
