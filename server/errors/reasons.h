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

// In the order of the page: reasons of any call, of predictions, models, datasets, tags, jobs, and
// how a job ended (Job.error).
inline constexpr ReasonEntry kReasons[] = {
    {"CREDENTIALS_MISSING", "UNAUTHENTICATED",
     "the server requires authentication, and the call has none",
     "send a token, or connect with a client certificate"},
    {"TOKEN_UNKNOWN", "UNAUTHENTICATED",
     "the token, or the header around it, is wrong, was taken back or has expired",
     "ask the operator for a token"},
    {"CERTIFICATE_NOT_LISTED", "PERMISSION_DENIED",
     "no line of the tokens file has a name of the client's certificate",
     "have the operator add one"},
    {"ROLE_MISSING", "PERMISSION_DENIED",
     "the caller does not have the role that the metadata's `role` names",
     "have the operator add it to the caller's line"},
    {"METHOD_NOT_DECLARED", "PERMISSION_DENIED",
     "the method has no row in the table of roles: a fault of the server", "report it"},
    {"RATE_LIMITED", "RESOURCE_EXHAUSTED", "the client exceeds its rate limit",
     "wait as long as RetryInfo says"},
    {"INVALID_FIELD", "INVALID_ARGUMENT",
     "fields of the request, or of one item of a batch, are invalid",
     "correct the fields that BadRequest lists"},
    {"MALFORMED_MESSAGE", "INVALID_ARGUMENT",
     "the bytes of a request do not parse, or a string in it is not UTF-8",
     "send the message that the contract names, with strings in UTF-8"},
    {"TOO_MANY_REQUESTS", "RESOURCE_EXHAUSTED",
     "too many requests wait for the server's disk, or too many outcomes for being scored",
     "wait as long as RetryInfo says"},
    {"STORAGE_DAMAGED", "DATA_LOSS", "the server's database, or a file of its own, is damaged",
     "have the operator restore the data folder from a back-up"},
    {"STORAGE_INACCESSIBLE", "INTERNAL",
     "the server lacks permission to read or write a file of its data folder",
     "have the operator correct the folder's owner and permissions"},
    {"STORE_UNAVAILABLE", "UNAVAILABLE",
     "the server cannot use its database of jobs and aliases: it cannot be reached (--store), its "
     "disk fails, or another server uses it",
     "wait as long as RetryInfo says; predictions go on meanwhile"},
    {"FOLDER_UNAVAILABLE", "UNAVAILABLE",
     "the file system of the server's data folder, or of the part in the metadata's `folder`, "
     "fails "
     "or is away",
     "wait as long as RetryInfo says; have the operator see to the disk or the mount if it goes "
     "on; "
     "predictions go on meanwhile"},
    {"SERVER_STOPS", "UNAVAILABLE", "the server is being shut down",
     "retry at another replica or a little later"},

    {"NO_MODEL_SERVES", "FAILED_PRECONDITION",
     "no model has the alias `serving`, and the request names none",
     "train a model, or give a version the alias"},
    {"PREDICTIONS_ELSEWHERE", "FAILED_PRECONDITION",
     "the server is one of several, and its role (--role) leaves predictions to others",
     "ask a server with --role serve or --role all; balance calls by PredictionService's health"},
    {"MODEL_NOT_NAMED", "FAILED_PRECONDITION",
     "several models have the alias `serving`, and the request names none", "name one in `model`"},
    {"QUEUE_FULL", "RESOURCE_EXHAUSTED", "the server's queue is full",
     "wait as long as RetryInfo says; add replicas if it continues"},
    {"DEADLINE_TOO_CLOSE", "RESOURCE_EXHAUSTED",
     "the call's deadline would pass before the server could answer",
     "wait as long as RetryInfo says, or allow more time; add replicas if it continues"},
    {"TOO_MANY_TARGETS", "RESOURCE_EXHAUSTED",
     "one request has more targets than fit into the queue",
     "split it; the message says into how much"},
    {"SHUTTING_DOWN", "UNAVAILABLE",
     "the server is being shut down, and accepts no more requests of this stream",
     "open another stream, at another replica or a little later"},
    {"REQUEST_TOO_LARGE", "RESOURCE_EXHAUSTED",
     "one request has more bytes than fit into the queue, or than one of its method may have",
     "split it; the message says into how much"},
    {"REQUEST_TOO_SLOW", "DEADLINE_EXCEEDED",
     "the request took longer to arrive than it may (--request-timeout)",
     "send all of the request at once, or send less"},
    {"RESPONSE_TOO_LARGE", "RESOURCE_EXHAUSTED",
     "the answer is, or could be, larger than the limit of one answer (--max-response-bytes)",
     "omit sigma trajectories, ask for fewer actions, or split the request, as the message says; "
     "of a list, ask for a smaller page"},
    {"SEND_MEMORY_FULL", "RESOURCE_EXHAUSTED",
     "answers that callers have not read fill the memory for answers (--max-send-memory)",
     "wait as long as RetryInfo says; read answers as they come"},
    {"MEMORY_FULL", "RESOURCE_EXHAUSTED",
     "the server uses nearly all the memory that it may use (--memory-limit)",
     "wait as long as RetryInfo says; read answers as they come"},
    {"ANSWER_UNSOUND", "INTERNAL",
     "the model's answer for a target is not finite or not a distribution, and was withheld",
     "report the scenario, whose digest is in the server's log (of ten such a second); ask another "
     "version"},
    {"ENGINE_FAILED", "INTERNAL",
     "a library under the model's networks failed, for example for want of memory",
     "repeat the request, with fewer targets if memory is short; the server's log has more"},
    {"TARGET_TYPE_NOT_LEARNED", "INVALID_ARGUMENT",
     "the model has not learned to predict agents of the target's type",
     "ask about agents that the metadata's `predicts` names, or ask another model"},
    {"MAP_NOT_REGISTERED", "FAILED_PRECONDITION",
     "the server does not have the map in the metadata's `map_id`, or has dropped it",
     "register it with RegisterMap and repeat the request"},
    {"ACTION_NAME_GONE", "FAILED_PRECONDITION",
     "the version lacks some of the required_action_names: the metadata's `action_name_0`, "
     "`action_name_1` and so on",
     "list the actions of `model_version` with GetActionSet and require their names, or give one "
     "the missing name with LabelAction"},
    {"OUTCOMES_NOT_COLLECTED", "FAILED_PRECONDITION",
     "the server collects no outcomes, or none has been reported with its scene",
     "report outcomes with their scenes; have the operator start the server with "
     "--outcome-recordings"},
    {"ANSWER_NOT_KEPT", "NOT_FOUND",
     "the server does not keep the answer whose outcome is reported: it was never given by this "
     "server, is already scored, or made room for newer ones (--outcome-memory)",
     "report the scene in place of its id, or report sooner"},
    {"MAP_TOO_LARGE", "RESOURCE_EXHAUSTED", "the map needs more memory than the limit for all maps",
     "register only the surroundings of the road that is driven"},

    {"MODEL_NOT_FOUND", "NOT_FOUND", "there is no such model",
     "ListModelVersions with models/- names those that exist"},
    {"MODEL_VERSION_NOT_FOUND", "NOT_FOUND", "there is no such version of the model",
     "ListModelVersions names those that exist"},
    {"MODEL_ALIAS_NOT_FOUND", "NOT_FOUND", "the model has no such alias",
     "name one of the aliases in the message, or point it to a version with SetModelAlias"},
    {"MODEL_DAMAGED", "FAILED_PRECONDITION", "the files of the version are damaged",
     "point the alias to another version; delete this one and train again"},
    {"MODEL_INVALID", "INVALID_ARGUMENT, DATA_LOSS",
     "the upload is not a model that can be served, was altered on its way, or is incomplete",
     "correct what the message says and upload again"},
    {"MODEL_VERSION_IN_USE", "FAILED_PRECONDITION",
     "an alias points to the version that is to be deleted",
     "point the alias to another version with SetModelAlias, or remove it with DeleteModelAlias"},
    {"EVALUATION_NOT_FOUND", "NOT_FOUND", "the version was not evaluated on that dataset",
     "ListEvaluationReports names those that it was evaluated on; evaluate it"},
    {"EVALUATION_DAMAGED", "FAILED_PRECONDITION", "the report beside the version does not parse",
     "evaluate the version on that dataset again"},
    {"EVALUATION_OUTDATED", "FAILED_PRECONDITION",
     "the report beside the version is from a release that did not compare with rivals",
     "evaluate the version on that dataset again"},
    {"REQUIREMENTS_NOT_MET", "FAILED_PRECONDITION",
     "the version's evaluation does not meet the call's requirements; the message names the strata",
     "leave the alias as it is, or require less"},

    {"DATASET_NOT_FOUND", "NOT_FOUND, FAILED_PRECONDITION",
     "there is no such dataset, or the dataset of a job that is resumed is gone",
     "ListDatasets names those that exist; upload it"},
    {"DATASET_EXISTS", "ALREADY_EXISTS", "there is a dataset of this name",
     "choose another name, or delete that one first"},
    {"FOLDER_NOT_ALLOWED", "PERMISSION_DENIED",
     "the folder to register does not lie in a folder that the server allows (--dataset-folders)",
     "register a folder that does, upload the dataset, or change the server's configuration"},
    {"DATASET_INVALID", "INVALID_ARGUMENT", "the upload is not a dataset, or is incomplete",
     "correct what the message says and upload again"},
    {"DATASET_DAMAGED", "DATA_LOSS",
     "the dataset's files have changed since they were stored, or are gone",
     "delete it and upload it again"},
    {"UPLOAD_CHANGED", "UNAVAILABLE",
     "less has arrived than the header skips, or an earlier upload of the same is just being "
     "checked",
     "ask QueryUpload, or QueryModelUpload, a little later and go on from there, as the client "
     "library does"},
    {"UPLOAD_TAKEN_OVER", "ABORTED",
     "the same caller has begun another upload of this dataset, or to this model, which replaces "
     "this one",
     "wait for it, and upload from one place only"},
    {"DATASET_IN_USE", "FAILED_PRECONDITION",
     "the job in the metadata needs the dataset that is to be deleted",
     "wait for the job, or cancel it"},
    {"SCENARIO_NOT_FOUND", "NOT_FOUND", "the dataset has no scenario of this id",
     "ListScenarios names them"},

    {"TAGS_NOT_FOUND", "NOT_FOUND", "there are no such tags", "ListTags names those that exist"},
    {"TAGS_EXIST", "ALREADY_EXISTS",
     "tags of this name exist with another version, datasets, windows or stride",
     "choose another name, or delete them first"},
    {"TAGS_IN_USE", "FAILED_PRECONDITION",
     "the job in the metadata writes the tags that are to be deleted",
     "wait for the job, or cancel it"},
    {"TAGS_NOT_BEGUN", "FAILED_PRECONDITION", "no job has begun to write the tags",
     "wait until the job runs"},
    {"TAGS_DAMAGED", "DATA_LOSS", "a file of the tags is damaged", "delete them and tag again"},
    {"TAG_QUOTA", "RESOURCE_EXHAUSTED", "all tags together would exceed their quota (--tag-quota)",
     "delete tags that are no longer needed; tag or resume the job again"},

    {"JOB_NOT_FOUND", "NOT_FOUND", "there is no such job, or it ended long ago and was removed",
     "ListJobs names those that exist"},
    {"JOB_NOT_ENDED", "FAILED_PRECONDITION", "the job runs, or is still being stopped",
     "cancel it, or wait until it is stopped"},
    {"JOB_NOT_RESUMABLE", "FAILED_PRECONDITION", "the job succeeded, so there is nothing to resume",
     "train again"},
    {"REQUEST_ID_REUSED", "ALREADY_EXISTS",
     "the request_id belongs to a different request, whose job is in the metadata",
     "choose a new one for a new job"},
    {"TOO_MANY_JOBS", "RESOURCE_EXHAUSTED", "too many jobs wait already (--max-pending-jobs)",
     "wait as long as RetryInfo says, or cancel jobs that are no longer needed"},

    {"NO_WORKER", "FAILED_PRECONDITION",
     "the job waits, and no live server has the device, the ranks or the memory that it needs",
     "start a server that has (--role work); the job then starts by itself"},
    {"INVALID_SETTINGS", "INVALID_ARGUMENT", "the trainer refused the job's settings",
     "correct them and create the job again"},
    {"UNUSABLE_DATA", "FAILED_PRECONDITION", "the job's data cannot be read",
     "upload the dataset again"},
    {"NOT_ENOUGH_EXAMPLES", "FAILED_PRECONDITION",
     "the datasets hold too few examples for the settings",
     "upload more data, or require less of each example"},
    {"TRAINING_DIVERGED", "ABORTED", "the loss is no longer finite",
     "try a smaller optimization.learning_rate"},
    {"METRICS_NOT_FINITE", "ABORTED",
     "a metric of the evaluation is not finite; the message names it",
     "see whether the data or the model is damaged"},
    {"ACTIONS_COLLAPSED", "FAILED_PRECONDITION",
     "the model uses too few of its actions (--job-least-actions)",
     "train with another seed, or with more data"},
    {"OUT_OF_MEMORY", "RESOURCE_EXHAUSTED",
     "the job needed more memory than the machine or its limit has",
     "make batch, raster or model smaller, or raise --job-memory-limit, and resume the job"},
    {"WALL_TIME_EXCEEDED", "DEADLINE_EXCEEDED", "the job reached its time limit (--job-time-limit)",
     "resume it; its time starts again"},
    {"DISK_FULL", "RESOURCE_EXHAUSTED", "the server's disk is full",
     "free some space; resume the job or upload again"},
    {"DATASET_QUOTA", "RESOURCE_EXHAUSTED",
     "all datasets together would exceed their quota (--dataset-quota)",
     "delete datasets that are no longer needed"},
    {"CANNOT_WRITE", "FAILED_PRECONDITION", "the server cannot write in its data folder",
     "correct its permissions and resume the job"},
    {"MODEL_REFUSED", "any", "the trained model cannot be published; code and message say why",
     "correct what the message says and resume the job"},
    {"MODEL_UNAVAILABLE", "any",
     "the model to evaluate or to start from cannot be loaded; code and message say why",
     "name one that ListModelVersions lists"},
    {"RANK_LOST", "UNAVAILABLE", "a process of a training ended or did not answer",
     "resume the job"},
    {"TRAINER_DIED", "ABORTED",
     "the trainer was killed or crashed; the metadata's `signal` says by what",
     "resume the job; give it more memory if that was the cause"},
    {"TRAINER_INTERNAL", "INTERNAL",
     "the trainer failed through a fault of its own, or cannot be started",
     "look at its log in the job's folder, and report it"},
    {"SERVER_INTERRUPTED", "ABORTED", "the server stopped while the job ran",
     "none: the job continues when the server is back"},
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
