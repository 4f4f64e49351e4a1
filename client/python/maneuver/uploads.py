"""Uploading files, which continues where it broke off. Private, but for UploadProgress."""

from __future__ import annotations

import abc
import dataclasses
import hashlib
import pathlib
import re
from typing import Callable, Generic, Iterator, List, NamedTuple, Optional, Sequence, Tuple, TypeVar

import grpc
from google.protobuf import json_format

from maneuver import v1
from maneuver.connection import Connection
from maneuver.errors import DataLossError, UnavailableError

CHUNK_BYTES = 512 * 1024
PATIENCE = 120.0  # a transfer that broke off goes on for so long after the last byte, seconds


@dataclasses.dataclass(frozen=True)
class UploadProgress:
    """How far an upload or a download is, bytes."""

    there: int  # at the receiver, or on the way to it
    total: int  # of all files


OnUploaded = Callable[[UploadProgress], None]


class LocalFile(NamedTuple):
    """A file that is sent whole."""

    path: pathlib.Path
    size_bytes: int


_Committed = TypeVar("_Committed")


class Upload(abc.ABC, Generic[_Committed]):
    """Files on their way to the server."""

    # Whether `_ask` may name what an earlier upload committed as the result of this one.
    may_be_committed_before = False

    def __init__(self, connection: Connection, files: Sequence[LocalFile],
                 on_progress: Optional[OnUploaded]) -> None:
        self._connection = connection
        self._files = files
        self._on_progress = on_progress
        self._total = sum(file.size_bytes for file in files)
        self._has_sent = False

    @abc.abstractmethod
    def _ask(self, deadline: float) -> Tuple[List[int], Optional[_Committed]]:
        """Returns the bytes of each file that have arrived, and what is committed already."""

    @abc.abstractmethod
    def _call(self, arrived: Sequence[int], chunks: Iterator[bytes], timeout: float) -> _Committed:
        """Makes the call that sends `chunks`. Raises grpc.RpcError."""

    def run(self, deadline: float) -> _Committed:
        """Returns the answer once everything is committed. Raises ManeuverError."""
        connection = self._connection
        give_up = min(deadline, connection.clock.now() + PATIENCE)
        failures = 0  # since the last byte that arrived
        may_start_clean = True
        most_arrived = 0
        while True:
            there = 0
            earned = False  # each byte that arrives, and the first sending, earn more patience
            try:
                arrived, committed = self._ask(deadline)
                # What this call has sent was committed, and the answer lost.
                if committed is not None and (self._has_sent or self.may_be_committed_before):
                    return committed
                there = sum(arrived)
                earned = there > most_arrived or not self._has_sent
                most_arrived = max(most_arrived, there)
                return self._send(arrived, deadline)
            except UnavailableError as failure:
                failures += 1
                if earned:  # counts from here: what was sent may have taken longer
                    failures, give_up = 1, min(deadline, connection.clock.now() + PATIENCE)
                if not self._has_sent:
                    raise
                connection.pause(failure, failures, give_up)
            except DataLossError:
                # What lay there from before was wrong, and is gone now.
                if there == 0 or not may_start_clean:
                    raise
                may_start_clean = False
                most_arrived = 0

    def _send(self, arrived: Sequence[int], deadline: float) -> _Committed:
        """Sends what has not arrived."""
        self._has_sent = True
        broken: List[BaseException] = []

        def guarded() -> Iterator[bytes]:
            # gRPC would hide what goes wrong with a file.
            try:
                yield from self._chunks(arrived)
            except Exception as error:
                broken.append(error)
                raise

        try:
            return self._call(arrived, guarded(), self._connection.left(deadline))
        except grpc.RpcError as failure:
            if broken:
                raise broken[0] from None
            raise self._connection.retriable(failure) from None

    def _chunks(self, arrived: Sequence[int]) -> Iterator[bytes]:
        there = sum(arrived)
        self._show(there)
        for (path, size), offset in zip(self._files, arrived):
            with open(path, "rb") as file:
                file.seek(offset)
                while offset < size:
                    chunk = file.read(min(CHUNK_BYTES, size - offset))
                    if not chunk:
                        raise ValueError(f"{path} cannot be read to its end")
                    yield chunk
                    offset += len(chunk)
                    there += len(chunk)
                    self._show(there)

    def _show(self, there: int) -> None:
        if self._on_progress is not None:
            self._on_progress(UploadProgress(there, self._total))


# How a file begins that carries the SHA-256 of the rest, as model/files/sealed_json.h has it.
_SEAL = re.compile(r'\{\n "content_sha256": "(.{64})",', re.DOTALL)


def _unsealed(text: str) -> str:
    """Returns JSON without its digest. Raises ValueError if the digest is another. Text without one stays as it is."""
    seal = _SEAL.match(text)
    if seal is None:
        return text
    json = "{" + text[seal.end():]
    if hashlib.sha256(json.encode()).hexdigest() != seal[1]:
        raise ValueError("its SHA-256 is not what it says; if you changed it on purpose, remove its line content_sha256")
    return json


def read_folder(folder: pathlib.Path) -> v1.Dataset:
    """Returns dataset.json of a folder whose shards have the sizes that it states.

    Raises OSError for files that are not there, ValueError for a folder that is damaged.
    """
    manifest = folder / "dataset.json"
    try:
        dataset: v1.Dataset = json_format.Parse(_unsealed(manifest.read_bytes().decode()), v1.Dataset())
    except (json_format.ParseError, ValueError) as error:
        raise ValueError(f"{manifest} is damaged: {error}") from None
    for shard in dataset.shards:
        size = (folder / shard.file).stat().st_size
        if size != shard.size_bytes:
            raise ValueError(f"{folder / shard.file} has {size} bytes; dataset.json says "
                             f"{shard.size_bytes}")
    return dataset


class DatasetUpload(Upload[v1.Dataset]):
    """One dataset on its way to the server."""

    def __init__(self, connection: Connection, folder: pathlib.Path, name: str,
                 on_progress: Optional[OnUploaded]) -> None:
        self._name = name
        self._dataset = read_folder(folder)
        super().__init__(connection, [LocalFile(folder / shard.file, shard.size_bytes)
                                      for shard in self._dataset.shards], on_progress)

    def _ask(self, deadline: float) -> Tuple[List[int], Optional[v1.Dataset]]:
        answer: v1.QueryUploadResponse = self._connection.call(
            self._connection.datasets.QueryUpload,
            v1.QueryUploadRequest(name=self._name, dataset=self._dataset), deadline)
        committed = answer.committed if answer.HasField("committed") else None
        return list(answer.arrived_bytes), committed

    def _call(self, arrived: Sequence[int], chunks: Iterator[bytes], timeout: float) -> v1.Dataset:
        def messages() -> Iterator[v1.UploadDatasetRequest]:
            yield v1.UploadDatasetRequest(header=v1.UploadHeader(
                name=self._name, dataset=self._dataset, arrived_bytes=arrived))
            for chunk in chunks:
                yield v1.UploadDatasetRequest(chunk=chunk)

        committed: v1.Dataset = self._connection.datasets.UploadDataset(
            messages(), timeout=timeout, metadata=self._connection.metadata)
        return committed
