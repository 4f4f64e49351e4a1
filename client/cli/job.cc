// maneuver job: list, show, watch, cancel, resume, delete; report is in report.cc.

#include <algorithm>
#include <memory>
#include <ostream>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/cli/action_titles.h"
#include "client/cli/commands.h"
#include "client/cli/figures.h"
#include "client/cli/job_display.h"
#include "client/cli/report.h"
#include "client/cli/resource_names.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/error_details.h"
#include "model/evaluation/cross_validation_text.h"
#include "model/evaluation/report_text.h"

namespace maneuver::cli {
namespace {

std::string Took(const v1::Job& job) {
  if (!job.has_start_time() || !job.has_end_time()) return "-";
  return Spell(ToSeconds(job.end_time()) - ToSeconds(job.start_time()));
}

double Done(const v1::Job& job) {
  return job.state() == v1::JOB_STATE_SUCCEEDED ? 1.0 : job.progress().fraction();
}

struct ListArguments {
  std::vector<std::string> states;  // empty: all
  std::optional<std::string> since;
};

// "2d", "3h" or "30m" before now, or a time such as "2027-01-31", which begins in this machine's
// time zone, or "2027-01-31T12:00:00Z".
absl::StatusOr<absl::Time> ParseSince(const std::string& text) {
  int64_t count = 0;
  const char unit = text.empty() ? '\0' : text.back();
  if ((unit == 'd' || unit == 'h' || unit == 'm') && text.front() != '-' &&
      absl::SimpleAtoi(text.substr(0, text.size() - 1), &count)) {
    const absl::Duration one = unit == 'd'   ? absl::Hours(24)
                               : unit == 'h' ? absl::Hours(1)
                                             : absl::Minutes(1);
    return absl::Now() - count * one;
  }
  absl::Time time;
  std::string error;
  if (absl::ParseTime(absl::RFC3339_full, text, &time, &error) ||
      absl::ParseTime("%Y-%m-%d", text, absl::LocalTimeZone(), &time, &error)) {
    return time;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("--since takes a span such as 2d, 3h or 30m, or a time such as 2027-01-31 or "
                   "2027-01-31T12:00:00Z; not ",
                   text));
}

int ListJobs(const ListArguments& arguments, Environment& environment) {
  absl::StatusOr<absl::Time> since = absl::InfinitePast();
  if (arguments.since) since = ParseSince(*arguments.since);
  if (!since.ok()) return environment.Refuse(std::string(since.status().message()));
  const auto is_wanted = [&](const v1::Job& job) {
    return arguments.states.empty() ||
           std::ranges::find(arguments.states, ListedState(job)) != arguments.states.end();
  };
  v1::ListJobsRequest request;
  request.set_page_size(1'000);
  v1::ListJobsResponse all;
  bool is_older = false;  // newest come first
  do {
    auto page = environment.server_client().ListJobs(request, environment.call_options());
    if (!page.ok()) return environment.FailCall(page.status());
    request.set_page_token(page->next_page_token());
    for (v1::Job& job : *page->mutable_jobs()) {
      // Nobody knows when a damaged job was created.
      is_older =
          ListedState(job) != kDamaged &&
          absl::FromUnixMicros(static_cast<int64_t>(1e6 * ToSeconds(job.create_time()))) < *since;
      if (is_older) break;
      if (is_wanted(job)) *all.add_jobs() = std::move(job);
    }
  } while (!is_older && !request.page_token().empty());
  if (environment.json()) {
    environment.PrintJson(all);
    return kOk;
  }
  Table table({{"JOB"},
               {"WHAT"},
               {"MODEL"},
               {"STATE"},
               {"DONE", Align::kRight},
               {"CREATED"},
               {"TOOK", Align::kRight}});
  for (const v1::Job& job : all.jobs()) {
    if (ListedState(job) == kDamaged) {
      table.Add(
          {job.name().empty() ? "?" : ShortName(job.name()), "-", "-", kDamaged, "-", "-", "-"});
      environment.err << "damaged: " << Printable(job.error().message()) << "\n";
      continue;
    }
    table.Add({ShortName(job.name()), Kind(job), Subject(job), StateName(job.state()),
               Fixed(100.0 * Done(job), 0) + " %", Moment(job.create_time()), Took(job)});
  }
  if (table.empty()) {
    environment.err << (arguments.states.empty() && !arguments.since
                            ? "no jobs yet; start one with maneuver train MODEL --dataset NAME\n"
                            : "no such jobs\n");
  } else {
    environment.out << table.Text(environment.color);
  }
  return kOk;
}

int ShowJob(const std::string& name, const std::optional<std::string>& figures,
            Environment& environment) {
  v1::GetJobRequest request;
  request.set_name(JobResource(name));
  const auto job = environment.server_client().GetJob(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (figures && job->evaluation().sampled_examples().empty()) {
    return environment.Refuse(
        "this job has no figures: only an evaluation that was started with maneuver evaluate ... "
        "--figures and has ended does");
  }
  const int drawn = figures ? DrawFigures(job->evaluation(), *figures, environment) : kOk;
  if (environment.json()) {
    environment.PrintJson(*job);
    return drawn;
  }
  Table table({{"JOB"}, {ShortName(job->name())}});
  table.Add({"what", Kind(*job)});
  table.Add({"model", Subject(*job)});
  table.Add({"datasets", Datasets(*job)});
  table.Add({"state", StateName(job->state())});
  if (job->attempts().started() > 1) {
    table.Add({"processes", absl::StrCat(job->attempts().started(), ", the last from ",
                                         Moment(job->attempts().start_time()))});
  }
  if (job->has_error()) {
    const char* const what = client::HasEnded(*job) ? "error"
                             : client::ErrorDetailsOf(job->error()).reason == "NO_WORKER"
                                 ? "waits"
                                 : "interrupted";
    table.Add({what, job->error().message()});
  }
  table.Add({"created", Moment(job->create_time())});
  table.Add({"started", Moment(job->start_time())});
  table.Add({"ended", Moment(job->end_time())});
  table.Add({"took", Took(*job)});
  const v1::JobProgress& progress = job->progress();
  if (!progress.phase().empty()) {
    table.Add({"progress", absl::StrCat(Fixed(100.0 * Done(*job), 0), " %, ",
                                        ProgressText(progress, progress.epoch_report()))});
  }
  environment.out << table.Text(environment.color);
  if (job->has_error() && job->last_lines_size() > 0) {
    environment.out << "\nThe last lines of its process:\n";
    for (const std::string& line : job->last_lines())
      environment.out << "  " << Printable(line) << "\n";
  }
  if (job->has_tagged()) environment.out << "\n" << TagsText(job->tagged()) << "\n";
  if (job->has_promotion_decision()) {
    environment.out << "\n" << PromotionText(*job, environment.color);
  }
  if (job->evaluation().metrics_size() > 0) {
    environment.out << "\n"
                    << evaluation::ReportText(
                           job->evaluation(), environment.color,
                           FetchActionNames(job->evaluation().model_version(), environment));
  }
  if (job->has_cross_validation()) {
    environment.out << "\n"
                    << evaluation::CrossValidationText(job->cross_validation(), environment.color);
  }
  return drawn;
}

int Cancel(const std::string& name, Environment& environment) {
  v1::CancelJobRequest request;
  request.set_name(JobResource(name));
  const auto job = environment.server_client().CancelJob(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (environment.json()) {
    environment.PrintJson(*job);
  } else {
    environment.out << job->name() << " is "
                    << (client::HasEnded(*job) ? StateName(job->state()) : "being stopped") << "\n";
  }
  return kOk;
}

int Resume(const std::string& name, bool detach, Environment& environment) {
  v1::ResumeJobRequest request;
  request.set_name(JobResource(name));
  const auto job = environment.server_client().ResumeJob(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (!detach) return WatchToEnd(job->name(), environment);
  if (environment.json()) {
    environment.PrintJson(*job);
  } else {
    environment.out << job->name() << " is " << StateName(job->state()) << "\n";
    SayHowToWatch(job->name(), environment);
  }
  return kOk;
}

int DeleteJob(const std::string& name, Environment& environment) {
  v1::DeleteJobRequest request;
  request.set_name(JobResource(name));
  const absl::Status status =
      environment.server_client().DeleteJob(request, environment.call_options());
  if (!status.ok()) return environment.FailCall(status);
  environment.err << request.name() << " is deleted; its results stay\n";
  return kOk;
}

}  // namespace

void AddJob(Command& root, Environment& environment) {
  Command group = root.Add("job", "Training, evaluation, cross-validation and tagging jobs");
  const auto name = std::make_shared<std::string>();

  Command list = group.Add("list", "Jobs, newest first",
                           "Example: maneuver job list\n"
                           "         maneuver job list --state running --state pending\n"
                           "         maneuver job list --state failed --since 2d");
  const auto listed = std::make_shared<ListArguments>();
  list.Choices("--state", &listed->states,
               {"pending", "running", "succeeded", "failed", "cancelled", kDamaged},
               "Only jobs in this state; may be repeated");
  list.Option("--since", &listed->since,
              "Only jobs that were created in the last 2d, 3h or 30m, or since 2027-01-31 or "
              "2027-01-31T12:00:00Z");
  list.Run([=, &environment] { return ListJobs(*listed, environment); });

  Command show = group.Add("show", "One job",
                           "Example: maneuver job show 3f2a\n"
                           "         maneuver job show 3f2a --figures figures");
  show.Argument("JOB", name.get(), "Its name, as maneuver job list prints it");
  const auto figures = std::make_shared<std::optional<std::string>>();
  show.Option("--figures", figures.get(), "Folder to draw an evaluation's figures into");
  show.Run([=, &environment] { return ShowJob(*name, *figures, environment); });

  AddJobReport(group, environment);

  Command watch =
      group.Add("watch", "Follow a job until it ends",
                "Shows all progress from the start. Ctrl-C stops watching, not the job.\n"
                "The exit status is 0 if the job succeeded, 130 after Ctrl-C, otherwise 1.\n"
                "Example: maneuver job watch 3f2a");
  watch.Argument("JOB", name.get(), "Its name");
  watch.Run([=, &environment] { return WatchToEnd(JobResource(*name), environment); });

  Command cancel = group.Add("cancel", "Stop a job that is pending or running",
                             "Example: maneuver job cancel 3f2a");
  cancel.Argument("JOB", name.get(), "Its name");
  cancel.Run([=, &environment] { return Cancel(*name, environment); });

  Command resume =
      group.Add("resume", "Continue a job that failed or was cancelled",
                "Continues from its last checkpoint, and watches it unless --detach is given.\n"
                "Example: maneuver job resume 3f2a");
  resume.Argument("JOB", name.get(), "Its name");
  const auto detach = std::make_shared<bool>(false);
  resume.Flag("--detach", detach.get(), "Resume the job and return");
  resume.Run([=, &environment] { return Resume(*name, *detach, environment); });

  Command remove = group.Add("delete", "Delete a job that has ended; its results stay",
                             "Example: maneuver job delete 3f2a");
  remove.Argument("JOB", name.get(), "Its name");
  remove.Run([=, &environment] { return DeleteJob(*name, environment); });
}

}  // namespace maneuver::cli
