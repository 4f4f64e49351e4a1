// Shows jobs to people.

#ifndef MANEUVER_CLIENT_CLI_JOB_DISPLAY_H_
#define MANEUVER_CLIENT_CLI_JOB_DISPLAY_H_

#include <string>

#include "client/cli/environment.h"
#include "client/cli/progress_line.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli {

std::string StateName(v1::JobState state);  // "running"
// Returns the state of a listed job, or "damaged" if the server has no more than its name.
std::string ListedState(const v1::Job& job);
inline constexpr char kDamaged[] = "damaged";
std::string Kind(const v1::Job& job);      // "train", "evaluate", "recalibrate", ...
std::string Subject(const v1::Job& job);   // the model or version: "town", "town/3"; else "-"
std::string Datasets(const v1::Job& job);  // what it learns from or measures: "datasets/town"

// Returns the progress of a job, such as
//   "joint 7/10  loss 2.31  19 effective actions  1 min 05 s left".
// Parts that are not known are left out.
std::string ProgressText(const v1::JobProgress& progress, const v1::EpochReport& last_report);

// Returns the held-out metrics of a model's manifest in the layout of a report; empty if it has
// none.
std::string HeldOutText(const v1::ModelManifest& manifest, bool color);

// Follows a job until it ends, and shows its progress as --progress says: by default a bar on a
// terminal, otherwise a line for each epoch. Then prints its result. Ctrl-C stops watching but not
// the job, and says how to continue watching. Returns kOk if the job succeeded, kInterrupted if it
// was left running, else kFailed.
int WatchToEnd(const std::string& job, Environment& environment);

// Shows a job that has just been started. Says why no server can run it now, if none can. Then
// follows it with WatchToEnd; or, if `detach`, prints its name and how to watch it.
//   doing: such as "trains models/town"
// Returns kOk if detached, else what WatchToEnd returns.
int ShowStarted(const v1::Job& job, const std::string& doing, bool detach,
                Environment& environment);

// Names the command that watches a job.
void SayHowToWatch(const std::string& job, Environment& environment);

// Returns whether the version of a job was promoted, why, and by which figures, as whole lines;
// empty while this is not known.
std::string PromotionText(const v1::Job& job, bool color);

// Returns what tags hold: "tags/june: 1200 windows in 300 rows, 2 of 2 shards, 31 kB".
std::string TagsText(const v1::Tags& tags);

// Prints that a request is valid, and how much memory its job would take.
void PrintValid(const v1::Job& job, Environment& environment);

// Prints the result of an ended job. Returns kOk if it succeeded.
int PrintOutcome(const v1::Job& job, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_JOB_DISPLAY_H_
