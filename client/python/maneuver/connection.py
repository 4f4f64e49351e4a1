"""The channel, the stubs, and how a call is made. Private to the package."""

from __future__ import annotations

import dataclasses
import json
import threading
from typing import Any, Callable, List, Optional, Tuple, TypeVar

import grpc

from maneuver.credentials import ServerAddress, Tls, authorization, channel_credentials
from maneuver.credentials import is_local, parse_address
from maneuver.errors import (CancelledError, DeadlineExceededError, ManeuverError,
                             UnavailableError, from_rpc)
from maneuver.retry import Clock, OnRetry, RetryPolicy, backoff_after, retry
from maneuver.v1.admin_service_pb2_grpc import AdminServiceStub
from maneuver.v1.dataset_service_pb2_grpc import DatasetServiceStub
from maneuver.v1.model_service_pb2_grpc import ModelServiceStub
from maneuver.v1.outcome_service_pb2_grpc import OutcomeServiceStub
from maneuver.v1.prediction_service_pb2_grpc import PredictionServiceStub
from maneuver.v1.replica_service_pb2_grpc import ReplicaServiceStub
from maneuver.v1.tag_service_pb2_grpc import TagServiceStub
from maneuver.v1.training_service_pb2_grpc import TrainingServiceStub

_Answer = TypeVar("_Answer")

_OPTIONS: List[Tuple[str, Any]] = [
    # Scenes and answers may be large; how large is for the server to say.
    ("grpc.max_receive_message_length", -1),
    ("grpc.max_send_message_length", -1),
    # A new connection is tried as soon as a retry asks for it.
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.min_reconnect_backoff_ms", 5000),  # also how long an attempt to connect may take
    ("grpc.max_reconnect_backoff_ms", 2000),
    # Finds out, while calls are in flight, that the server went without a word.
    ("grpc.keepalive_time_ms", 60000),
    ("grpc.keepalive_timeout_ms", 20000),
    ("grpc.http2.max_pings_without_data", 0),  # gRPC would stop after two
    # Retries are this package's.
    ("grpc.enable_retries", 0),
]


@dataclasses.dataclass(frozen=True)
class Deadlines:
    """How long a call may take, with all its attempts, when it does not say. Seconds."""

    prediction: float = 30.0
    management: float = 60.0  # all else but these:
    upload: float = 3600.0  # of a dataset or version, and other calls that read one as a whole
    stream: float = 24 * 3600.0  # a stream of predictions, and the watching of a job


class Connection:
    """A connection to one server, or to each of several. Thread-safe."""

    def __init__(self, address: str, tls: Optional[Tls], token: str, token_file: str,
                 deadlines: Deadlines, retries: RetryPolicy, on_retry: Optional[OnRetry],
                 clock: Clock) -> None:
        self.deadlines = deadlines
        self.retries = retries
        self.on_retry = on_retry
        self.clock = clock
        self._closed = threading.Event()
        parsed = parse_address(address)
        self.metadata = authorization(address, tls, token, token_file)
        self._credentials = channel_credentials(tls)
        self._options = list(_OPTIONS)
        if is_local(address):
            # gRPC would connect through the proxy that http_proxy names: another machine, which
            # cannot reach the server, and which must not read a token.
            self._options.append(("grpc.enable_http_proxy", 0))
        if tls is not None and tls.server_name:
            self._options.append(("grpc.ssl_target_name_override", tls.server_name))
        self.channel = self._open(parsed, health_service="")
        self._channels = [self.channel]
        predicting = self.channel
        if parsed.several:
            predicting = self._open(parsed, health_service="maneuver.v1.PredictionService")
            self._channels.append(predicting)
        self.predictions = PredictionServiceStub(predicting)
        self.outcomes = OutcomeServiceStub(self.channel)
        self.models = ModelServiceStub(self.channel)
        self.datasets = DatasetServiceStub(self.channel)
        self.training = TrainingServiceStub(self.channel)
        self.replicas = ReplicaServiceStub(self.channel)
        self.tags = TagServiceStub(self.channel)
        self.admin = AdminServiceStub(self.channel)

    def _open(self, address: ServerAddress, health_service: str) -> grpc.Channel:
        options = list(self._options)
        if address.several:
            options.append(("grpc.service_config", json.dumps({
                "loadBalancingConfig": [{"round_robin": {}}],
                "healthCheckConfig": {"serviceName": health_service}})))
        if self._credentials is None:
            return grpc.insecure_channel(address.target, options)
        return grpc.secure_channel(address.target, self._credentials, options)

    def close(self) -> None:
        """Ends the connection and every call on it: they raise CancelledError."""
        self._closed.set()
        for channel in self._channels:
            channel.close()

    def retriable(self, failure: grpc.RpcError) -> ManeuverError:
        """Returns the error of a call that its caller did not cancel, but may have closed the client.

        CANCELLED then means that the server was just stopping, or that a proxy lost its server
        meanwhile: such a call may be made again. So may one whose answer ended without a status,
        because a proxy lost its server in the middle of it: gRPC calls that UNKNOWN, "Stream removed".
        """
        if self._closed.is_set():
            return self._closed_meanwhile()
        error = from_rpc(failure)
        has_no_status = error.code == grpc.StatusCode.UNKNOWN and error.message == "Stream removed"
        if isinstance(error, CancelledError) or has_no_status:
            return UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                    "the call was broken off on its way or by the server")
        return error

    @staticmethod
    def _closed_meanwhile() -> CancelledError:
        return CancelledError(grpc.StatusCode.CANCELLED, "the client was closed")

    def deadline(self, timeout: Optional[float], default: float) -> float:
        """Returns the time on the clock when a call has to be done.

        Raises ValueError for a timeout that is not a positive number of seconds.
        """
        seconds = default if timeout is None else timeout
        if not 0.0 < seconds < float("inf"):
            raise ValueError(f"timeout is a positive number of seconds, and not {seconds}")
        return self.clock.now() + seconds

    def left(self, deadline: float) -> float:
        """Returns the seconds until then.

        Raises DeadlineExceededError if it has passed, CancelledError if the client was closed.
        """
        if self._closed.is_set():
            raise self._closed_meanwhile()
        seconds = deadline - self.clock.now()
        if seconds <= 0.0:
            raise DeadlineExceededError(grpc.StatusCode.DEADLINE_EXCEEDED,
                                        "the call's time was up before it was sent")
        return seconds

    def pause(self, failure: ManeuverError, failures: int, give_up: float) -> None:
        """Waits before another attempt, after failure number `failures` in a row.

        Tells `on_retry` before. Raises the failure if the wait would pass `give_up` (on the clock).
        """
        wait = max(backoff_after(self.retries, failures, self.clock.uniform()),
                   failure.retry_delay or 0.0)
        if self.clock.now() + wait >= give_up:
            raise failure
        if self.on_retry is not None:
            self.on_retry(failure, wait)
        self.clock.sleep(wait)

    def call(self, method: Callable[..., _Answer], request: object, deadline: float, *,
             repeatable: bool = True) -> _Answer:
        """Makes a unary call until it succeeds or may not be tried again; raises ManeuverError."""

        def attempt() -> _Answer:
            try:
                return method(request, timeout=self.left(deadline), metadata=self.metadata)
            except grpc.RpcError as failure:
                raise self.retriable(failure) from None
            except ValueError:
                if self._closed.is_set():  # in between: gRPC makes no call on a closed channel
                    raise self._closed_meanwhile() from None
                raise

        policy = self.retries
        if not repeatable:
            policy = dataclasses.replace(policy, max_attempts=1)
        return retry(policy, deadline, attempt, on_retry=self.on_retry, clock=self.clock)
