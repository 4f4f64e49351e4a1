#include "client/cli/job_display.h"

#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/action_titles.h"
#include "client/cli/command.h"
#include "client/cli/comparison_text.h"
#include "client/cli/interrupt.h"
#include "client/cli/resource_names.h"
#include "client/cli/text_format.h"
#include "client/error_details.h"
#include "model/evaluation/cross_validation_text.h"
#include "model/evaluation/report_text.h"

namespace maneuver::cli {
namespace {

// Draws the events of one job.
class JobDisplay {
 public:
  explicit JobDisplay(Environment& environment)
      : environment_(environment),
        form_(environment.progress_form()),
        line_(environment.errors, form_) {}

  void Show(const v1::Job& job) {
    const v1::JobProgress& progress = job.progress();
    if (form_ == ProgressForm::kJson) {
      line_.ShowJson(progress);
      return;
    }
    if (environment_.progress == "none") return;
    if (job.state() == v1::JOB_STATE_PENDING) {
      line_.Show(0.0, "waiting for its turn");
      if (form_ == ProgressForm::kNone && !waiting_said_) {
        environment_.err << Printable(job.name()) << " waits for its turn\n";
      }
      waiting_said_ = true;
      return;
    }
    if (progress.phase() != phase_) {
      // On a terminal each phase leaves its last line behind.
      if (form_ == ProgressForm::kLine && !phase_.empty() && last_report_.training_size() > 0) {
        line_.Clear();
        environment_.err << last_text_ << "\n";
      }
      phase_ = progress.phase();
      last_report_.Clear();
    }
    if (progress.has_epoch_report()) {
      last_report_ = progress.epoch_report();
      v1::JobProgress ended = progress;
      ended.clear_time_left();
      last_text_ = ProgressText(ended, last_report_);
      if (form_ == ProgressForm::kNone) {
        environment_.err << ProgressText(progress, last_report_) << "\n";
      }
    }
    line_.Show(progress.fraction(), absl::StrCat(Fixed(100.0 * progress.fraction(), 0), " %  ",
                                                 ProgressText(progress, last_report_)));
  }

  void Clear() { line_.Clear(); }

 private:
  Environment& environment_;
  const ProgressForm form_;
  ProgressLine line_;
  std::string phase_;
  v1::EpochReport last_report_;
  std::string last_text_;
  bool waiting_said_ = false;
};

void PrintHowToGoOn(const std::string& job, Environment& environment) {
  const std::string name = ShortName(job);
  environment.err << "Stopped watching; " << job << " continues.\n  maneuver job watch " << name
                  << "\n  maneuver job cancel " << name << "\n";
}

}  // namespace

std::string ListedState(const v1::Job& job) {
  return job.state() == v1::JOB_STATE_UNSPECIFIED && job.has_error() ? kDamaged
                                                                     : StateName(job.state());
}

std::string StateName(v1::JobState state) {
  switch (state) {
    case v1::JOB_STATE_PENDING:
      return "pending";
    case v1::JOB_STATE_RUNNING:
      return "running";
    case v1::JOB_STATE_SUCCEEDED:
      return "succeeded";
    case v1::JOB_STATE_FAILED:
      return "failed";
    case v1::JOB_STATE_CANCELLED:
      return "cancelled";
    default:
      return "-";
  }
}

std::string Kind(const v1::Job& job) {
  if (job.has_recalibrate()) return "recalibrate";
  if (job.has_cross_validate()) return "cross-validate";
  if (job.has_tag()) return "tag";
  return job.has_train() ? "train" : job.has_evaluate() ? "evaluate" : "-";
}

std::string Subject(const v1::Job& job) {
  if (job.has_cross_validate()) return "-";
  if (job.has_tag()) return ShortName(job.tag().model());
  if (!job.model_version().empty()) return ShortName(job.model_version());
  if (job.has_recalibrate()) return ShortName(job.recalibrate().model());
  return ShortName(job.has_train() ? job.train().model() : job.evaluate().model());
}

std::string Datasets(const v1::Job& job) {
  if (job.has_train()) return absl::StrJoin(job.train().datasets(), " ");
  if (job.has_evaluate()) return job.evaluate().dataset();
  if (job.has_recalibrate()) return absl::StrJoin(job.recalibrate().datasets(), " ");
  if (job.has_tag()) return absl::StrJoin(job.tag().datasets(), " ");
  return absl::StrJoin(job.cross_validate().datasets(), " ");
}

std::string ProgressText(const v1::JobProgress& progress, const v1::EpochReport& last_report) {
  std::string text = Printable(progress.phase());
  if (progress.epochs() > 1) {
    absl::StrAppend(&text, " ", progress.epoch(), "/", progress.epochs());
  }
  const auto loss = last_report.training().find("loss");
  if (loss != last_report.training().end()) {
    absl::StrAppend(&text, "  loss ", Fixed(loss->second, 3));
  }
  const auto held_out = last_report.validation().find("loss");
  if (held_out != last_report.validation().end()) {
    absl::StrAppend(&text,
                    loss != last_report.training().end() ? ", held out " : "  held-out loss ",
                    Fixed(held_out->second, 3));
  }
  if (last_report.action_usage_size() > 0) {
    absl::StrAppend(&text, "  ", last_report.effective_actions(), " effective actions");
  }
  if (progress.has_time_left()) {
    absl::StrAppend(&text, "  ", Spell(ToSeconds(progress.time_left())), " left");
  }
  return text;
}

std::string HeldOutText(const v1::ModelManifest& manifest, bool color) {
  v1::EvaluationReport report;
  *report.mutable_metrics() = manifest.metrics();
  *report.mutable_rivals() = manifest.rivals();
  return evaluation::ReportText(report, color);
}

std::string TagsText(const v1::Tags& tags) {
  return absl::StrCat(tags.name(), ": ", HowMany(tags.window_count(), "window"), " in ",
                      HowMany(tags.rows(), "row"), ", ", tags.shards(), " of ", tags.all_shards(),
                      " shards, ", Bytes(tags.size_bytes()));
}

std::string PromotionText(const v1::Job& job, bool color) {
  if (!job.has_promotion_decision()) return "";
  const v1::PromotionDecision& decision = job.promotion_decision();
  std::string text = absl::StrCat(Printable(ShortName(job.model_version())),
                                  decision.promoted() ? " was promoted: " : " was not promoted: ",
                                  PrintableLines(decision.reason()), "\n");
  if (decision.has_comparison()) {
    absl::StrAppend(&text, "\n", ComparisonText(decision.comparison(), color));
  }
  return text;
}

void PrintValid(const v1::Job& job, Environment& environment) {
  if (environment.json()) {
    environment.PrintJson(job);
    return;
  }
  environment.out << "The request is valid; nothing was started.\n";
  if (!job.has_memory()) return;  // an older server
  const v1::JobMemory& memory = job.memory();
  environment.out << "The job will take about " << Bytes(memory.total_bytes())
                  << " of memory: " << Bytes(memory.data_bytes()) << " for "
                  << Bytes(memory.recording_bytes()) << " of recordings, "
                  << (memory.data_fit() ? "all of them at once"
                                        : "which are read piece by piece (--data-memory)")
                  << "; " << Bytes(memory.network_bytes()) << " for the networks; "
                  << Bytes(memory.working_bytes()) << " to work in; "
                  << Bytes(memory.total_bytes() - memory.data_bytes() - memory.network_bytes() -
                           memory.working_bytes())
                  << " for the program.\n";
}

int PrintOutcome(const v1::Job& job, Environment& environment) {
  const bool succeeded = job.state() == v1::JOB_STATE_SUCCEEDED;
  if (environment.json()) {
    environment.PrintJson(job);
    return succeeded ? kOk : kFailed;
  }
  if (job.state() == v1::JOB_STATE_FAILED) {
    environment.errors << "maneuver: " << job.name() << " failed: "
                       << PrintableLines(Environment::Describe(client::ToStatus(job.error())))
                       << "\n";
    return kFailed;
  }
  if (!succeeded) {
    environment.errors << "maneuver: " << job.name() << " was cancelled; maneuver job resume "
                       << ShortName(job.name()) << " continues it\n";
    return kFailed;
  }
  const double took = ToSeconds(job.end_time()) - ToSeconds(job.start_time());
  if (job.has_evaluate()) {
    environment.out << ShortName(job.evaluation().model_version()) << " on "
                    << ShortName(job.evaluation().dataset()) << ", " << job.evaluation().examples()
                    << " examples, in " << Spell(took) << "\n\n"
                    << evaluation::ReportText(
                           job.evaluation(), environment.color,
                           FetchActionNames(job.evaluation().model_version(), environment));
    return kOk;
  }
  if (job.has_cross_validate()) {
    environment.out << Datasets(job) << " cross-validated in " << Spell(took) << "\n\n"
                    << evaluation::CrossValidationText(job.cross_validation(), environment.color);
    return kOk;
  }
  if (job.has_tag()) {
    environment.out << TagsText(job.tagged()) << ", in " << Spell(took) << "\n";
    return kOk;
  }
  environment.out << job.model_version()
                  << (job.has_recalibrate() ? " was recalibrated in " : " was trained in ")
                  << Spell(took) << "\n"
                  << PromotionText(job, environment.color);
  v1::GetModelVersionRequest request;
  request.set_name(job.model_version());
  const auto version =
      environment.server_client().GetModelVersion(request, environment.call_options());
  // It may have been deleted since; the job is none the worse for that.
  if (version.ok() && version->manifest().metrics_size() > 0) {
    environment.out << "\n" << HeldOutText(version->manifest(), environment.color);
  }
  return kOk;
}

int ShowStarted(const v1::Job& job, const std::string& doing, bool detach,
                Environment& environment) {
  if (job.state() == v1::JOB_STATE_PENDING && job.has_error()) {
    environment.err << job.name() << " waits: " << Printable(job.error().message()) << "\n";
  }
  if (!detach) {
    environment.err << job.name() << " " << doing << "; Ctrl-C stops watching\n";
    return WatchToEnd(job.name(), environment);
  }
  if (environment.json()) {
    environment.PrintJson(job);
  } else {
    environment.out << job.name() << "\n";
    SayHowToWatch(job.name(), environment);
  }
  return kOk;
}

void SayHowToWatch(const std::string& job, Environment& environment) {
  environment.err << "Watch it with: maneuver job watch " << ShortName(job) << "\n";
}

int WatchToEnd(const std::string& job, Environment& environment) {
  client::Cancellation cancellation;
  client::CallOptions call = environment.call_options();
  call.cancellation = &cancellation;
  JobDisplay display(environment);
  v1::WatchJobRequest request;
  request.set_name(job);
  bool left = false;
  absl::StatusOr<v1::Job> ended = absl::UnknownError("not watched");
  {
    const Interrupt interrupt([&cancellation] { cancellation.Cancel(); });
    ended = environment.server_client().WatchJob(
        request,
        [&display](const v1::Job& event) {
          display.Show(event);
          return true;
        },
        call);
    left = interrupt.happened();
  }
  display.Clear();
  if (!ended.ok() && left) {
    PrintHowToGoOn(job, environment);
    return kInterrupted;
  }
  if (!ended.ok()) {
    const bool is_refused =
        absl::IsNotFound(ended.status()) || absl::IsInvalidArgument(ended.status()) ||
        absl::IsUnauthenticated(ended.status()) || absl::IsPermissionDenied(ended.status());
    if (!is_refused) PrintHowToGoOn(job, environment);
    return environment.FailCall(ended.status());
  }
  return PrintOutcome(*ended, environment);
}

}  // namespace maneuver::cli
