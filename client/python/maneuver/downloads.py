"""Bringing files from a server into a folder. Private to the package."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pathlib
import re
import shutil
from typing import Any, Callable, Iterator, List, Optional, Sequence, Union

import grpc

from maneuver import v1
from maneuver.connection import Connection
from maneuver.errors import DataLossError, InternalError, InvalidArgumentError, UnavailableError
from maneuver.uploads import PATIENCE, OnUploaded, UploadProgress

_SAFE_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,199}")  # leads out of no folder
_SHA256 = re.compile(r"[0-9a-f]{64}")

# What the first message of a download says; both have `files`.
Header = Union[v1.DownloadModelHeader, v1.DownloadTagsHeader]


@dataclasses.dataclass(frozen=True)
class Kind:
    """What differs between one kind of download and another."""

    noun: str
    most_files: int
    # Begins a call for a resource: its name, what has arrived of each file, seconds. Its messages
    # have a header or a chunk.
    send: Callable[[str, Sequence[int], float], Any]
    resource_of: Callable[[Any], str]  # what a header says is sent


def model_version(connection: Connection) -> Kind:
    """Returns how a version of a model is downloaded."""
    return Kind("a model", 16, lambda name, arrived, timeout: (
        connection.models.DownloadModelVersion(
            v1.DownloadModelVersionRequest(name=name, arrived_bytes=arrived), timeout=timeout,
            metadata=connection.metadata)), lambda header: str(header.model_version))


def tags(connection: Connection) -> Kind:
    """Returns how tags are downloaded."""
    return Kind("tags", 1_000_000, lambda name, arrived, timeout: (
        connection.tags.DownloadTags(
            v1.DownloadTagsRequest(name=name, arrived_bytes=arrived), timeout=timeout,
            metadata=connection.metadata)), lambda header: str(header.name))


def sha256_of(path: pathlib.Path) -> str:
    """Returns the SHA-256 of a file, lower-case hexadecimal. Raises OSError."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


class FileDownload:
    """Files on their way into a folder.

    What has arrived lies in .FOLDER.part beside it until the folder is whole. `maneuver model pull`
    and `maneuver tags pull` keep it there too.
    """

    def __init__(self, connection: Connection, kind: Kind, name: str, folder: pathlib.Path,
                 on_progress: Optional[OnUploaded]) -> None:
        self._connection = connection
        self._kind = kind
        self._name = name
        self._folder = folder.absolute()
        self._part = self._folder.parent / f".{self._folder.name}.part"
        self._on_progress = on_progress
        self._header: Optional[Header] = None  # what .FOLDER.part was planned for

    def run(self, deadline: float) -> str:
        """Returns the name of what was sent once the folder is whole.

        Raises ManeuverError, FileExistsError if the folder holds something else, or OSError.
        """
        connection = self._connection
        give_up = min(deadline, connection.clock.now() + PATIENCE)
        failures = 0  # since the last byte that arrived
        may_start_clean = True
        while True:
            before = sum(self._arrived())
            try:
                while not self._follow(deadline):
                    pass
                assert self._header is not None
                return self._kind.resource_of(self._header)
            except UnavailableError as failure:
                failures += 1
                if sum(self._arrived()) > before:
                    failures, give_up = 1, min(deadline, connection.clock.now() + PATIENCE)
                if self._header is None and failures >= connection.retries.max_attempts:
                    raise
                connection.pause(failure, failures, give_up)
            except (DataLossError, InvalidArgumentError):
                # What lay here was wrong, and is gone now; or what is sent has changed since.
                if not may_start_clean:
                    raise
                may_start_clean = False
                self._header = None

    def _follow(self, deadline: float) -> bool:
        """Makes one call. Returns whether the folder is whole; False asks for another call."""
        known = self._header
        responses = self._kind.send(
            self._kind.resource_of(known) if known else self._name, self._arrived(),
            self._connection.left(deadline))
        try:
            header = self._header_of(next(responses, None))
            if self._folder.exists() and any(self._folder.iterdir()):
                self._check_same(header)
                self._header = header
                return True
            if header != known:
                self._header = header
                self._plan(header)
                if known is not None or any(self._arrived()):
                    return False
            self._receive(header, responses)
        except grpc.RpcError as failure:
            raise self._connection.retriable(failure) from None
        finally:
            responses.cancel()
        self._commit(header)
        return True

    def _header_of(self, response: Any) -> Header:
        header: Header = response.header if response is not None else v1.DownloadModelHeader()
        names = {file.file for file in header.files}
        if (not 0 < len(header.files) <= self._kind.most_files or len(names) < len(header.files)
                or not all(_SAFE_NAME.fullmatch(file.file) and _SHA256.fullmatch(file.sha256)
                           and file.size_bytes >= 0 for file in header.files)):
            raise InternalError(grpc.StatusCode.INTERNAL,
                                f"the server sends files that cannot be those of {self._kind.noun}")
        return header

    def _arrived(self) -> List[int]:
        """Returns how many bytes of each file are here; [] before the files are known."""
        if self._header is None:
            return []
        return [path.stat().st_size if path.exists() else 0
                for path in self._parts(self._header)]

    def _parts(self, header: Header) -> List[pathlib.Path]:
        """Returns where each file arrives: by its digest; of the same bytes, the later ones by more."""
        paths: List[pathlib.Path] = []
        taken = set()
        for file in header.files:
            is_first = file.sha256 not in taken
            taken.add(file.sha256)
            paths.append(self._part / (file.sha256 if is_first else f"{file.sha256}-{file.file}"))
        return paths

    def _plan(self, header: Header) -> None:
        """Removes what lies here of other files."""
        self._part.mkdir(parents=True, exist_ok=True)
        sizes = {path.name: file.size_bytes
                 for path, file in zip(self._parts(header), header.files)}
        for path in self._part.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.stat().st_size > sizes.get(path.name, -1):
                path.unlink()

    def _receive(self, header: Header, responses: Iterator[Any]) -> None:
        """Writes what is sent, and checks each file."""
        total = sum(file.size_bytes for file in header.files)
        there = sum(self._arrived())
        self._show(there, total)
        pending = b""
        for path, file in zip(self._parts(header), header.files):
            with open(path, "ab") as part:
                left = file.size_bytes - part.tell()
                while left > 0:
                    pending = pending or self._chunk_of(next(responses, None))
                    taken, pending = pending[:left], pending[left:]
                    part.write(taken)
                    part.flush()  # counts as arrived, whatever comes next
                    left -= len(taken)
                    there += len(taken)
                    self._show(there, total)
            if sha256_of(path) != file.sha256:
                path.unlink()
                raise DataLossError(
                    grpc.StatusCode.DATA_LOSS,
                    f"{file.file} arrived with another SHA-256 than the server says: it was "
                    "altered on its way, or on the server's disk, or on this one")
        if pending or next(responses, None) is not None:
            raise InternalError(grpc.StatusCode.INTERNAL,
                                "the server sends more bytes than its header says")

    @staticmethod
    def _chunk_of(response: Any) -> bytes:
        if response is None:
            raise UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                   "the server ended the download before its end")
        chunk: bytes = response.chunk
        return chunk

    def _check_same(self, header: Header) -> None:
        is_same = {path.name for path in self._folder.iterdir()} == {file.file for file in header.files}
        for file in header.files:
            path = self._folder / file.file
            is_same = is_same and path.is_file() and sha256_of(path) == file.sha256
        if not is_same:
            raise FileExistsError(f"{self._folder} exists already and is not "
                                  f"{self._kind.resource_of(header)}; name another folder")

    def _commit(self, header: Header) -> None:
        """Makes the folder of what has arrived."""
        for path, file in zip(self._parts(header), header.files):
            os.rename(path, self._part / file.file)
        os.rename(self._part, self._folder)

    def _show(self, there: int, total: int) -> None:
        if self._on_progress is not None:
            self._on_progress(UploadProgress(there, total))
