"""Callers who ask again and again, and remember what became of each call."""

import collections
import threading
import time

import grpc

PREDICT = "/maneuver.v1.PredictionService/Predict"
STREAM = "/maneuver.v1.PredictionService/StreamPredict"
DEADLINE_S = 600  # none is to fail for want of time
# HAProxy 2.6 resets a stream whose replica ends it before its caller has: CANCELLED in place of UNAVAILABLE.
STREAM_ENDS = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED)

Failure = collections.namedtuple("Failure", "code begun ended details")


class Callers:
    """So many threads, each with one unary call at a time over one channel."""

    def __init__(self, channel, request, threads=4, pause_s=0.01):
        self._predict = channel.unary_unary(PREDICT)
        self._request = request
        self._pause_s = pause_s
        self._stop = threading.Event()
        self._lock = threading.Lock()  # guards what follows
        self.answered = 0
        self.failures = []
        self._threads = [threading.Thread(target=self._call) for _ in range(threads)]
        for thread in self._threads:
            thread.start()

    def _call(self):
        while not self._stop.wait(self._pause_s):
            begun = time.monotonic()
            try:
                self._predict(self._request, timeout=DEADLINE_S)
            except grpc.RpcError as error:
                failure = Failure(error.code().name, begun, time.monotonic(), error.details())
                with self._lock:
                    self.failures.append(failure)
            else:
                with self._lock:
                    self.answered += 1

    def end(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()


class Streamer:
    """One StreamPredict, in lockstep; when the server ends it, another one, with what was not answered."""

    def __init__(self, channel, messages, request, pause_s=0.02):
        self._stream = channel.stream_stream(STREAM, request_serializer=messages.StreamPredictRequest.SerializeToString,
                                             response_deserializer=messages.StreamPredictResponse.FromString)
        self._messages = messages
        self._request = request
        self._pause_s = pause_s
        self._stop = threading.Event()
        self.answered = 0
        self.reopened = 0
        self.failures = []  # for other reasons, or wrong answers
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.is_set():
            turn = threading.Semaphore(1)
            ended = threading.Event()
            stream = self._stream(self._requests(turn, ended), timeout=600)
            begun = time.monotonic()
            try:
                for response in stream:
                    if response.request_id != str(self.answered) or not response.HasField("response"):
                        self.failures.append(Failure("ANSWER", begun, time.monotonic(), str(response)[:200]))
                        return
                    self.answered += 1
                    turn.release()
            except grpc.RpcError as error:
                if error.code() not in STREAM_ENDS:
                    self.failures.append(Failure(error.code().name, begun, time.monotonic(), error.details()))
                self.reopened += 1
                self._stop.wait(0.1)
            finally:
                ended.set()

    def _requests(self, turn, ended):
        while not self._stop.wait(self._pause_s) and not ended.is_set():
            if turn.acquire(timeout=0.1):
                yield self._messages.StreamPredictRequest(request_id=str(self.answered), request=self._request)

    def end(self):
        self._stop.set()
        self._thread.join()
