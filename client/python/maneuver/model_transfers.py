"""Bringing model versions to a server and from it. Private to the package."""

from __future__ import annotations

import hashlib
import os
import pathlib
import re
import shutil
from typing import Iterator, List, Optional, Sequence, Tuple

import grpc

from maneuver import v1
from maneuver.connection import Connection, retriable
from maneuver.errors import DataLossError, InternalError, InvalidArgumentError, UnavailableError
from maneuver.uploads import PATIENCE, LocalFile, OnUploaded, Upload, UploadProgress

_MAX_FILES = 16
_SAFE_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,99}")  # leads out of no folder
_SHA256 = re.compile(r"[0-9a-f]{64}")


def sha256_of(path: pathlib.Path) -> str:
    """Returns the SHA-256 of a file, lower-case hexadecimal. Raises OSError."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


class ModelUpload(Upload[v1.ModelVersion]):
    """One version on its way to the server. Raises OSError if the folder is not whole."""

    may_be_committed_before = True

    def __init__(self, connection: Connection, folder: pathlib.Path, parent: str,
                 on_progress: Optional[OnUploaded]) -> None:
        names = ["model.json", "weights.safetensors"]
        if (folder / "baselines.json").exists():
            names += ["baselines.json", "baselines.safetensors"]
        self._parent = parent
        self._announced = [
            v1.ModelFile(file=name, size_bytes=(folder / name).stat().st_size,
                         sha256=sha256_of(folder / name)) for name in names]
        super().__init__(connection, [LocalFile(folder / file.file, file.size_bytes)
                                      for file in self._announced], on_progress)

    def _ask(self, deadline: float) -> Tuple[List[int], Optional[v1.ModelVersion]]:
        answer: v1.QueryModelUploadResponse = self._connection.call(
            self._connection.models.QueryModelUpload,
            v1.QueryModelUploadRequest(parent=self._parent, files=self._announced), deadline)
        committed = answer.committed if answer.HasField("committed") else None
        return list(answer.arrived_bytes), committed

    def _call(self, arrived: Sequence[int], chunks: Iterator[bytes],
              timeout: float) -> v1.ModelVersion:
        def messages() -> Iterator[v1.UploadModelVersionRequest]:
            yield v1.UploadModelVersionRequest(header=v1.UploadModelHeader(
                parent=self._parent, files=self._announced, arrived_bytes=arrived))
            for chunk in chunks:
                yield v1.UploadModelVersionRequest(chunk=chunk)

        committed: v1.ModelVersion = self._connection.models.UploadModelVersion(
            messages(), timeout=timeout, metadata=self._connection.metadata)
        return committed


class ModelDownload:
    """One version on its way into a folder.

    What has arrived lies in .FOLDER.part beside it, each file under its SHA-256, until the folder
    is whole. `maneuver model pull` keeps it there too.
    """

    def __init__(self, connection: Connection, name: str, folder: pathlib.Path,
                 on_progress: Optional[OnUploaded]) -> None:
        self._connection = connection
        self._name = name
        self._folder = folder.absolute()
        self._part = self._folder.parent / f".{self._folder.name}.part"
        self._on_progress = on_progress
        self._header: Optional[v1.DownloadModelHeader] = None  # what .FOLDER.part was planned for

    def run(self, deadline: float) -> str:
        """Returns the version's name once the folder is whole.

        Raises ManeuverError, FileExistsError if the folder holds something else, or OSError.
        """
        connection = self._connection
        give_up = min(deadline, connection.clock.now() + PATIENCE)
        attempts = 0  # since the last byte that arrived
        may_start_clean = True
        while True:
            before = sum(self._arrived())
            try:
                while not self._follow(deadline):
                    pass
                assert self._header is not None
                return self._header.model_version
            except UnavailableError as failure:
                attempts += 1
                if sum(self._arrived()) > before:
                    attempts, give_up = 0, min(deadline, connection.clock.now() + PATIENCE)
                wait = connection.retries.initial_backoff
                has_begun = self._header is not None
                if (connection.clock.now() + wait >= give_up
                        or (not has_begun and attempts >= connection.retries.max_attempts)):
                    raise
                if connection.on_retry is not None:
                    connection.on_retry(failure, wait)
                connection.clock.sleep(wait)
            except (DataLossError, InvalidArgumentError):
                # What lay here was wrong, and is gone now; or the version has changed since.
                if not may_start_clean:
                    raise
                may_start_clean = False
                self._header = None

    def _follow(self, deadline: float) -> bool:
        """Makes one call. Returns whether the folder is whole; False asks for another call."""
        known = self._header
        request = v1.DownloadModelVersionRequest(
            name=known.model_version if known else self._name, arrived_bytes=self._arrived())
        responses = self._connection.models.DownloadModelVersion(
            request, timeout=self._connection.left(deadline), metadata=self._connection.metadata)
        try:
            header = self._header_of(next(responses, v1.DownloadModelVersionResponse()))
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
            raise retriable(failure) from None
        finally:
            responses.cancel()
        self._commit(header)
        return True

    @staticmethod
    def _header_of(response: v1.DownloadModelVersionResponse) -> v1.DownloadModelHeader:
        header = response.header
        names = {file.file for file in header.files}
        if (not 0 < len(header.files) <= _MAX_FILES or len(names) < len(header.files)
                or not all(_SAFE_NAME.fullmatch(file.file) and _SHA256.fullmatch(file.sha256)
                           and file.size_bytes >= 0 for file in header.files)):
            raise InternalError(grpc.StatusCode.INTERNAL,
                                "the server sends files that cannot be those of a model")
        return header

    def _arrived(self) -> List[int]:
        """Returns how many bytes of each file are here; [] before the files are known."""
        if self._header is None:
            return []
        paths = [self._part / file.sha256 for file in self._header.files]
        return [path.stat().st_size if path.exists() else 0 for path in paths]

    def _plan(self, header: v1.DownloadModelHeader) -> None:
        """Removes what lies here of other files."""
        self._part.mkdir(parents=True, exist_ok=True)
        sizes = {file.sha256: file.size_bytes for file in header.files}
        for path in self._part.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.stat().st_size > sizes.get(path.name, -1):
                path.unlink()

    def _receive(self, header: v1.DownloadModelHeader,
                 responses: Iterator[v1.DownloadModelVersionResponse]) -> None:
        """Writes what is sent, and checks each file."""
        total = sum(file.size_bytes for file in header.files)
        there = sum(self._arrived())
        self._show(there, total)
        pending = b""
        for file in header.files:
            path = self._part / file.sha256
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
    def _chunk_of(response: Optional[v1.DownloadModelVersionResponse]) -> bytes:
        if response is None:
            raise UnavailableError(grpc.StatusCode.UNAVAILABLE,
                                   "the server ended the download before its end")
        return response.chunk

    def _check_same(self, header: v1.DownloadModelHeader) -> None:
        for file in header.files:
            path = self._folder / file.file
            if not path.is_file() or sha256_of(path) != file.sha256:
                raise FileExistsError(f"{self._folder} exists already and is not "
                                      f"{header.model_version}; name another folder")

    def _commit(self, header: v1.DownloadModelHeader) -> None:
        """Makes the folder of what has arrived."""
        for file in header.files:
            os.rename(self._part / file.sha256, self._part / file.file)
        os.rename(self._part, self._folder)

    def _show(self, there: int, total: int) -> None:
        if self._on_progress is not None:
            self._on_progress(UploadProgress(there, total))
