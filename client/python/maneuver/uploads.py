"""Uploading a dataset folder, which goes on where it broke off."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Callable, Iterator, List, Optional

import grpc
from google.protobuf import json_format

from maneuver import v1
from maneuver.connection import Connection, retriable
from maneuver.errors import DataLossError, UnavailableError

CHUNK_BYTES = 512 * 1024
PATIENCE = 120.0  # an upload that broke off goes on for so long after the last byte, seconds


@dataclasses.dataclass(frozen=True)
class UploadProgress:
    """How far an upload is, bytes of shards."""

    there: int  # on the server, or on the way to it
    total: int  # of the whole dataset


OnUploaded = Callable[[UploadProgress], None]


def read_folder(folder: pathlib.Path) -> v1.Dataset:
    """Returns dataset.json of a folder whose shards have the sizes that it states.

    Raises OSError for files that are not there, ValueError for a folder that is damaged.
    """
    manifest = folder / "dataset.json"
    try:
        dataset: v1.Dataset = json_format.Parse(manifest.read_text(encoding="utf-8"), v1.Dataset())
    except json_format.ParseError as error:
        raise ValueError(f"{manifest} is damaged: {error}") from None
    for shard in dataset.shards:
        size = (folder / shard.file).stat().st_size
        if size != shard.size_bytes:
            raise ValueError(f"{folder / shard.file} has {size} bytes; dataset.json says "
                             f"{shard.size_bytes}")
    return dataset


class Upload:
    """One dataset on its way to the server."""

    def __init__(self, connection: Connection, folder: pathlib.Path, name: str,
                 on_progress: Optional[OnUploaded]) -> None:
        self._connection = connection
        self._folder = folder
        self._name = name
        self._dataset = read_folder(folder)
        self._on_progress = on_progress
        self._total = sum(shard.size_bytes for shard in self._dataset.shards)
        self._has_sent = False

    def run(self, deadline: float) -> v1.Dataset:
        """Returns the dataset once it is committed. Raises ManeuverError."""
        connection = self._connection
        give_up = min(deadline, connection.clock.now() + PATIENCE)
        may_start_clean = True
        most_arrived = 0
        while True:
            there = 0
            try:
                answer: v1.QueryUploadResponse = connection.call(
                    connection.datasets.QueryUpload,
                    v1.QueryUploadRequest(name=self._name, dataset=self._dataset), deadline)
                # What this call has sent was committed, and the answer lost.
                if self._has_sent and answer.HasField("committed"):
                    return answer.committed
                there = sum(answer.arrived_bytes)
                if there > most_arrived:  # each byte that arrives earns the upload more patience
                    most_arrived = there
                    give_up = min(deadline, connection.clock.now() + PATIENCE)
                return self._send(list(answer.arrived_bytes), deadline)
            except UnavailableError:
                if not self._has_sent or connection.clock.now() >= give_up:
                    raise
                connection.clock.sleep(connection.retries.initial_backoff)
            except DataLossError:
                # What lay there from before was wrong, and is gone now.
                if there == 0 or not may_start_clean:
                    raise
                may_start_clean = False

    def _send(self, arrived: List[int], deadline: float) -> v1.Dataset:
        """Sends what has not arrived."""
        self._has_sent = True
        broken: List[BaseException] = []

        def guarded() -> Iterator[v1.UploadDatasetRequest]:
            # gRPC would hide what goes wrong with a file.
            try:
                yield from self._messages(arrived)
            except Exception as error:
                broken.append(error)
                raise

        try:
            committed: v1.Dataset = self._connection.datasets.UploadDataset(
                guarded(), timeout=self._connection.left(deadline),
                metadata=self._connection.metadata)
            return committed
        except grpc.RpcError as failure:
            if broken:
                raise broken[0] from None
            raise retriable(failure) from None

    def _messages(self, arrived: List[int]) -> Iterator[v1.UploadDatasetRequest]:
        yield v1.UploadDatasetRequest(header=v1.UploadHeader(
            name=self._name, dataset=self._dataset, arrived_bytes=arrived))
        there = sum(arrived)
        self._show(there)
        for shard, offset in zip(self._dataset.shards, arrived):
            with open(self._folder / shard.file, "rb") as file:
                file.seek(offset)
                while offset < shard.size_bytes:
                    chunk = file.read(min(CHUNK_BYTES, shard.size_bytes - offset))
                    if not chunk:
                        raise ValueError(f"{file.name} cannot be read to its end")
                    yield v1.UploadDatasetRequest(chunk=chunk)
                    offset += len(chunk)
                    there += len(chunk)
                    self._show(there)

    def _show(self, there: int) -> None:
        if self._on_progress is not None:
            self._on_progress(UploadProgress(there, self._total))
