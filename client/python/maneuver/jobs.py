"""Jobs: when they have ended, and following them."""

from __future__ import annotations

import dataclasses
from typing import Iterator, Optional

import grpc

from maneuver import v1
from maneuver.connection import Connection
from maneuver.errors import ManeuverError, UnavailableError
from maneuver.retry import RetryPolicy, retry

# A stream that stands for so many seconds after the server accepted it is a sign of life, also if
# it stays silent. gRPC does not tell one that is refused from one that is accepted, but for its time.
STANDING = 0.1
PATIENCE = 60.0  # a broken watch is picked up for so long after the last sign of life, seconds


def has_ended(job: v1.Job) -> bool:
    """Whether a job has ended: SUCCEEDED, FAILED or CANCELLED."""
    return job.state in (v1.JOB_STATE_SUCCEEDED, v1.JOB_STATE_FAILED, v1.JOB_STATE_CANCELLED)


class Watch:
    """The events of one job, each once: a broken stream is picked up after the last one."""

    def __init__(self, connection: Connection, name: str, after_sequence: int,
                 deadline: float) -> None:
        self._connection = connection
        self._request = v1.WatchJobRequest(name=name, after_sequence=after_sequence)
        self._deadline = deadline
        self._silent = 0  # streams in a row that were accepted, and broke without an event

    def events(self) -> Iterator[v1.Job]:
        """Yields the job at each event; the last one has ended. Raises ManeuverError."""
        seen = False
        ended = False
        while not ended:
            # Before the first sign of life the job is given the patience of any call.
            policy, give_up = self._connection.retries, self._deadline
            if seen:
                policy = dataclasses.replace(policy, max_attempts=1_000_000)
                give_up = min(self._deadline, self._connection.clock.now() + PATIENCE)
            stream, job = self._open(policy, give_up)
            seen = True
            while job is not None:
                ended = has_ended(job)
                self._request.after_sequence = max(self._request.after_sequence,
                                                   job.progress.sequence)
                try:
                    yield job
                except GeneratorExit:
                    stream.cancel()
                    raise
                job = None if ended else self._next(stream)

    def _open(self, policy: RetryPolicy, give_up: float
              ) -> "tuple[grpc.Call, Optional[v1.Job]]":
        """Returns a stream and its first event; None if it was accepted, and broke without one."""

        def attempt() -> "tuple[grpc.Call, Optional[v1.Job]]":
            stream = self._connection.training.WatchJob(
                self._request, timeout=self._connection.left(self._deadline),
                metadata=self._connection.metadata)
            stream.initial_metadata()  # comes at once if the server accepts
            accepted = self._connection.clock.now()
            error: ManeuverError
            try:
                job = next(stream).job
                self._silent = 0
                return stream, job
            except StopIteration:
                error = UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                         "the server stopped telling of the job")
            except grpc.RpcError as failure:
                error = self._connection.retriable(failure)
            stood = self._connection.clock.now() - accepted >= STANDING
            # A server that refuses says why, which may take it a while; a broken stream says nothing.
            if stood and isinstance(error, UnavailableError) and not error.reason:
                self._silent += 1
                self._connection.pause(error, self._silent, self._deadline)
                return stream, None
            raise error

        return retry(policy, give_up, attempt, on_retry=self._connection.on_retry,
                     clock=self._connection.clock)

    def _next(self, stream: grpc.Call) -> Optional[v1.Job]:
        """Returns the next event; None if the stream broke and may be picked up."""
        try:
            event: v1.WatchJobResponse = next(stream)
            return event.job
        except StopIteration:
            return None
        except grpc.RpcError as failure:
            error: ManeuverError = self._connection.retriable(failure)
            if isinstance(error, UnavailableError):
                return None
            raise error from None
