"""The client of a Maneuver server. See Client."""

from __future__ import annotations

import os
import pathlib
import uuid
from typing import Any, Callable, Iterable, Iterator, Mapping, Optional, Sequence, TypeVar, Union

import grpc
from google.protobuf import empty_pb2, json_format, wrappers_pb2
from google.protobuf.message import Message

from maneuver import downloads, v1
from maneuver.answers import ActionSet, action_set_of
from maneuver.connection import Connection, Deadlines
from maneuver.credentials import Tls
from maneuver.errors import ManeuverError, UnavailableError, error, from_rpc, from_status
from maneuver.jobs import Watch, has_ended
from maneuver.model_transfers import ModelUpload
from maneuver.outcomes import stream_reports
from maneuver.predictor import PredictionRequest, Predictor
from maneuver.retry import Clock, OnRetry, RetryPolicy
from maneuver.scenes import MapFeature, map_to_proto
from maneuver.stream import OnAnswer, PredictStream
from maneuver.uploads import DatasetUpload, OnUploaded

_Message = TypeVar("_Message", bound=Message)
_Response = TypeVar("_Response")

# A message, or a dict as the contract's JSON has it.
Settings = Union[v1.TrainingSettings, Mapping[str, Any]]


def _message(value: Union[_Message, Mapping[str, Any], None], kind: "type[_Message]") -> _Message:
    """Returns the message of a dict. Raises ValueError for what does not parse."""
    if isinstance(value, kind):
        return value
    try:
        message: _Message = json_format.ParseDict(value or {}, kind())
    except (json_format.ParseError, TypeError) as failure:
        raise ValueError(f"no {kind.DESCRIPTOR.name}: {failure}") from None
    return message


def _report(outcomes: Sequence[Union[v1.Outcome, Mapping[str, Any]]], model: str,
            request_id: str = "") -> v1.ReportOutcomesRequest:
    return v1.ReportOutcomesRequest(
        model=model, outcomes=[_message(outcome, v1.Outcome) for outcome in outcomes],
        request_id=request_id or uuid.uuid4().hex)


class Client(Predictor):
    """A connection to one server, or to each of several. Thread-safe.

        with maneuver.Client("127.0.0.1:8470") as client:
            answer = client.predict(scene, model="models/town").target()
            print(answer.probabilities, answer.mean_trajectories.shape)

    address: HOST:PORT or unix:PATH. Several servers that answer alike: IP:PORT,IP:PORT, or
        dns:///NAME:PORT for all addresses of a name. Calls then go to them in turn, predictions to
        those whose health says that a model is ready; what changes something should name one.
    tls: None for plain text.
    token, token_file: says who calls, where the server asks for that. Sent over TLS, or within
        this machine, alone.
    deadline: seconds for a call with all its attempts, other than uploads and streams, which keep
        their defaults; or Deadlines for each kind of call. A call's `timeout` takes its place.
    retries: how often a call that failed is tried again, or a RetryPolicy. Calls that are safe to
        repeat are: all but deletions and collect_outcomes. train, evaluate, cross_validate,
        recalibrate, tag and report_outcomes are safe because they carry a request_id; one is made
        up where the caller gives none.
    on_retry: told before each wait.

    The constructor does not wait for the server: the first call connects. It raises ValueError for
    options that make no sense, and OSError for files that cannot be read.

    Every method raises ManeuverError (maneuver.errors) if its call fails. Managing models, datasets
    and jobs returns the contract's messages, `maneuver.v1`, whose fields the protos explain.
    """

    def __init__(self, address: str = "127.0.0.1:8470", *, tls: Optional[Tls] = None,
                 token: str = "", token_file: str = "",
                 deadline: Union[float, Deadlines] = Deadlines(),
                 retries: Union[int, RetryPolicy] = RetryPolicy(),
                 on_retry: Optional[OnRetry] = None, clock: Clock = Clock()) -> None:
        if not isinstance(deadline, Deadlines):
            deadline = Deadlines(prediction=deadline, management=deadline)
        if not isinstance(retries, RetryPolicy):
            retries = RetryPolicy(max_attempts=retries + 1)
        self._connection = Connection(address, tls, token, token_file, deadline, retries, on_retry,
                                      clock)

    def close(self) -> None:
        """Ends the connection and every call on it."""
        self._connection.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Predictions: see Predictor for the questions.

    def register_map(self, map_features: Sequence[Union[MapFeature, v1.MapFeature]], *,
                     timeout: Optional[float] = None) -> str:
        """Gives the server a map to hold, and returns its id for Scenario.map_id.

        MapReuse does it by itself. A server forgets maps that were not used for longest.
        """
        request = v1.RegisterMapRequest(map_features=map_to_proto(map_features))
        return self.ask_until("RegisterMap", request, self.deadline(timeout),
                              v1.RegisterMapResponse).map_id

    def stream_predict(self, on_answer: OnAnswer, *,
                       timeout: Optional[float] = None) -> PredictStream:
        """Opens a stream of predictions; see PredictStream.

        timeout: seconds for the whole stream, in place of Deadlines.stream.
        """
        default = self._connection.deadlines.stream
        return PredictStream(self._connection, on_answer,
                             self._connection.left(self._connection.deadline(timeout, default)))

    def deadline(self, timeout: Optional[float]) -> float:
        """Returns the time on the client's clock when a prediction that starts now has to end."""
        return self._connection.deadline(timeout, self._connection.deadlines.prediction)

    def ask_until(self, method: str, request: Message, deadline: float,
                  response: "type[_Response]") -> _Response:
        """Calls a method of PredictionService, by its name in the contract."""
        stub: Callable[..., _Response] = getattr(self._connection.predictions, method)
        return self._connection.call(stub, request, deadline)

    def _ask(self, method: str, request: PredictionRequest, timeout: Optional[float],
             response: "type[_Response]") -> _Response:
        return self.ask_until(method, request, self.deadline(timeout), response)

    # What really happened.

    def report_outcomes(self, outcomes: Sequence[Union[v1.Outcome, Mapping[str, Any]]], *,
                        model: str = "", request_id: str = "",
                        timeout: Optional[float] = None) -> v1.ReportOutcomesResponse:
        """Reports what followed predictions, and returns their scores; the server counts them.

        outcomes: messages, or dicts as the contract's JSON has them. Each fails alone: look at the
            `error` of each score and of each of its targets.
        model: of scenes whose outcome names none.
        """
        request = _report(outcomes, model, request_id)
        deadline = self._connection.deadline(timeout, self._connection.deadlines.management)
        response: v1.ReportOutcomesResponse = self._connection.call(
            self._connection.outcomes.ReportOutcomes, request, deadline)
        return response

    def stream_outcomes(
            self, reports: Iterable[Sequence[Union[v1.Outcome, Mapping[str, Any]]]], *,
            model: str = "", timeout: Optional[float] = None
    ) -> Iterator[Union[v1.ReportOutcomesResponse, ManeuverError]]:
        """Reports what followed many predictions over one stream.

        reports: each has the outcomes of one report_outcomes, at most 256 targets. They are taken
            as the server gets on: at most four are on their way.
        Yields for each report, in order, its scores, or the error of a report that was refused.
        When the stream breaks, it sends those that have no answer again, as an upload goes on. When
        the server has too much to do for a report, it waits and sends that one again. The server
        counts each once.
        timeout: seconds for the whole stream, in place of Deadlines.upload.
        """
        deadline = self._connection.deadline(timeout, self._connection.deadlines.upload)
        return stream_reports(self._connection,
                              (_report(outcomes, model) for outcomes in reports), deadline)

    def collect_outcomes(self, dataset: str, *, forget: bool = False,
                         timeout: Optional[float] = None) -> v1.CollectOutcomesResponse:
        """Makes datasets/{dataset} of the outcomes that the server collected.

        forget: remove them from the collection, so that the next dataset holds only later ones.
        Not retried: a server whose answer was lost may have made the dataset.
        """
        deadline = self._connection.deadline(timeout, self._connection.deadlines.upload)
        response: v1.CollectOutcomesResponse = self._connection.call(
            self._connection.outcomes.CollectOutcomes,
            v1.CollectOutcomesRequest(dataset=dataset, forget=forget), deadline, repeatable=False)
        return response

    # Models.

    def list_model_versions(self, parent: str = "models/-", *,
                            timeout: Optional[float] = None) -> Iterator[v1.ModelVersion]:
        """Yields the versions of a model, or of all with models/-, newest first.

        timeout: for each page.
        """
        return self._pages(
            self._connection.models.ListModelVersions,
            v1.ListModelVersionsRequest(parent=parent), "model_versions", timeout)

    def get_model_version(self, name: str, *, timeout: Optional[float] = None) -> v1.ModelVersion:
        """Returns models/{model}/versions/{version}, models/{model}@{alias} or models/{model}."""
        return self._manage(
            v1.ModelVersion, self._connection.models.GetModelVersion,
            v1.GetModelVersionRequest(name=name), timeout)

    def list_replicas(self, *, timeout: Optional[float] = None) -> Sequence[v1.Replica]:
        """Returns the servers that share a store, with the versions that each has loaded."""
        answer = self._manage(
            v1.ListReplicasResponse, self._connection.replicas.ListReplicas,
            v1.ListReplicasRequest(), timeout)
        return list(answer.replicas)

    def delete_model_version(self, name: str, *, timeout: Optional[float] = None) -> None:
        """Removes a version. Refused while an alias points to it."""
        self._delete(
            self._connection.models.DeleteModelVersion, v1.DeleteModelVersionRequest(name=name),
            timeout)

    def set_model_alias(self, name: str, model_version: str, *,
                        requirements: Sequence[v1.RivalRequirement] = (), dataset: str = "",
                        timeout: Optional[float] = None) -> v1.ModelAlias:
        """Points models/{model}/aliases/{alias} to a version; pointing `serving` promotes it.

        requirements: what the newest report of the version on `dataset` must show.
        """
        request = v1.SetModelAliasRequest(name=name, model_version=model_version,
                                          requirements=requirements, dataset=dataset)
        return self._manage(
            v1.ModelAlias, self._connection.models.SetModelAlias, request, timeout)

    def delete_model_alias(self, name: str, *, timeout: Optional[float] = None) -> None:
        """Removes an alias."""
        self._delete(
            self._connection.models.DeleteModelAlias, v1.DeleteModelAliasRequest(name=name),
            timeout)

    def get_action_set(self, name: str = "", *, speed: Optional[float] = None,
                       timeout: Optional[float] = None) -> ActionSet:
        """Returns the generic actions of a version; empty: of the only serving model.

        speed: at which the actions are drawn, m/s, 0 to 100, for models whose trajectories are
            relative to the present motion; 10 if None.
        """
        request = v1.GetActionSetRequest(name=name)
        if speed is not None:
            request.speed = speed
        return action_set_of(self._manage(
            v1.ActionSet, self._connection.models.GetActionSet, request, timeout))

    def label_action(self, name: str, action_id: int, label: str, *,
                     timeout: Optional[float] = None) -> v1.Action:
        """Gives an action of models/{model}/versions/{version} a name for people."""
        return self._manage(
            v1.Action, self._connection.models.LabelAction,
            v1.LabelActionRequest(name=name, action_id=action_id, label=label), timeout)

    def list_evaluation_reports(self, parent: str, *, timeout: Optional[float] = None
                                ) -> Iterator[v1.EvaluationReport]:
        """Yields what a version was evaluated on, newest first. timeout: for each page."""
        return self._pages(
            self._connection.models.ListEvaluationReports,
            v1.ListEvaluationReportsRequest(parent=parent), "evaluation_reports", timeout)

    def get_evaluation_report(self, name: str, *,
                              timeout: Optional[float] = None) -> v1.EvaluationReport:
        """Returns models/{model}/versions/{version}/evaluations/{evaluation}."""
        return self._manage(
            v1.EvaluationReport, self._connection.models.GetEvaluationReport,
            v1.GetEvaluationReportRequest(name=name), timeout)

    def upload_model_version(self, folder: Union[str, "os.PathLike[str]"], parent: str, *,
                             on_progress: Optional[OnUploaded] = None,
                             timeout: Optional[float] = None) -> v1.ModelVersion:
        """Pushes a folder with model.json and weights.safetensors as a version of models/{model}.

        The server gives the version its number, and it has no alias yet: see set_model_alias. What
        has arrived, by this call or an earlier one, is not sent again; a version of just these
        files is returned as it is. Raises OSError, before anything is sent, if the folder is not
        whole.
        """
        upload = ModelUpload(self._connection, pathlib.Path(folder), parent, on_progress)
        return upload.run(self._connection.deadline(timeout, self._connection.deadlines.upload))

    def download_model_version(self, name: str, folder: Union[str, "os.PathLike[str]"], *,
                               on_progress: Optional[OnUploaded] = None,
                               timeout: Optional[float] = None) -> str:
        """Pulls a version, named as for get_model_version, into a new folder; returns its name.

        The folder appears once its files are whole and their SHA-256 is right. Until then what has
        arrived lies beside it in .FOLDER.part, where the same call goes on after an error. Raises
        FileExistsError if the folder holds anything but this version, and OSError if it cannot be
        written.
        """
        download = downloads.FileDownload(self._connection,
                                          downloads.model_version(self._connection), name,
                                          pathlib.Path(folder), on_progress)
        return download.run(self._connection.deadline(timeout, self._connection.deadlines.upload))

    # Datasets.

    def upload_dataset(self, folder: Union[str, "os.PathLike[str]"], name: str, *,
                       on_progress: Optional[OnUploaded] = None,
                       timeout: Optional[float] = None) -> v1.Dataset:
        """Uploads a folder with dataset.json and its shards as datasets/{dataset} `name`.

        Returns once it is committed. What has arrived, by this call or an earlier one, is not sent
        again. Raises OSError or ValueError, before anything is sent, if the folder is not whole.
        """
        upload = DatasetUpload(self._connection, pathlib.Path(folder), name, on_progress)
        return upload.run(self._connection.deadline(timeout, self._connection.deadlines.upload))

    def register_dataset(self, name: str, folder: str, *,
                         timeout: Optional[float] = None) -> v1.Dataset:
        """Makes a folder on the server's disk datasets/{dataset} `name`, in place.

        The server reads and verifies all of it first. Administrators may call this, for folders that
        the server's option --dataset-folders allows.
        """
        if timeout is None:
            timeout = self._connection.deadlines.upload
        return self._manage(
            v1.Dataset, self._connection.datasets.RegisterDataset,
            v1.RegisterDatasetRequest(name=name, folder=folder), timeout)

    def list_datasets(self, *, timeout: Optional[float] = None) -> Iterator[v1.Dataset]:
        """Yields all datasets, by name. timeout: for each page."""
        return self._pages(
            self._connection.datasets.ListDatasets, v1.ListDatasetsRequest(), "datasets", timeout)

    def get_dataset(self, name: str, *, timeout: Optional[float] = None) -> v1.Dataset:
        """Returns datasets/{dataset}."""
        return self._manage(
            v1.Dataset, self._connection.datasets.GetDataset, v1.GetDatasetRequest(name=name),
            timeout)

    def describe_dataset(self, name: str, *, examples: Union[v1.ExampleSettings, Mapping[str, Any],
                                                             None] = None,
                         timeout: Optional[float] = None) -> v1.DatasetSummary:
        """Counts what is in a dataset, with examples as `examples` says.

        The server reads the whole dataset, once. timeout: in place of Deadlines.upload.
        """
        request = v1.DescribeDatasetRequest(name=name,
                                            examples=_message(examples, v1.ExampleSettings))
        deadline = self._connection.deadline(timeout, self._connection.deadlines.upload)
        summary: v1.DatasetSummary = self._connection.call(
            self._connection.datasets.DescribeDataset, request, deadline)
        return summary

    def delete_dataset(self, name: str, *, timeout: Optional[float] = None) -> None:
        """Removes a dataset. Refused while a job that is pending or running needs it."""
        self._delete(
            self._connection.datasets.DeleteDataset, v1.DeleteDatasetRequest(name=name), timeout)

    def list_scenarios(self, dataset: str, *, timeout: Optional[float] = None
                       ) -> Iterator[v1.ScenarioSummary]:
        """Yields the recordings of datasets/{dataset}, without their contents.

        timeout: for each page.
        """
        return self._pages(
            self._connection.datasets.ListScenarios, v1.ListScenariosRequest(parent=dataset),
            "scenarios", timeout)

    def get_scenario(self, dataset: str, scenario_id: str, *,
                     timeout: Optional[float] = None) -> v1.Scenario:
        """Returns one recording, whole."""
        return self._manage(
            v1.Scenario, self._connection.datasets.GetScenario,
            v1.GetScenarioRequest(parent=dataset, scenario_id=scenario_id), timeout)

    # Jobs.

    def train(self, model: str, datasets: Sequence[str], settings: Optional[Settings] = None, *,
              promotion: "v1.Promotion.ValueType" = v1.PROMOTION_UNSPECIFIED,
              promotion_criteria: Optional[v1.PromotionCriteria] = None, start_from: str = "",
              priority: int = 0, ranks: int = 0, validate_only: bool = False, request_id: str = "",
              timeout: Optional[float] = None) -> v1.Job:
        """Starts learning a new version of models/{model}; returns the job at once.

        datasets: datasets/{dataset} to learn from, one or more. settings: what differs from the
        preset's, as TrainingSettings or its JSON. The rest is as in TrainRequest.
        """
        request = v1.TrainRequest(
            model=model, datasets=datasets, settings=_message(settings, v1.TrainingSettings),
            promotion=promotion, promotion_criteria=promotion_criteria, start_from=start_from,
            priority=priority, ranks=ranks, validate_only=validate_only,
            request_id=request_id or uuid.uuid4().hex)
        return self._manage(v1.Job, self._connection.training.Train, request, timeout)

    def evaluate(self, model: str, dataset: str, *,
                 examples: Union[v1.ExampleSettings, Mapping[str, Any], None] = None,
                 sampled_examples: int = 0, priority: int = 0, validate_only: bool = False,
                 request_id: str = "", timeout: Optional[float] = None) -> v1.Job:
        """Starts measuring a version on datasets/{dataset}; returns the job at once.

        The report is in `evaluation` of the job that has ended. The rest is as in EvaluateRequest.
        """
        request = v1.EvaluateRequest(
            model=model, dataset=dataset, examples=_message(examples, v1.ExampleSettings),
            sampled_examples=sampled_examples, priority=priority, validate_only=validate_only,
            request_id=request_id or uuid.uuid4().hex)
        return self._manage(v1.Job, self._connection.training.Evaluate, request, timeout)

    def cross_validate(self, request: v1.CrossValidateRequest, *,
                       timeout: Optional[float] = None) -> v1.Job:
        """Starts measuring settings on whole datasets; returns the job at once."""
        mine = v1.CrossValidateRequest()
        mine.CopyFrom(request)
        mine.request_id = mine.request_id or uuid.uuid4().hex
        return self._manage(v1.Job, self._connection.training.CrossValidate, mine, timeout)

    def recalibrate(self, model: str, datasets: Sequence[str], *,
                    examples: Union[v1.ExampleSettings, Mapping[str, Any], None] = None,
                    promotion: "v1.Promotion.ValueType" = v1.PROMOTION_UNSPECIFIED,
                    promotion_criteria: Optional[v1.PromotionCriteria] = None, priority: int = 0,
                    validate_only: bool = False, request_id: str = "",
                    timeout: Optional[float] = None) -> v1.Job:
        """Starts fitting a version's widths to what happened since; returns the job at once.

        datasets: datasets/{dataset} that the version did not learn from. The new version is
        `model_version` of the job that has ended. The rest is as in RecalibrateRequest.
        """
        request = v1.RecalibrateRequest(
            model=model, datasets=datasets, examples=_message(examples, v1.ExampleSettings),
            promotion=promotion, promotion_criteria=promotion_criteria, priority=priority,
            validate_only=validate_only, request_id=request_id or uuid.uuid4().hex)
        return self._manage(v1.Job, self._connection.training.Recalibrate, request, timeout)

    def tag(self, model: str, datasets: Sequence[str], tags: str, *, part: int = 0, parts: int = 1,
            windows: bool = False, stride: Optional[float] = None, priority: int = 0,
            validate_only: bool = False, request_id: str = "",
            timeout: Optional[float] = None) -> v1.Job:
        """Starts tagging datasets/{dataset} into tags/{tags}; returns the job at once.

        stride: seconds between two windows of a target; None: as in the model's training. The rest
        is as in TagRequest.
        """
        request = v1.TagRequest(
            model=model, datasets=datasets, tags=tags, part=part, parts=parts, windows=windows,
            priority=priority, validate_only=validate_only,
            request_id=request_id or uuid.uuid4().hex)
        if stride is not None:
            request.stride.FromNanoseconds(round(stride * 1e9))
        return self._manage(v1.Job, self._connection.training.Tag, request, timeout)

    def get_job(self, name: str, *, timeout: Optional[float] = None) -> v1.Job:
        """Returns jobs/{job}."""
        return self._manage(
            v1.Job, self._connection.training.GetJob, v1.GetJobRequest(name=name), timeout)

    def list_jobs(self, *, timeout: Optional[float] = None) -> Iterator[v1.Job]:
        """Yields all jobs, newest first. timeout: for each page.

        Of a job whose record on the server is damaged, only name and error are set.
        """
        return self._pages(
            self._connection.training.ListJobs, v1.ListJobsRequest(), "jobs", timeout)

    def cancel_job(self, name: str, *, timeout: Optional[float] = None) -> v1.Job:
        """Stops a job that is pending or running. Has no effect on one that ended."""
        return self._manage(
            v1.Job, self._connection.training.CancelJob, v1.CancelJobRequest(name=name), timeout)

    def resume_job(self, name: str, *, timeout: Optional[float] = None) -> v1.Job:
        """Makes a job that failed or was cancelled go on from its last checkpoint."""
        return self._manage(
            v1.Job, self._connection.training.ResumeJob, v1.ResumeJobRequest(name=name), timeout)

    def delete_job(self, name: str, *, timeout: Optional[float] = None) -> None:
        """Forgets a job that ended. What it made stays."""
        self._delete(self._connection.training.DeleteJob, v1.DeleteJobRequest(name=name), timeout)

    def watch_job(self, name: str, *, after_sequence: int = 0,
                  timeout: Optional[float] = None) -> Iterator[v1.Job]:
        """Yields the job at each event after that sequence number; the last one has ended.

        Each event comes once: a broken stream is picked up after the last one, for a minute after
        the last sign of life. `progress` of the job is the event. timeout: for all of it, in place
        of Deadlines.stream.
        """
        deadline = self._connection.deadline(timeout, self._connection.deadlines.stream)
        return Watch(self._connection, name, after_sequence, deadline).events()

    def wait_for_job(self, job: Union[v1.Job, str],
                     on_progress: Optional[Callable[[v1.Job], None]] = None, *,
                     timeout: Optional[float] = None) -> v1.Job:
        """Watches a job until it succeeds, and returns it.

        on_progress: called with each event. Raises the job's error if it failed, and CancelledError
        if it was cancelled.
        """
        name = job if isinstance(job, str) else job.name
        last = v1.Job()
        for last in self.watch_job(name, timeout=timeout):
            if on_progress is not None:
                on_progress(last)
        if last.state == v1.JOB_STATE_FAILED:
            raise from_status(last.error)
        if last.state == v1.JOB_STATE_CANCELLED:
            raise error(grpc.StatusCode.CANCELLED, f"{name} was cancelled")
        assert has_ended(last)
        return last

    # Tags, which jobs of tag() make.

    def list_tags(self, *, timeout: Optional[float] = None) -> Iterator[v1.Tags]:
        """Yields all tags, by name. timeout: for each page."""
        return self._pages(self._connection.tags.ListTags, v1.ListTagsRequest(), "tags", timeout)

    def get_tags(self, name: str, *, timeout: Optional[float] = None) -> v1.Tags:
        """Returns what tags/{tags} are of, and how much is complete."""
        return self._manage(
            v1.Tags, self._connection.tags.GetTags, v1.GetTagsRequest(name=name), timeout)

    def download_tags(self, name: str, folder: Union[str, "os.PathLike[str]"], *,
                      on_progress: Optional[OnUploaded] = None,
                      timeout: Optional[float] = None) -> str:
        """Pulls the complete shards of tags/{tags} into a new folder; returns the name.

        The folder appears, and the call continues after an error, as in download_model_version.
        """
        download = downloads.FileDownload(self._connection, downloads.tags(self._connection), name,
                                          pathlib.Path(folder), on_progress)
        return download.run(self._connection.deadline(timeout, self._connection.deadlines.upload))

    def delete_tags(self, name: str, *, timeout: Optional[float] = None) -> None:
        """Removes tags. Refused while a job writes them."""
        self._delete(self._connection.tags.DeleteTags, v1.DeleteTagsRequest(name=name), timeout)

    # For operators.

    def get_log_level(self, *, timeout: Optional[float] = None) -> "v1.LogLevel.ValueType":
        """Returns the level from which on lines are logged."""
        return self._manage(
            v1.GetLogLevelResponse, self._connection.admin.GetLogLevel, v1.GetLogLevelRequest(),
            timeout).level

    def set_log_level(self, level: "v1.LogLevel.ValueType", *,
                      timeout: Optional[float] = None) -> "v1.LogLevel.ValueType":
        """Sets it until the server restarts; returns the level that was in force before."""
        return self._manage(
            v1.SetLogLevelResponse, self._connection.admin.SetLogLevel,
            v1.SetLogLevelRequest(level=level), timeout).previous_level

    def check_health(self, service: str = "", *, timeout: Optional[float] = None) -> None:
        """Returns if the service is SERVING; "" is the whole server. Not retried.

        service: maneuver.v1.PredictionService serves once a model is ready. Raises UnavailableError
        with the reason NOT_SERVING if it does not serve, NotFoundError if the server does not know
        it.
        """
        # grpc.health.v1.HealthCheckRequest {string service = 1} and HealthCheckResponse {enum
        # status = 1} have the same bytes as these wrappers; Debian's grpcio has no health.proto.
        check = self._connection.channel.unary_unary(
            "/grpc.health.v1.Health/Check",
            request_serializer=wrappers_pb2.StringValue.SerializeToString,
            response_deserializer=wrappers_pb2.Int32Value.FromString)
        deadline = self._connection.deadline(timeout, self._connection.deadlines.management)
        try:
            status = check(wrappers_pb2.StringValue(value=service),
                           timeout=self._connection.left(deadline),
                           metadata=self._connection.metadata).value
        except grpc.RpcError as failure:
            raise from_rpc(failure) from None
        serving = 1
        if status != serving:
            raise UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                   f"{service or 'the server'} is not ready to serve",
                                   "NOT_SERVING")

    def _manage(self, response: "type[_Response]", method: Callable[..., _Response],
                request: Message, timeout: Optional[float]) -> _Response:
        deadline = self._connection.deadline(timeout, self._connection.deadlines.management)
        return self._connection.call(method, request, deadline)

    def _delete(self, method: Callable[..., empty_pb2.Empty], request: Message,
                timeout: Optional[float]) -> None:
        deadline = self._connection.deadline(timeout, self._connection.deadlines.management)
        self._connection.call(method, request, deadline, repeatable=False)

    def _pages(self, method: Callable[..., Any], request: Any, items: str,
               timeout: Optional[float]) -> Iterator[Any]:
        while True:
            page: Any = self._manage(Message, method, request, timeout)
            yield from getattr(page, items)
            if not page.next_page_token:
                return
            request.page_token = page.next_page_token
