"""Reports of outcomes over one stream. Private to the package."""

from __future__ import annotations

import collections
import queue
from typing import Any, Deque, Iterator, Optional, Union

import grpc

from maneuver import v1
from maneuver.connection import Connection, retriable
from maneuver.errors import (ManeuverError, ResourceExhaustedError, UnavailableError,
                             from_status)
from maneuver.retry import backoff_after
from maneuver.uploads import PATIENCE

MOST_UNANSWERED = 4


def is_postponed(answer: Any) -> bool:
    """Returns whether the server wants to have this report again later."""
    return isinstance(answer, ResourceExhaustedError) and answer.retry_delay is not None


def stream_reports(connection: Connection, reports: Iterator[v1.ReportOutcomesRequest],
                   deadline: float) -> Iterator[Union[v1.ReportOutcomesResponse, ManeuverError]]:
    """Yields the answer to each report, in order. Each report has a request_id.

    When the stream breaks, or the server has too much to do for a report, it waits, opens another
    stream and sends the reports again that have no answer. Raises ManeuverError once that is in
    vain.
    """
    unanswered: Deque[v1.ReportOutcomesRequest] = collections.deque()
    failures = 0
    last_answer: Optional[float] = None
    while True:
        outgoing: "queue.SimpleQueue[Optional[v1.StreamOutcomesRequest]]" = queue.SimpleQueue()
        for report in unanswered:
            outgoing.put(v1.StreamOutcomesRequest(report=report))
        call: Any = connection.outcomes.StreamOutcomes(
            iter(outgoing.get, None), timeout=connection.left(deadline),
            metadata=connection.metadata)
        try:
            while True:
                while len(unanswered) < MOST_UNANSWERED:
                    following = next(reports, None)
                    if following is None:
                        break
                    unanswered.append(following)
                    outgoing.put(v1.StreamOutcomesRequest(report=following))
                if not unanswered:
                    return
                try:
                    message = next(call)
                except grpc.RpcError as failure:
                    raise retriable(failure) from None
                except StopIteration:
                    raise UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                           "the server ended the stream") from None
                answer = (from_status(message.error) if message.WhichOneof("outcome") == "error"
                          else message.response)
                if is_postponed(answer):
                    if last_answer is None:
                        last_answer = connection.clock.now()
                    raise answer
                unanswered.popleft()
                failures, last_answer = 0, connection.clock.now()
                yield answer
        except (UnavailableError, ResourceExhaustedError) as failure:
            if not (isinstance(failure, UnavailableError) or is_postponed(failure)):
                raise
            failures += 1
            wait = max(backoff_after(connection.retries, failures, connection.clock.uniform()),
                       failure.retry_delay or 0.0)
            then = connection.clock.now() + wait
            in_vain = (failures >= connection.retries.max_attempts if last_answer is None
                       else then >= last_answer + PATIENCE)
            if in_vain or then >= deadline:
                raise
            if connection.on_retry is not None:
                connection.on_retry(failure, wait)
        finally:
            outgoing.put(None)  # lets gRPC's sender go
            if unanswered:
                call.cancel()
        connection.clock.sleep(wait)
