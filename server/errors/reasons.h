// Every reason that an ErrorInfo of this server can have. Reasons are part of the contract: they
// are never renamed and never change their meaning. A test compares docs/reference/errors.md with
// this table.

#ifndef MANEUVER_SERVER_ERRORS_REASONS_H_
#define MANEUVER_SERVER_ERRORS_REASONS_H_

#include <concepts>
#include <string_view>

namespace maneuver::errors {

struct ReasonEntry {
  std::string_view name;
  std::string_view codes;  // codes that carry it, separated by ", "
  std::string_view meaning;
  std::string_view remedy;  // what the caller or the operator should do
};

// In the order of the page: reasons of any call, of predictions, models, datasets, jobs, and of how
// a job ended (Job.error).
inline constexpr ReasonEntry kReasons[] = {
    {"CREDENTIALS_MISSING", "UNAUTHENTICATED",
     "the server asks who calls, and the call does not say",
     "send a token, or connect with a client certificate"},
    {"TOKEN_UNKNOWN", "UNAUTHENTICATED",
     "the token, or the header around it, is wrong, or was taken back",
     "ask the operator for a token"},
    {"CERTIFICATE_NOT_LISTED", "PERMISSION_DENIED",
     "no line of the tokens file has a name of the client's certificate",
     "have the operator add one"},
    {"ROLE_MISSING", "PERMISSION_DENIED",
     "the caller does not have the role that the metadata's `role` names",
     "have the operator add it to the caller's line"},
    {"METHOD_NOT_DECLARED", "PERMISSION_DENIED",
     "the method has no row in the table of roles: a fault of the server", "report it"},
    {"RATE_LIMITED", "RESOURCE_EXHAUSTED", "the client asks for more in a second than it may",
     "wait as long as RetryInfo says"},
    {"INVALID_FIELD", "INVALID_ARGUMENT",
     "fields of the request, or of one item of a batch, make no sense",
     "correct the fields that BadRequest lists"},
    {"MALFORMED_MESSAGE", "INVALID_ARGUMENT",
     "the bytes of a request do not parse as its message, or a string in it is not UTF-8",
     "send the message that the contract names, with strings in UTF-8"},
    {"TOO_MANY_REQUESTS", "RESOURCE_EXHAUSTED", "too many requests wait for the server's disk",
     "wait as long as RetryInfo says"},
    {"STORAGE_DAMAGED", "DATA_LOSS", "the server's database, or a file of its own, is damaged",
     "have the operator restore the data folder from a back-up"},
    {"STORAGE_INACCESSIBLE", "INTERNAL",
     "the server may not read or write a file of its data folder",
     "have the operator see to the folder's owner and permissions"},
    {"SERVER_STOPS", "UNAVAILABLE", "the server is being shut down",
     "try again, at another replica or a little later"},

    {"NO_MODEL_SERVES", "FAILED_PRECONDITION",
     "no model has the alias `serving`, and the request names none",
     "train a model, or give a version the alias"},
    {"MODEL_NOT_NAMED", "FAILED_PRECONDITION",
     "several models have the alias `serving`, and the request names none", "name one in `model`"},
    {"QUEUE_FULL", "RESOURCE_EXHAUSTED", "the server has more to predict than it can",
     "wait as long as RetryInfo says; add replicas if it stays so"},
    {"DEADLINE_TOO_CLOSE", "RESOURCE_EXHAUSTED",
     "by the time that the server gets to it, the call's deadline would have passed",
     "wait as long as RetryInfo says, or allow more time; add replicas if it stays so"},
    {"TOO_MANY_TARGETS", "RESOURCE_EXHAUSTED",
     "one request has more targets than the queue has places",
     "split it; the message says into how much"},
    {"SHUTTING_DOWN", "UNAVAILABLE",
     "the server is being shut down, and takes no more of this stream",
     "open another stream, at another replica or a little later"},
    {"REQUEST_TOO_LARGE", "RESOURCE_EXHAUSTED",
     "one request has more bytes than the queue has room for",
     "split it; the message says into how much"},
    {"RESPONSE_TOO_LARGE", "RESOURCE_EXHAUSTED",
     "the answer could have more bytes than one answer may (--max-response-bytes)",
     "omit sigma trajectories, ask for fewer actions, or split the request; the message says into "
     "how much"},
    {"SEND_MEMORY_FULL", "RESOURCE_EXHAUSTED",
     "answers that their callers have not taken fill the memory for them (--max-send-memory)",
     "wait as long as RetryInfo says; read answers as they come"},
    {"ANSWER_UNSOUND", "INTERNAL",
     "the model's answer for a target is not finite or no distribution, and was withheld",
     "report the scenario, whose digest is in the server's log; ask another version"},
    {"TARGET_TYPE_NOT_LEARNED", "INVALID_ARGUMENT",
     "the model has not learned to predict agents of the target's type",
     "ask about agents that the metadata's `predicts` names, or ask another model"},
    {"MAP_NOT_REGISTERED", "FAILED_PRECONDITION",
     "the server does not hold the map in the metadata's `map_id`, or no longer",
     "register it with RegisterMap and repeat the request"},
    {"MAP_TOO_LARGE", "RESOURCE_EXHAUSTED", "the map takes more memory than all maps together may",
     "register the surroundings of the road that is driven alone"},

    {"MODEL_NOT_FOUND", "NOT_FOUND", "there is no such model",
     "ListModelVersions with models/- names those that exist"},
    {"MODEL_VERSION_NOT_FOUND", "NOT_FOUND", "there is no such version of the model",
     "ListModelVersions names those that exist"},
    {"MODEL_ALIAS_NOT_FOUND", "NOT_FOUND", "the model has no such alias",
     "point it to a version with SetModelAlias"},
    {"MODEL_DAMAGED", "FAILED_PRECONDITION", "the files of the version are damaged",
     "point the alias to another version; delete this one and train anew"},
    {"MODEL_VERSION_IN_USE", "FAILED_PRECONDITION",
     "an alias points to the version that is to be deleted",
     "point the alias elsewhere, or delete it first"},
    {"EVALUATION_NOT_FOUND", "NOT_FOUND", "the version was not evaluated on that dataset",
     "ListEvaluationReports names those that it was evaluated on; evaluate it"},
    {"EVALUATION_DAMAGED", "FAILED_PRECONDITION", "the report beside the version does not parse",
     "evaluate the version on that dataset again"},
    {"EVALUATION_OUTDATED", "FAILED_PRECONDITION",
     "the report beside the version was made by a release that compared it with no rivals",
     "evaluate the version on that dataset again"},
    {"REQUIREMENTS_NOT_MET", "FAILED_PRECONDITION",
     "the version's evaluation does not show what the call requires; the message names where",
     "leave the alias as it is, or require less"},

    {"DATASET_NOT_FOUND", "NOT_FOUND, FAILED_PRECONDITION",
     "there is no such dataset, or a job that is to go on has lost it",
     "ListDatasets names those that exist; upload it"},
    {"DATASET_EXISTS", "ALREADY_EXISTS", "there is a dataset of this name",
     "choose another name, or delete that one first"},
    {"DATASET_INVALID", "INVALID_ARGUMENT",
     "what was uploaded is no dataset, or not all of it came",
     "correct what the message says and upload again"},
    {"DATASET_DAMAGED", "DATA_LOSS",
     "the dataset's files do not have the bytes that they were stored with",
     "delete it and upload it again"},
    {"UPLOAD_CHANGED", "UNAVAILABLE",
     "less of the dataset has arrived than the header skips, or an earlier upload of it is just "
     "being checked",
     "ask QueryUpload a little later and go on from there, as the client library does"},
    {"UPLOAD_TAKEN_OVER", "ABORTED",
     "the same caller has begun another upload of this dataset, which goes on in place of this one",
     "let that one end; upload the same dataset from one place"},
    {"DATASET_IN_USE", "FAILED_PRECONDITION",
     "the job in the metadata needs the dataset that is to be deleted",
     "wait for the job, or cancel it"},
    {"SCENARIO_NOT_FOUND", "NOT_FOUND", "the dataset has no scenario of this id",
     "ListScenarios names them"},

    {"JOB_NOT_FOUND", "NOT_FOUND",
     "there is no such job, or it ended so long ago that it was forgotten",
     "ListJobs names those that exist"},
    {"JOB_NOT_ENDED", "FAILED_PRECONDITION", "the job runs, or is still being stopped",
     "cancel it, or wait until it is stopped"},
    {"JOB_NOT_RESUMABLE", "FAILED_PRECONDITION",
     "the job has ended in a state that nothing follows", "train again"},
    {"REQUEST_ID_REUSED", "ALREADY_EXISTS",
     "the request_id belongs to a different request, whose job is in the metadata",
     "choose a new one for a new job"},
    {"TOO_MANY_JOBS", "RESOURCE_EXHAUSTED", "as many jobs wait as may (--max-pending-jobs)",
     "wait as long as RetryInfo says, or cancel jobs that are no longer needed"},

    {"INVALID_SETTINGS", "INVALID_ARGUMENT", "the trainer refused the job's settings",
     "correct them and ask again"},
    {"UNUSABLE_DATA", "FAILED_PRECONDITION", "the job's data cannot be read",
     "upload the dataset again"},
    {"NOT_ENOUGH_EXAMPLES", "FAILED_PRECONDITION",
     "the datasets hold too few examples for the settings",
     "upload more, or ask for less of each example"},
    {"TRAINING_DIVERGED", "ABORTED", "the loss is no longer finite",
     "try a smaller optimization.learning_rate"},
    {"METRICS_NOT_FINITE", "ABORTED",
     "a metric of the evaluation is not finite; the message names it",
     "see whether the data or the model is damaged"},
    {"ACTIONS_COLLAPSED", "FAILED_PRECONDITION",
     "the model uses too few of its actions to be of use",
     "train with another seed, or with more data"},
    {"OUT_OF_MEMORY", "RESOURCE_EXHAUSTED",
     "the job took more memory than there is, or than it may",
     "make batch, raster or model smaller, or give it more (--job-memory-limit), and resume the "
     "job"},
    {"WALL_TIME_EXCEEDED", "DEADLINE_EXCEEDED",
     "the job ran for as long as a job may (--job-time-limit)", "resume it: it has as long again"},
    {"DISK_FULL", "RESOURCE_EXHAUSTED", "the server's disk is full",
     "free some space; resume the job or upload again"},
    {"DATASET_QUOTA", "RESOURCE_EXHAUSTED",
     "all datasets together would have more bytes than they may (--dataset-quota)",
     "delete datasets that are no longer needed"},
    {"CANNOT_WRITE", "FAILED_PRECONDITION", "the server cannot write in its data folder",
     "see to its permissions and resume the job"},
    {"MODEL_REFUSED", "any",
     "the model that was learned cannot be published; code and message say why",
     "see to what the message says and resume the job"},
    {"MODEL_UNAVAILABLE", "any",
     "the model that is to be evaluated, or started from, cannot be had; code and message say why",
     "name one that ListModelVersions lists"},
    {"TRAINER_DIED", "ABORTED",
     "the trainer was killed or crashed; the metadata's `signal` says by what",
     "resume the job, with more memory if it was that"},
    {"TRAINER_INTERNAL", "INTERNAL",
     "the trainer failed by a fault of its own, or cannot be started",
     "see its log in the job's folder, and report it"},
    {"SERVER_INTERRUPTED", "ABORTED", "the server stopped while the job ran",
     "none: the job goes on when the server is back"},
};

constexpr bool IsListed(std::string_view name) {
  for (const ReasonEntry& entry : kReasons) {
    if (entry.name == name) return true;
  }
  return false;
}

// Deliberately undefined: calling it makes the compiler's error message say what is wrong.
void ThisReasonIsNotListedInReasonsH();

// The name of an entry of the table. Any other name does not compile.
class Reason {
 public:
  template <std::convertible_to<std::string_view> Text>
  consteval Reason(const Text& name) : name_(name) {  // NOLINT(google-explicit-constructor)
    if (!IsListed(name_)) ThisReasonIsNotListedInReasonsH();
  }
  constexpr std::string_view name() const { return name_; }

 private:
  std::string_view name_;
};

}  // namespace maneuver::errors

#endif  // MANEUVER_SERVER_ERRORS_REASONS_H_
