"""Reports of outcomes over one stream. Private to the package."""

from __future__ import annotations

import collections
import queue
from typing import Any, Deque, Iterator, Optional, Union

import grpc

from maneuver import v1
from maneuver.connection import Connection
from maneuver.errors import (ManeuverError, ResourceExhaustedError, UnavailableError,
                             from_status)
from maneuver.retry import backoff_after
from maneuver.uploads import PATIENCE

MOST_UNANSWERED = 4


class _Report:
    """A report whose answer was not handed out yet."""

    def __init__(self, request: v1.ReportOutcomesRequest) -> None:
        self.request = request
        # Waits for those of the reports before.
        self.answer: Union[v1.ReportOutcomesResponse, ManeuverError, None] = None


def _is_postponed(answer: Any) -> bool:
    """Returns whether the server wants to have this report again later."""
    return isinstance(answer, ResourceExhaustedError) and answer.retry_delay is not None


def stream_reports(connection: Connection, reports: Iterator[v1.ReportOutcomesRequest],
                   deadline: float) -> Iterator[Union[v1.ReportOutcomesResponse, ManeuverError]]:
    """Yields the answer to each report, in order. Each report has a request_id.

    When the stream breaks, it opens another one and sends the reports again that have no answer.
    When the server has too much to do for a report, it waits and sends that one again. Raises
    ManeuverError once that is in vain.
    """
    waiting: Deque[_Report] = collections.deque()
    failures = 0
    answered = False
    since: Optional[float] = None  # the first failure or postponement after the last answer

    def wait_or_raise(wait: float, failure: ManeuverError) -> None:
        """Waits for as long. Raises `failure` instead if that would be too long."""
        nonlocal since
        now = connection.clock.now()
        since = now if since is None else since
        if now + wait >= min(since + PATIENCE, deadline):
            raise failure
        if connection.on_retry is not None:
            connection.on_retry(failure, wait)
        connection.clock.sleep(wait)

    while True:
        outgoing: "queue.SimpleQueue[Optional[v1.StreamOutcomesRequest]]" = queue.SimpleQueue()
        sent: Deque[_Report] = collections.deque()  # in the order of their answers
        postponement: Optional[ManeuverError] = None
        broken: Optional[ManeuverError] = None

        def send(report: _Report) -> None:
            sent.append(report)
            outgoing.put(v1.StreamOutcomesRequest(report=report.request))

        for report in waiting:
            if report.answer is None:
                send(report)
        call: Any = connection.outcomes.StreamOutcomes(
            iter(outgoing.get, None), timeout=connection.left(deadline),
            metadata=connection.metadata)
        try:
            while broken is None:
                while len(waiting) < MOST_UNANSWERED:
                    following = next(reports, None)
                    if following is None:
                        break
                    waiting.append(_Report(following))
                    send(waiting[-1])
                if not waiting:
                    return
                if not sent:
                    assert postponement is not None
                    wait_or_raise(max(connection.retries.initial_backoff,
                                      postponement.retry_delay or 0.0), postponement)
                    for report in waiting:
                        if report.answer is None:
                            send(report)
                try:
                    message = next(call)
                except grpc.RpcError as failure:
                    broken = connection.retriable(failure)
                    continue
                except StopIteration:
                    broken = UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                              "the server ended the stream")
                    continue
                answer = (from_status(message.error) if message.WhichOneof("outcome") == "error"
                          else message.response)
                report = sent.popleft()
                if _is_postponed(answer):
                    postponement = answer
                    continue
                report.answer = answer
                answered, failures, since = True, 0, None
                while waiting and (ready := waiting[0].answer) is not None:
                    waiting.popleft()
                    yield ready
        finally:
            outgoing.put(None)  # lets gRPC's sender go
            if waiting:
                call.cancel()
        failures += 1
        if not isinstance(broken, UnavailableError) or (
                not answered and failures >= connection.retries.max_attempts):
            raise broken
        wait_or_raise(max(backoff_after(connection.retries, failures, connection.clock.uniform()),
                          broken.retry_delay or 0.0), broken)
