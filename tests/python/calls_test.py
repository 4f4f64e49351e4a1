"""Addresses, credentials, retries and errors, against scripted servers in this process."""

import concurrent.futures
import contextlib
import hashlib
import os
import pathlib
import pickle
import socket
import subprocess
import tempfile
import threading
import time
import unittest
import unittest.mock

import grpc
from google.protobuf.any_pb2 import Any

import maneuver
from maneuver import v1
from maneuver.credentials import authorization, is_local, parse_address
from maneuver.retry import backoff_after, retry
from maneuver.v1 import dataset_service_pb2_grpc, model_service_pb2_grpc
from maneuver.v1 import outcome_service_pb2_grpc
from maneuver.v1 import prediction_service_pb2_grpc
from maneuver.v1 import training_service_pb2_grpc

SCENE = {"target_ids": [7], "agents": [{"id": 7}],
         "map_features": [{"id": 1, "type": "MAP_FEATURE_TYPE_ROAD_EDGE", "x": [0.0], "y": [1.0]}]}


def unavailable(retry_delay=None):
    return maneuver.UnavailableError(grpc.StatusCode.UNAVAILABLE, "away", retry_delay=retry_delay)


def refusal(code, reason, *details):
    """What a server sends for a call that failed: its code, and its status as bytes."""
    status = v1.Status(code=code.value[0], message="refused")
    for kind, detail in (("ErrorInfo", v1.ErrorInfo(reason=reason, metadata={"model": "m"})),
                         *details):
        status.details.add(type_url=f"type.googleapis.com/google.rpc.{kind}",
                           value=detail.SerializeToString())
    return code, status.SerializeToString()


def fail(context, code, status, message="refused"):
    context.set_trailing_metadata((("grpc-status-details-bin", status),))
    context.abort(code, message)


class Clock:
    """Time that passes only while someone sleeps."""

    def __init__(self):
        self.waits = []
        self.looks = 0

    def now(self):
        self.looks += 1
        return 1000.0 + sum(self.waits)

    def clock(self):
        return maneuver.Clock(now=self.now, sleep=self.waits.append, uniform=lambda: 0.5)


def failing(*failures, answer="answer"):
    """An attempt that raises these in turn, then returns the answer."""
    left = list(failures)

    def attempt():
        if left:
            raise left.pop(0)
        return answer

    return attempt


class RetryTest(unittest.TestCase):

    def setUp(self):
        self.time = Clock()

    def retry(self, attempt, deadline=2000.0, **policy):
        return retry(maneuver.RetryPolicy(**policy), deadline, attempt, clock=self.time.clock())

    def test_waits_twice_as_long_each_time(self):
        attempt = failing(unavailable(), unavailable(), unavailable())
        self.assertEqual(self.retry(attempt), "answer")
        self.assertEqual(self.time.waits, [0.1, 0.2, 0.4])

    def test_gives_up_after_the_last_attempt(self):
        with self.assertRaises(maneuver.UnavailableError):
            self.retry(failing(*[unavailable()] * 3), max_attempts=3)
        self.assertEqual(len(self.time.waits), 2)

    def test_does_not_start_a_wait_that_would_pass_the_deadline(self):
        with self.assertRaises(maneuver.UnavailableError):
            self.retry(failing(unavailable(), unavailable()), deadline=1000.3)
        self.assertEqual(self.time.waits, [0.1])

    def test_waits_at_least_as_long_as_the_server_asks(self):
        self.retry(failing(unavailable(retry_delay=0.75), unavailable(retry_delay=0.01)))
        self.assertEqual(self.time.waits, [0.75, 0.2])

    def test_repeats_a_call_that_the_server_puts_off(self):
        put_off = maneuver.ResourceExhaustedError(grpc.StatusCode.RESOURCE_EXHAUSTED, "full",
                                                  "QUEUE_FULL", retry_delay=0.5)
        self.assertEqual(self.retry(failing(put_off)), "answer")
        self.assertEqual(self.time.waits, [0.5])

    def test_does_not_repeat_a_call_that_was_refused_for_good(self):
        for code, kind in ((grpc.StatusCode.INVALID_ARGUMENT, maneuver.InvalidArgumentError),
                           (grpc.StatusCode.RESOURCE_EXHAUSTED, maneuver.ResourceExhaustedError),
                           (grpc.StatusCode.DEADLINE_EXCEEDED, maneuver.DeadlineExceededError)):
            with self.assertRaises(kind):
                self.retry(failing(kind(code, "no")))
        self.assertEqual(self.time.waits, [])

    def test_jitter_is_a_share_of_the_wait(self):
        policy = maneuver.RetryPolicy(initial_backoff=1.0, max_backoff=3.0, jitter=0.2)
        self.assertAlmostEqual(backoff_after(policy, 1, 0.0), 0.8)
        self.assertAlmostEqual(backoff_after(policy, 1, 1.0), 1.2)
        self.assertAlmostEqual(backoff_after(policy, 5, 0.5), 3.0)
        self.assertAlmostEqual(backoff_after(policy, 5000, 0.5), 3.0)

    def test_refuses_a_policy_that_makes_no_sense(self):
        for wrong in ({"max_attempts": 0}, {"jitter": 1.5}, {"backoff_multiplier": 0.5}):
            with self.assertRaises(ValueError):
                maneuver.RetryPolicy(**wrong)


class AddressTest(unittest.TestCase):

    def test_names_one_server_or_several(self):
        one = parse_address("planner.example:8470")
        self.assertEqual((one.target, one.several), ("planner.example:8470", False))
        several = parse_address("10.0.0.1:1,10.0.0.2:2")
        self.assertEqual((several.target, several.several), ("ipv4:10.0.0.1:1,10.0.0.2:2", True))
        self.assertEqual(parse_address("[fd00::1]:1,[fd00::2]:2").target,
                         "ipv6:[fd00::1]:1,[fd00::2]:2")
        self.assertTrue(parse_address("dns:///fleet:8470").several)
        for short, whole in (("10.0.0.1", "10.0.0.1:8470"), ("::1", "[::1]:8470"), ("fleet", "fleet:8470"),
                             ("dns:///fleet", "dns:///fleet:8470"), ("[::1]", "[::1]:8470"),
                             ("10.0.0.1,10.0.0.2:2", "ipv4:10.0.0.1:8470,10.0.0.2:2"), ("unix:/m", "unix:/m")):
            self.assertEqual(parse_address(short).target, whole)
        for wrong in ("", "a:1,b:2", "10.0.0.1:1,[fd00::1]:1", "10.0.0.1:74006", "a:0", "dns:///a:65536",
                      "http://fleet:8470", "https://fleet", "dns:///", "dns:///:8470"):
            with self.assertRaises(ValueError):
                parse_address(wrong)

    def test_knows_what_stays_on_this_machine(self):
        for local in ("localhost", "127.0.0.1:1", "127.9.9.9:1", "[::1]:1", "localhost:1", "unix:/run/m"):
            self.assertTrue(is_local(local), local)
        for remote in ("10.0.0.1:1", "localhost.example:1", "127.0.0.1:1,10.0.0.1:1"):
            self.assertFalse(is_local(remote), remote)

    def test_skips_the_mark_that_some_editors_begin_a_token_file_with(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder, "token")
            file.write_text("secret\n", encoding="utf-8-sig")
            self.assertEqual(authorization("localhost", None, "", str(file)),
                             (("authorization", "Bearer secret"),))

    def test_does_not_send_a_token_over_the_network_in_plain_text(self):
        with self.assertRaisesRegex(ValueError, "plain text"):
            maneuver.Client("10.0.0.1:8470", token="secret")
        maneuver.Client("10.0.0.1:8470", token="secret", tls=maneuver.Tls()).close()
        maneuver.Client("127.0.0.1:8470", token="secret").close()

    def test_refuses_a_token_that_is_not_one_word(self):
        with self.assertRaisesRegex(ValueError, "one word"):
            maneuver.Client(token="two words")

    def test_refuses_certificates_that_are_not_pem(self):
        with tempfile.NamedTemporaryFile() as file:
            with self.assertRaisesRegex(ValueError, "not in PEM format"):
                maneuver.Client(tls=maneuver.Tls(root_certificates=file.name))
        with self.assertRaises(OSError):
            maneuver.Client(tls=maneuver.Tls(root_certificates="/nowhere.pem"))

    def test_refuses_certificates_and_keys_that_do_not_fit(self):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        pairs = []
        for name in ("a", "b"):
            pairs.append((str(folder / f"{name}.crt"), str(folder / f"{name}.key")))
            subprocess.run(
                ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
                 "-nodes", "-days", "2", "-subj", f"/CN={name}", "-keyout", pairs[-1][1], "-out", pairs[-1][0]],
                check=True, capture_output=True)
        (certificate, key), (_, other_key) = pairs
        maneuver.Client(tls=maneuver.Tls(certificate, certificate, key)).close()
        damaged = folder / "damaged.key"
        damaged.write_text("-----BEGIN PRIVATE KEY-----\nMC4=\n-----END PRIVATE KEY-----\n")
        for tls, message in (
                (maneuver.Tls(root_certificates=key), "a.key holds a private key, not a certificate"),
                (maneuver.Tls("", key, certificate), "a.key holds a private key, not a certificate"),
                (maneuver.Tls("", certificate, certificate), "a.crt holds a certificate, not a private key"),
                (maneuver.Tls("", certificate, other_key), "b.key is not the key of the certificate in .*a.crt"),
                (maneuver.Tls("", certificate, str(damaged)), "damaged.key is damaged")):
            with self.assertRaisesRegex(ValueError, message):
                maneuver.Client(tls=tls)

    def test_pings_a_server_that_is_silent_during_a_call(self):
        with unittest.mock.patch("grpc.insecure_channel", wraps=grpc.insecure_channel) as channel:
            maneuver.Client("127.0.0.1:1").close()
        options = dict(channel.call_args.args[1])
        self.assertEqual(options["grpc.keepalive_time_ms"], 60000)
        self.assertEqual(options["grpc.keepalive_timeout_ms"], 20000)
        self.assertEqual(options["grpc.http2.max_pings_without_data"], 0)
        self.assertNotIn("grpc.keepalive_permit_without_calls", options)


class ErrorTest(unittest.TestCase):

    def test_survives_pickling(self):
        error = maneuver.NotFoundError(grpc.StatusCode.NOT_FOUND, "no model", "MODEL_NOT_FOUND",
                                       [maneuver.FieldViolation("model", "none")], 0.5, {"a": "b"})
        copy = pickle.loads(pickle.dumps(error))
        self.assertIsInstance(copy, maneuver.NotFoundError)
        self.assertEqual(vars(copy), vars(error))

    def test_its_text_has_code_reason_and_fields(self):
        error = maneuver.InvalidArgumentError(
            grpc.StatusCode.INVALID_ARGUMENT, "wrong", "INVALID_FIELD",
            [maneuver.FieldViolation("scenarios[0].agents", "is empty")])
        self.assertEqual(str(error),
                         "INVALID_ARGUMENT (INVALID_FIELD): wrong; scenarios[0].agents: is empty")


class Predictions(prediction_service_pb2_grpc.PredictionServiceServicer):
    """Answers Predict as scripted: a (code, status) fails the call, None succeeds."""

    def __init__(self):
        self.script = []
        self.requests = []
        self.registered = []
        self.metadata = []
        self.held = set()
        self.map_refusal = None
        self.has_read = threading.Event()  # all of a stream
        self.may_answer = threading.Event()  # the stream
        self.waits = None  # an event that Predict waits for

    def StreamPredict(self, requests, context):
        ids = [request.request_id for request in requests]
        self.has_read.set()
        self.may_answer.wait(10.0)
        for request_id in ids:
            yield v1.StreamPredictResponse(request_id=request_id, response=v1.PredictResponse())

    def Predict(self, request, context):
        self.requests.append(request)
        self.metadata.append(dict(context.invocation_metadata()))
        if self.waits is not None:
            self.waits.wait(10.0)
        answer = self.script.pop(0) if self.script else None
        if answer is not None:
            fail(context, *answer)
        for scene in request.scenarios:
            if scene.map_id and scene.map_id not in self.held:
                fail(context, *refusal(grpc.StatusCode.FAILED_PRECONDITION, "MAP_NOT_REGISTERED"))
        return v1.PredictResponse(model_version="models/m/versions/1")

    def RegisterMap(self, request, context):
        if self.map_refusal is not None:
            fail(context, *self.map_refusal)
        self.registered.append(request)
        map_id = hashlib.sha256(request.SerializeToString()).hexdigest()
        self.held.add(map_id)
        return v1.RegisterMapResponse(map_id=map_id)


class Training(training_service_pb2_grpc.TrainingServiceServicer):
    """A job of four events, whose watch breaks after each one."""

    def __init__(self):
        self.asked_after = []
        self.stays_silent = None  # what passes the time of a stream without an event; None: has one
        self.deletions = 0
        self.trained = []
        self.recalibrations = []

    def WatchJob(self, request, context):
        self.asked_after.append(request.after_sequence)
        if self.stays_silent is not None and len(self.asked_after) in (2, 3):
            self.stays_silent(accept=lambda: context.send_initial_metadata(()))
            context.abort(grpc.StatusCode.UNAVAILABLE, "broken")
        sequence = request.after_sequence + 1
        state = v1.JOB_STATE_SUCCEEDED if sequence == 4 else v1.JOB_STATE_RUNNING
        yield v1.WatchJobResponse(job=v1.Job(name=request.name, state=state,
                                             progress=v1.JobProgress(sequence=sequence)))
        if sequence < 4:
            context.abort(grpc.StatusCode.UNAVAILABLE, "broken")

    def DeleteJob(self, request, context):
        self.deletions += 1
        context.abort(grpc.StatusCode.UNAVAILABLE, "away")

    def Train(self, request, context):
        self.trained.append(request.request_id)
        if len(self.trained) == 1:
            context.abort(grpc.StatusCode.UNAVAILABLE, "away")
        return v1.Job(name="jobs/a")

    def Recalibrate(self, request, context):
        self.recalibrations.append(request)
        if len(self.recalibrations) == 1:
            context.abort(grpc.StatusCode.UNAVAILABLE, "away")
        return v1.Job(name="jobs/a")


class Datasets(dataset_service_pb2_grpc.DatasetServiceServicer):
    """Breaks the first upload after two chunks, which it keeps."""

    def __init__(self):
        self.kept = b""
        self.uploads = 0
        self.broken_uploads = 1
        self.keeps = True
        self.is_damaged = False  # what was kept before, which the first upload finds out
        self.before_break = lambda: None

    def DescribeDataset(self, request, context):
        time.sleep(0.1)
        return v1.DatasetSummary()

    def QueryUpload(self, request, context):
        return v1.QueryUploadResponse(arrived_bytes=[len(self.kept)])

    def UploadDataset(self, requests, context):
        self.uploads += 1
        header = next(requests).header
        assert list(header.arrived_bytes) == [len(self.kept)], header.arrived_bytes
        for count, request in enumerate(requests, 1):
            if self.keeps:
                self.kept += request.chunk
            if self.uploads <= self.broken_uploads and count == 2:
                self.before_break()
                context.abort(grpc.StatusCode.UNAVAILABLE, "broken")
        if self.is_damaged:
            self.kept, self.is_damaged = b"", False
            context.abort(grpc.StatusCode.DATA_LOSS, "another SHA-256")
        return v1.Dataset(name=header.name)


class Models(model_service_pb2_grpc.ModelServiceServicer):
    """Serves models/m/versions/1, of two files, and takes uploads of m."""

    def __init__(self):
        self.files = {"model.json": b"{}", "weights.safetensors": b"0123456789" * 100000}
        self.stated = {name: hashlib.sha256(bytes).hexdigest()
                       for name, bytes in self.files.items()}
        self.asked = []  # arrived_bytes of each download
        self.breaks_after = []  # chunks that each of the first downloads sends
        self.kept = b""
        self.uploads = []  # parent and files of each upload

    def DownloadModelVersion(self, request, context):
        self.asked.append(list(request.arrived_bytes))
        yield v1.DownloadModelVersionResponse(header=v1.DownloadModelHeader(
            model_version="models/m/versions/1",
            files=[v1.ModelFile(file=name, size_bytes=len(content), sha256=self.stated[name])
                   for name, content in self.files.items()]))
        breaks_after = self.breaks_after.pop(0) if self.breaks_after else None
        left = b"".join(content[offset:] for content, offset in
                        zip(self.files.values(), request.arrived_bytes or [0, 0]))
        for count, offset in enumerate(range(0, len(left), 1 << 18)):
            if count == breaks_after:
                context.abort(grpc.StatusCode.UNAVAILABLE, "broken")
            yield v1.DownloadModelVersionResponse(chunk=left[offset:offset + (1 << 18)])

    def QueryModelUpload(self, request, context):
        return v1.QueryModelUploadResponse(arrived_bytes=[len(self.kept), 0])

    def UploadModelVersion(self, requests, context):
        header = next(requests).header
        self.uploads.append((header.parent, [(file.file, file.sha256) for file in header.files],
                             list(header.arrived_bytes)))
        self.kept += b"".join(request.chunk for request in requests)
        return v1.ModelVersion(name=f"{header.parent}/versions/1")


class Outcomes(outcome_service_pb2_grpc.OutcomeServiceServicer):
    """Is away at first, then answers with what it was sent."""

    def __init__(self):
        self.requests = []
        self.streams = []  # the request ids that each has read
        self.broken_streams = 0  # so many break when the third report arrives
        self.postponed = 0  # so many reports are to come again later

    def ReportOutcomes(self, request, context):
        self.requests.append(request)
        if len(self.requests) == 1:
            fail(context, *refusal(grpc.StatusCode.UNAVAILABLE, "SERVER_STOPS"))
        score = v1.TargetScore(target_id=request.outcomes[0].targets[0].target_id)
        return v1.ReportOutcomesResponse(scores=[v1.OutcomeScore(targets=[score])])

    def StreamOutcomes(self, requests, context):
        self.streams.append([])
        for request in requests:
            self.streams[-1].append(request.report.request_id)
            if len(self.streams) <= self.broken_streams and len(self.streams[-1]) == 3:
                context.abort(grpc.StatusCode.UNAVAILABLE, "broken")
            if self.postponed > 0:
                self.postponed -= 1
                delay = v1.RetryInfo()
                delay.retry_delay.nanos = 20_000_000
                _, busy = refusal(grpc.StatusCode.RESOURCE_EXHAUSTED, "TOO_MANY_REQUESTS",
                                  ("RetryInfo", delay))
                yield v1.StreamOutcomesResponse(error=v1.Status.FromString(busy))
                continue
            if not request.report.outcomes:
                yield v1.StreamOutcomesResponse(error=v1.Status(code=3, message="outcomes: none"))
                continue
            score = v1.TargetScore(target_id=request.report.outcomes[0].targets[0].target_id)
            yield v1.StreamOutcomesResponse(response=v1.ReportOutcomesResponse(
                scores=[v1.OutcomeScore(targets=[score])]))

    def CollectOutcomes(self, request, context):
        self.requests.append(request)
        if len(self.requests) == 1:
            fail(context, *refusal(grpc.StatusCode.UNAVAILABLE, "SERVER_STOPS"))
        return v1.CollectOutcomesResponse(surprising_recordings=3)


class CallsTest(unittest.TestCase):
    """A server of this process, whose services answer as scripted."""

    def setUp(self):
        self.predictions, self.training, self.datasets = Predictions(), Training(), Datasets()
        self.models, self.outcomes = Models(), Outcomes()
        server = grpc.server(concurrent.futures.ThreadPoolExecutor(4))
        prediction_service_pb2_grpc.add_PredictionServiceServicer_to_server(self.predictions,
                                                                            server)
        training_service_pb2_grpc.add_TrainingServiceServicer_to_server(self.training, server)
        dataset_service_pb2_grpc.add_DatasetServiceServicer_to_server(self.datasets, server)
        model_service_pb2_grpc.add_ModelServiceServicer_to_server(self.models, server)
        outcome_service_pb2_grpc.add_OutcomeServiceServicer_to_server(self.outcomes, server)
        self.address = f"127.0.0.1:{server.add_insecure_port('127.0.0.1:0')}"
        server.start()
        self.addCleanup(lambda: server.stop(None).wait())

    def client(self, **options):
        client = maneuver.Client(self.address, **{
            "retries": maneuver.RetryPolicy(initial_backoff=0.001), **options})
        self.addCleanup(client.close)
        return client

    def test_repeats_a_prediction_until_the_server_is_back(self):
        away = refusal(grpc.StatusCode.UNAVAILABLE, "SERVER_STOPS")
        cancelled = refusal(grpc.StatusCode.CANCELLED, "SERVER_STOPS")
        no_status = (grpc.StatusCode.UNKNOWN, b"", "Stream removed")  # as gRPC calls it
        self.predictions.script = [away, cancelled, no_status]
        told = []
        client = self.client(on_retry=lambda error, wait: told.append(error.code.name))
        self.assertEqual(client.predict(SCENE).model_version, "models/m/versions/1")
        self.assertEqual(told, ["UNAVAILABLE"] * 3)
        self.assertEqual(len({request.SerializeToString()
                              for request in self.predictions.requests}), 1)

    def test_retries_0_means_one_attempt(self):
        self.predictions.script = [refusal(grpc.StatusCode.UNAVAILABLE, "SERVER_STOPS")]
        with self.assertRaises(maneuver.UnavailableError):
            self.client(retries=0).predict(SCENE)
        self.assertEqual(len(self.predictions.requests), 1)

    def test_closing_the_client_cancels_a_call_of_another_thread(self):
        self.predictions.waits = threading.Event()
        self.addCleanup(self.predictions.waits.set)
        client = self.client()
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            call = pool.submit(client.predict, SCENE)
            while not self.predictions.requests:
                time.sleep(0.001)
            client.close()
            with self.assertRaisesRegex(maneuver.CancelledError, "closed"):
                call.result(10.0)

    def test_closing_the_client_cancels_a_watch(self):
        client = self.client()
        watch = client.watch_job("jobs/a")
        next(watch)
        client.close()
        with self.assertRaisesRegex(maneuver.CancelledError, "closed"):
            list(watch)

    def test_a_closed_client_makes_no_call(self):
        client = self.client()
        client.close()
        with self.assertRaisesRegex(maneuver.CancelledError, "closed"):
            client.predict(SCENE)

    def test_an_error_has_reason_metadata_fields_and_delay(self):
        delay = v1.RetryInfo()
        delay.retry_delay.FromMilliseconds(1500)
        wrong = v1.BadRequest(field_violations=[
            v1.BadRequest.FieldViolation(field="scenarios[0].agents", description="is empty")])
        self.predictions.script = [refusal(grpc.StatusCode.INVALID_ARGUMENT, "INVALID_FIELD",
                                           ("BadRequest", wrong), ("RetryInfo", delay))]
        with self.assertRaises(maneuver.InvalidArgumentError) as raised:
            self.client(retries=0).predict(SCENE)
        error = raised.exception
        self.assertEqual((error.code, error.reason, error.metadata, error.retry_delay),
                         (grpc.StatusCode.INVALID_ARGUMENT, "INVALID_FIELD", {"model": "m"}, 1.5))
        self.assertEqual(error.violations, (("scenarios[0].agents", "is empty"),))
        self.assertEqual(error.message, "refused")

    def test_details_that_do_not_parse_do_not_hide_the_error(self):
        detail = Any(type_url="type.googleapis.com/google.rpc.ErrorInfo", value=b"\xff")
        for broken in (b"\xff", v1.Status(code=5, details=[detail]).SerializeToString()):
            self.predictions.script = [(grpc.StatusCode.NOT_FOUND, broken)]
            with self.assertRaises(maneuver.NotFoundError) as raised:
                self.client().predict(SCENE)
            self.assertEqual(raised.exception.reason, "")

    def test_says_who_calls(self):
        self.client(token="secret").predict(SCENE)
        self.assertEqual(self.predictions.metadata[0]["authorization"], "Bearer secret")

    def test_reaches_a_local_server_without_the_proxy_of_the_environment(self):
        proxy = {"grpc_proxy": "http://127.0.0.1:1"}  # before http_proxy; nobody listens there
        with unittest.mock.patch.dict(os.environ, proxy):
            self.client(token="secret", retries=0).predict(SCENE)
        self.assertEqual(len(self.predictions.requests), 1)

    def test_does_not_repeat_a_deletion(self):
        with self.assertRaises(maneuver.UnavailableError):
            self.client().delete_job("jobs/a")
        self.assertEqual(self.training.deletions, 1)

    def test_repeats_a_report_of_outcomes_under_one_request_id(self):
        outcome = {"scenarioId": "drive", "targets": [{"targetId": 7}]}
        scores = self.client().report_outcomes([outcome], model="models/m").scores
        self.assertEqual(scores[0].targets[0].target_id, 7)
        first, second = self.outcomes.requests
        self.assertEqual(first, second)
        self.assertEqual(second.outcomes[0].scenario_id, "drive")
        self.assertEqual(second.model, "models/m")
        self.assertEqual(len(second.request_id), 32)

    def test_a_stream_of_outcomes_takes_reports_as_the_server_gets_on(self):
        taken = []

        def reports():
            for target in range(12):
                taken.append(target)
                outcome = {"scenarioId": "drive", "targets": [{"targetId": target}]}
                yield [outcome] if target != 5 else []

        answers = []
        for answer in self.client().stream_outcomes(reports()):
            answers.append(answer)
            self.assertLessEqual(len(taken) - len(answers), 4)
        self.assertIsInstance(answers.pop(5), maneuver.InvalidArgumentError)
        self.assertEqual([answer.scores[0].targets[0].target_id for answer in answers],
                         [target for target in range(12) if target != 5])

    def test_a_broken_stream_of_outcomes_goes_on_with_what_has_no_answer(self):
        self.outcomes.broken_streams = 2
        reports = [[{"scenarioId": "drive", "targets": [{"targetId": target}]}]
                   for target in range(8)]
        answers = list(self.client().stream_outcomes(reports))
        self.assertEqual([answer.scores[0].targets[0].target_id for answer in answers],
                         list(range(8)))
        first, second, third = self.outcomes.streams
        self.assertEqual((first[2], second[2]), (second[0], third[0]))
        self.assertEqual(len({*first, *second, *third}), 8)

    def test_a_report_of_outcomes_that_is_postponed_is_sent_again(self):
        self.outcomes.postponed = 6
        reports = [[{"scenarioId": "drive", "targets": [{"targetId": target}]}]
                   for target in range(8)]
        answers = list(self.client().stream_outcomes(reports))
        self.assertEqual([answer.scores[0].targets[0].target_id for answer in answers],
                         list(range(8)))
        sent, = self.outcomes.streams
        self.assertEqual(len(set(sent)), 8)
        self.assertEqual(len(sent), 8 + 6)

    def test_an_error_of_the_one_who_makes_reports_ends_the_stream_of_outcomes(self):
        def reports():
            yield [{"scenarioId": "drive", "targets": [{"targetId": 1}]}]
            raise maneuver.ResourceExhaustedError(grpc.StatusCode.RESOURCE_EXHAUSTED, "of mine",
                                                  retry_delay=0.01)

        with self.assertRaisesRegex(maneuver.ResourceExhaustedError, "of mine"):
            list(self.client().stream_outcomes(reports()))

    def test_a_dataset_has_the_time_of_an_upload_to_be_described(self):
        deadlines = maneuver.Deadlines(management=0.001)
        self.client(deadline=deadlines).describe_dataset("datasets/d")

    def test_a_stream_of_outcomes_to_a_server_that_is_away_ends_after_the_retries(self):
        self.outcomes.broken_streams = 100
        stream = self.client().stream_outcomes([[], []])  # breaks at the third alone
        self.assertEqual(len(list(stream)), 2)
        away = maneuver.Client("127.0.0.1:1", retries=maneuver.RetryPolicy(2, 0.001))
        with self.assertRaises(maneuver.UnavailableError):
            next(away.stream_outcomes([[]]))
        away.close()

    def test_does_not_repeat_a_collection_of_outcomes(self):
        with self.assertRaises(maneuver.UnavailableError):
            self.client().collect_outcomes("datasets/d", forget=True)
        self.assertEqual(len(self.outcomes.requests), 1)
        self.assertTrue(self.outcomes.requests[0].forget)
        self.assertEqual(self.client().collect_outcomes("datasets/d").surprising_recordings, 3)
        self.assertEqual(self.outcomes.requests[1].dataset, "datasets/d")

    def test_repeats_a_recalibration_under_one_request_id(self):
        self.client().recalibrate("models/m/versions/2", ["datasets/d"],
                                  examples={"stride": "1s"}, promotion=v1.PROMOTION_NEVER)
        first, second = self.training.recalibrations
        self.assertEqual(first, second)
        self.assertTrue(first.request_id)
        self.assertEqual(first.model, "models/m/versions/2")
        self.assertEqual(first.datasets, ["datasets/d"])
        self.assertEqual(first.examples.stride.seconds, 1)
        self.assertEqual(first.promotion, v1.PROMOTION_NEVER)

    def test_repeats_train_under_one_request_id(self):
        self.client().train("models/m", ["datasets/d"])
        first, second = self.training.trained
        self.assertEqual(first, second)
        self.assertTrue(first)

    def test_a_watch_that_breaks_goes_on_after_the_last_event(self):
        jobs = list(self.client().watch_job("jobs/a"))
        self.assertEqual([job.progress.sequence for job in jobs], [1, 2, 3, 4])
        self.assertEqual(self.training.asked_after, [0, 1, 2, 3])

    def test_a_watch_goes_on_after_silent_streams_that_were_accepted(self):
        passing = Clock()

        def stays_silent(accept):
            looks = passing.looks
            accept()
            for _ in range(5000):  # until the client has seen that the stream is accepted
                if passing.looks > looks:
                    break
                time.sleep(0.001)
            passing.waits.append(600.0)

        self.training.stays_silent = stays_silent
        told = []
        client = self.client(clock=passing.clock(), on_retry=lambda error, wait: told.append(wait))
        jobs = list(client.watch_job("jobs/a"))
        self.assertEqual([job.progress.sequence for job in jobs], [1, 2, 3, 4])
        self.assertEqual(self.training.asked_after, [0, 1, 1, 1, 2, 3])
        self.assertEqual(told, [0.001, 0.002])  # the two silent ones

    CONTENT = b"".join(b"%015d\n" % line for line in range(131072))  # 2 MiB, four chunks

    def upload(self, **options):
        """Uploads a dataset whose only shard is CONTENT."""
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "a.tfrecord").write_bytes(self.CONTENT)
            pathlib.Path(folder, "dataset.json").write_text(
                '{"shards": [{"file": "a.tfrecord", "size_bytes": "%d"}]}' % len(self.CONTENT))
            progress = []
            dataset = self.client(**options).upload_dataset(folder, "datasets/d", on_progress=progress.append)
        self.assertEqual(dataset.name, "datasets/d")
        return progress

    def test_an_upload_that_breaks_goes_on_where_it_was(self):
        progress = self.upload()
        self.assertEqual(self.datasets.uploads, 2)
        self.assertEqual(self.datasets.kept, self.CONTENT)
        self.assertEqual(progress[-1], maneuver.UploadProgress(len(self.CONTENT), len(self.CONTENT)))

    def test_an_upload_goes_on_however_long_its_connection_lasted(self):
        passing = Clock()
        self.datasets.before_break = lambda: passing.waits.append(600.0)
        self.upload(clock=passing.clock())
        self.assertEqual(self.datasets.uploads, 2)
        self.assertEqual(self.datasets.kept, self.CONTENT)

    def test_an_upload_of_which_nothing_arrives_is_given_up(self):
        passing = Clock()
        self.datasets.before_break = lambda: passing.waits.append(600.0)
        self.datasets.broken_uploads, self.datasets.keeps = 100, False
        with self.assertRaises(maneuver.UnavailableError):
            self.upload(clock=passing.clock())
        self.assertEqual(self.datasets.uploads, 2)

    def test_an_upload_waits_longer_while_nothing_arrives_and_tells(self):
        self.datasets.broken_uploads, self.datasets.keeps = 3, False
        passing, told = Clock(), []
        self.upload(clock=passing.clock(), on_retry=lambda error, wait: told.append(wait))
        self.assertEqual(told, [0.001, 0.002, 0.004])
        self.assertEqual(passing.waits, told)

    def test_an_upload_that_starts_clean_counts_what_arrives_from_there(self):
        self.datasets.kept, self.datasets.is_damaged = b"?" * (len(self.CONTENT) - 1), True
        self.datasets.broken_uploads = 3  # the first one is too short to break
        passing = Clock()
        self.upload(clock=passing.clock())
        self.assertEqual(self.datasets.kept, self.CONTENT)
        self.assertEqual(passing.waits, [0.001, 0.001])  # two chunks arrived between them

    def test_a_download_waits_longer_while_nothing_arrives(self):
        self.models.breaks_after = [1, 0, 0]
        passing = Clock()
        self.download(clock=passing.clock())
        self.assertEqual(passing.waits, [0.001, 0.002, 0.004])

    def test_refuses_a_folder_that_is_not_whole(self):
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaises(FileNotFoundError):
                self.client().upload_dataset(folder, "datasets/d")
            pathlib.Path(folder, "dataset.json").write_text(
                '{"shards": [{"file": "a.tfrecord", "size_bytes": "3"}]}')
            pathlib.Path(folder, "a.tfrecord").write_bytes(b"ab")
            with self.assertRaisesRegex(ValueError, "has 2 bytes; dataset.json says 3"):
                self.client().upload_dataset(folder, "datasets/d")
        self.assertEqual(self.datasets.uploads, 0)

    def test_reads_a_manifest_with_its_digest_and_refuses_another(self):
        body = '{\n "shards": [{"file": "a.tfrecord", "size_bytes": "2"}]\n}\n'
        seal = '{\n "content_sha256": "%s",' % hashlib.sha256(body.encode()).hexdigest()
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "a.tfrecord").write_bytes(b"ab")
            manifest = pathlib.Path(folder, "dataset.json")
            manifest.write_text(seal + body[1:])
            self.client().upload_dataset(folder, "datasets/d")
            self.assertEqual(self.datasets.kept, b"ab")
            manifest.write_text(seal + body[1:].replace("2", "1"))
            with self.assertRaisesRegex(ValueError, "SHA-256 is not what it says"):
                self.client().upload_dataset(folder, "datasets/d")

    def download(self, **options):
        """Downloads the version; returns the files and what the progress was."""
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()), "m-1")
        progress = []
        self.assertEqual(self.client(**options).download_model_version(
            "models/m", folder, on_progress=progress.append), "models/m/versions/1")
        self.assertFalse((folder.parent / ".m-1.part").exists())
        return {path.name: path.read_bytes() for path in folder.iterdir()}, progress

    def test_a_download_that_breaks_goes_on_where_it_was(self):
        self.models.breaks_after = [2, 0, 1]
        files, progress = self.download()
        self.assertEqual(files, self.models.files)
        # Chunks of 2**18 bytes: two, none, one. The first has the 2 bytes of model.json too.
        self.assertEqual(self.models.asked, [[], [2, (2 << 18) - 2], [2, (2 << 18) - 2],
                                             [2, (3 << 18) - 2]])
        self.assertEqual(progress[-1], maneuver.UploadProgress(1000002, 1000002))
        self.assertEqual([one.there for one in progress], sorted(one.there for one in progress))

    def test_a_download_takes_what_an_earlier_one_left(self):
        with tempfile.TemporaryDirectory() as folder:
            part = pathlib.Path(folder, ".m-1.part")
            part.mkdir()
            (part / self.models.stated["weights.safetensors"]).write_bytes(b"0123456789")
            (part / "of-another-version").write_bytes(b"?")
            self.client().download_model_version("models/m", pathlib.Path(folder, "m-1"))
            self.assertEqual(self.models.asked, [[], [0, 10]])
            self.assertEqual(sorted(path.name for path in pathlib.Path(folder, "m-1").iterdir()),
                             ["model.json", "weights.safetensors"])

    def test_a_download_starts_clean_once_if_a_file_is_altered(self):
        with tempfile.TemporaryDirectory() as folder:
            part = pathlib.Path(folder, ".m-1.part")
            part.mkdir()
            (part / self.models.stated["weights.safetensors"]).write_bytes(b"altered")
            client = self.client()
            client.download_model_version("models/m", pathlib.Path(folder, "m-1"))
            self.assertEqual(pathlib.Path(folder, "m-1/weights.safetensors").read_bytes(),
                             self.models.files["weights.safetensors"])
            self.models.stated["model.json"] = "0" * 64
            with self.assertRaises(maneuver.DataLossError):
                client.download_model_version("models/m", pathlib.Path(folder, "m-2"))
            self.assertFalse(pathlib.Path(folder, "m-2").exists())

    def test_a_download_leaves_a_folder_that_is_something_else(self):
        with tempfile.TemporaryDirectory() as folder:
            client = self.client()
            client.download_model_version("models/m", folder)
            self.assertEqual(client.download_model_version("models/m", folder),
                             "models/m/versions/1", "it is this version")
            more = pathlib.Path(folder, "baselines.json")
            more.write_bytes(b"{}")
            with self.assertRaises(FileExistsError):
                client.download_model_version("models/m", folder)
            more.unlink()
            pathlib.Path(folder, "model.json").write_bytes(b"other")
            with self.assertRaises(FileExistsError):
                client.download_model_version("models/m", folder)

    def test_a_download_writes_nowhere_but_in_its_folder(self):
        self.models.files = {"../out": b"x"}
        self.models.stated["../out"] = hashlib.sha256(b"x").hexdigest()
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaises(maneuver.InternalError):
                self.client().download_model_version("models/m", pathlib.Path(folder, "a/b"))
            self.assertEqual(list(pathlib.Path(folder).iterdir()), [])

    def test_a_download_from_no_server_is_given_up(self):
        with maneuver.Client("127.0.0.1:1", retries=maneuver.RetryPolicy(
                max_attempts=2, initial_backoff=0.001)) as client:
            with self.assertRaises(maneuver.UnavailableError):
                client.download_model_version("models/m", "/nowhere/m-1")

    def test_an_upload_of_a_model_sends_what_is_not_there(self):
        self.models.kept = b"{"
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaises(FileNotFoundError):
                self.client().upload_model_version(folder, "models/m")
            for name, content in self.models.files.items():
                pathlib.Path(folder, name).write_bytes(content)
            version = self.client().upload_model_version(folder, "models/m")
        self.assertEqual(version.name, "models/m/versions/1")
        self.assertEqual(self.models.uploads,
                         [("models/m", list(self.models.stated.items()), [1, 0])])
        self.assertEqual(self.models.kept, b"".join(self.models.files.values()))

    def test_a_stream_refuses_what_is_sent_after_its_end(self):
        client = self.client()
        answered = []
        stream = client.stream_predict(lambda answer: answered.append(answer.request_id))
        stream.send("a", SCENE)
        finishing = threading.Thread(target=stream.finish)
        finishing.start()
        self.assertTrue(self.predictions.has_read.wait(10.0))  # so finish() has begun
        with self.assertRaisesRegex(ValueError, "finished"):
            stream.send("b", SCENE)
        self.predictions.may_answer.set()
        finishing.join()
        self.assertEqual(answered, ["a"])
        stream = client.stream_predict(lambda answer: None)
        stream.cancel()
        with self.assertRaises((ValueError, maneuver.CancelledError)):
            stream.send("c", SCENE)

    def test_a_map_is_sent_once(self):
        maps = maneuver.MapReuse(self.client())
        message = maneuver.v1.Scenario()
        message.CopyFrom(maneuver.scenes.to_proto(SCENE))
        for _ in range(3):
            maps.predict(message)
        self.assertEqual(len(self.predictions.registered), 1)
        for request in self.predictions.requests:
            self.assertTrue(request.scenarios[0].map_id)
            self.assertFalse(request.scenarios[0].map_features)
        self.assertEqual(len(message.map_features), 1)  # the caller's scene is as it was

    def test_a_map_that_the_server_let_go_is_registered_again(self):
        maps = maneuver.MapReuse(self.client())
        maps.predict(SCENE)
        self.predictions.held.clear()
        maps.predict(SCENE)
        self.assertEqual(len(self.predictions.registered), 2)

    def test_a_map_that_was_not_used_for_longest_is_forgotten(self):
        maps = maneuver.MapReuse(self.client(), max_maps=2)
        scenes = [{**SCENE, "map_features": [{"id": 1, "x": [float(i)], "y": [0.0]}]}
                  for i in range(3)]
        for index in (0, 1, 0, 2, 0, 1):
            maps.predict(scenes[index])
        self.assertEqual(len(self.predictions.registered), 4)

    def test_a_map_that_cannot_be_held_goes_with_each_request(self):
        maps = maneuver.MapReuse(self.client())
        self.predictions.map_refusal = refusal(grpc.StatusCode.RESOURCE_EXHAUSTED, "MAP_TOO_LARGE")
        maps.predict(SCENE)
        self.assertEqual(len(self.predictions.requests[0].scenarios[0].map_features), 1)
        self.predictions.map_refusal = refusal(grpc.StatusCode.PERMISSION_DENIED, "ROLE_MISSING")
        with self.assertRaises(maneuver.PermissionDeniedError):
            maps.predict(SCENE)

    def test_names_maps_for_a_stream(self):
        maps = maneuver.MapReuse(self.client())
        scenes = [maneuver.scenes.to_proto(SCENE), maneuver.scenes.to_proto(SCENE)]
        maps.name_maps(scenes)
        self.assertEqual(len(self.predictions.registered), 1)
        self.assertEqual({scene.map_id for scene in scenes}, self.predictions.held)
        self.assertEqual([len(scene.map_features) for scene in scenes], [0, 0])
        maps.forget()
        maps.name_maps([maneuver.scenes.to_proto(SCENE)])
        self.assertEqual(len(self.predictions.registered), 2)

    def test_names_that_are_gone_are_on_the_error(self):
        gone = v1.ErrorInfo(reason="ACTION_NAME_GONE", metadata={
            "action_name_1": "brake", "action_name_0": "left, a b",
            "model_version": "models/m/versions/2"})
        self.predictions.script = [refusal(grpc.StatusCode.FAILED_PRECONDITION, "",
                                           ("ErrorInfo", gone))]
        with self.assertRaises(maneuver.FailedPreconditionError) as caught:
            self.client().predict(SCENE, required_action_names=["left, a b", "brake", "stop"],
                                  include_action_names=True)
        self.assertEqual(caught.exception.reason, "ACTION_NAME_GONE")
        self.assertEqual(caught.exception.missing_action_names, ("left, a b", "brake"))
        request = self.predictions.requests[-1]
        self.assertEqual(list(request.required_action_names), ["left, a b", "brake", "stop"])
        self.assertTrue(request.include_action_names)

    def test_refuses_two_selections_of_actions(self):
        with self.assertRaisesRegex(ValueError, "exclude"):
            self.client().predict(SCENE, top_k=3, min_probability=0.1)

    def test_refuses_a_timeout_that_is_no_time(self):
        for wrong in (0.0, -1.0, float("inf"), float("nan")):
            with self.assertRaisesRegex(ValueError, "timeout"):
                self.client().predict(SCENE, timeout=wrong)


class StuckStream:
    """A call whose requests gRPC does not take before `go`; it answers each with an error."""

    def __init__(self):
        self.go = threading.Event()

    def StreamPredict(self, requests, timeout, metadata):  # noqa: N802
        self._requests = requests
        return self

    def __iter__(self):
        self.go.wait()
        for request in self._requests:
            yield v1.StreamPredictResponse(request_id=request.request_id,
                                           error=v1.Status(code=grpc.StatusCode.INTERNAL.value[0]))

    def cancel(self):
        self.go.set()


class StreamTest(unittest.TestCase):

    def setUp(self):
        self.stuck = StuckStream()
        connection = unittest.mock.Mock(predictions=self.stuck, metadata=())
        self.answered = []
        self.stream = maneuver.PredictStream(
            connection, lambda answer: self.answered.append(answer.request_id), timeout=60.0)
        self.sent = []

    def send_until_refused(self):
        try:
            for number in range(100):
                self.stream.send(str(number), SCENE)
                self.sent.append(str(number))
        except ValueError:
            self.sent.append("refused")

    def start_sender(self):
        """Returns a thread that sends, once the stream takes no more of it."""
        sender = threading.Thread(target=self.send_until_refused, daemon=True)
        sender.start()
        give_up = time.monotonic() + 60.0
        while len(self.sent) < 64 and time.monotonic() < give_up:
            time.sleep(0.01)
        sender.join(0.2)
        self.assertTrue(sender.is_alive())
        self.assertEqual(len(self.sent), 64)
        return sender

    def test_send_waits_while_too_many_requests_wait(self):
        sender = self.start_sender()
        self.stuck.go.set()
        sender.join(60.0)
        self.assertFalse(sender.is_alive())
        self.stream.finish()
        self.assertEqual(self.answered, [str(number) for number in range(100)])

    def test_cancelling_ends_a_send_that_waits(self):
        sender = self.start_sender()
        self.stream.cancel()
        sender.join(60.0)
        self.assertFalse(sender.is_alive())
        self.assertEqual(self.sent[-1], "refused")


class DeadlineTest(unittest.TestCase):

    def test_a_call_whose_time_is_up_is_not_answered(self):
        with maneuver.Client("127.0.0.1:1") as client:
            with self.assertRaises(maneuver.DeadlineExceededError):
                client.predict(SCENE, timeout=1e-9)

    def test_a_server_that_never_answers_costs_no_more_than_the_deadline(self):
        with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as silent:
            address = f"127.0.0.1:{silent.getsockname()[1]}"
            with maneuver.Client(address, deadline=0.3) as client:
                started = time.monotonic()
                with self.assertRaises(maneuver.DeadlineExceededError):
                    client.predict(SCENE)
                self.assertLess(time.monotonic() - started, 5.0)


if __name__ == "__main__":
    unittest.main()
