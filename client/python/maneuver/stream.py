"""Predictions in a planner's loop, over one stream.

    def on_answer(answer: maneuver.StreamAnswer) -> None: ...

    with client.stream_predict(on_answer) as stream:
        while driving:
            stream.send(str(cycle), scene, request_timeout=0.08)
"""

from __future__ import annotations

import dataclasses
import queue
import threading
from typing import Any, Callable, Iterator, Optional, Sequence

import grpc

from maneuver import v1
from maneuver.answers import Predictions, predictions_of
from maneuver.connection import Connection
from maneuver.errors import ManeuverError, from_rpc, from_status
from maneuver.predictor import query
from maneuver.scenes import Scenes, to_protos


@dataclasses.dataclass(frozen=True)
class StreamAnswer:
    """The answer to one request of a stream: predictions, or why there are none."""

    request_id: str
    predictions: Optional[Predictions]
    error: Optional[ManeuverError]


# Called for each answer, one at a time, on a thread of the stream's own.
OnAnswer = Callable[[StreamAnswer], None]

# Most requests that gRPC has not taken yet.
_MOST_WAITING = 64


class PredictStream:
    """Many requests in flight, answered as they finish, each by its request_id. Thread-safe.

    Client.stream_predict makes one. As a context manager it finishes at the end, and cancels after
    an exception.
    """

    def __init__(self, connection: Connection, on_answer: OnAnswer, timeout: float) -> None:
        self._on_answer = on_answer
        self._requests: "queue.SimpleQueue[Optional[v1.StreamPredictRequest]]" = queue.SimpleQueue()
        self._changed = threading.Condition()
        # Guarded by _changed, with what goes into _requests.
        self._takes_more = True
        self._waiting = 0  # requests in _requests
        self._failure: Optional[BaseException] = None  # how it ended
        self._call: Any = connection.predictions.StreamPredict(
            self._outgoing(), timeout=timeout, metadata=connection.metadata)
        self._reader = threading.Thread(target=self._read, name="maneuver-stream", daemon=True)
        self._reader.start()

    def send(self, request_id: str, scenes: Scenes, *, model: str = "",
             action_ids: Optional[Sequence[int]] = None, min_probability: Optional[float] = None,
             top_k: Optional[int] = None, source: str = "posterior", frame: str = "world",
             sigma_trajectories: bool = True, representatives: int = 0, joint: int = 0,
             include_action_names: bool = False, required_action_names: Sequence[str] = (),
             strict: bool = False, request_timeout: Optional[float] = None) -> None:
        """Hands a request to the stream; see Client.predict for what it asks.

        request_id: the caller's name for it, at most 128 characters.
        request_timeout: the server gives up on this request so many seconds after its arrival.

        Waits while 64 requests wait to be sent, because the server takes them more slowly than they
        come; skip a cycle then.

        Raises ManeuverError once the stream has broken: then open another one. Raises what
        `on_answer` raised, if it did. Raises ValueError after finish(), and ValueError or
        CancelledError after cancel().
        """
        message = v1.StreamPredictRequest(request_id=request_id, request=v1.PredictRequest(
            model=model, scenarios=to_protos(scenes),
            query=query(action_ids=action_ids, min_probability=min_probability, top_k=top_k,
                        source=source, frame=frame, sigma_trajectories=sigma_trajectories,
                        representatives=representatives, joint=joint),
            include_action_names=include_action_names,
            required_action_names=required_action_names, strict=strict))
        if request_timeout is not None:
            message.timeout.FromNanoseconds(round(request_timeout * 1e9))
        with self._changed:
            while self._takes_more and self._waiting >= _MOST_WAITING:
                self._changed.wait()
            if self._takes_more:
                self._waiting += 1
                self._requests.put(message)
                return
        self._raise_failure()
        raise ValueError("the stream is finished or cancelled")

    def _take_no_more(self) -> None:
        with self._changed:
            self._takes_more = False
            self._requests.put(None)  # lets gRPC's sender go
            self._changed.notify_all()

    def finish(self) -> None:
        """Says that no more requests come, and waits for the answers in flight.

        Raises ManeuverError if the stream broke, and what `on_answer` raised if it did.
        """
        self._take_no_more()
        self._reader.join()
        self._raise_failure()

    def cancel(self) -> None:
        """Ends the stream at once; finish() then raises CancelledError."""
        self._call.cancel()
        self._take_no_more()

    def __enter__(self) -> "PredictStream":
        return self

    def __exit__(self, kind: Optional[type], *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.cancel()
            self._reader.join()

    def _outgoing(self) -> Iterator[v1.StreamPredictRequest]:
        for message in iter(self._requests.get, None):
            with self._changed:
                self._waiting -= 1
                self._changed.notify()
            yield message

    def _read(self) -> None:
        try:
            for message in self._call:
                if message.WhichOneof("outcome") == "error":
                    answer = StreamAnswer(message.request_id, None, from_status(message.error))
                else:
                    answer = StreamAnswer(message.request_id, predictions_of(message.response),
                                          None)
                self._on_answer(answer)
        except grpc.RpcError as failure:
            self._failure = from_rpc(failure)
        except BaseException as failure:  # the caller's own, which finish() raises
            self._failure = failure
            self._call.cancel()
        self._take_no_more()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure
