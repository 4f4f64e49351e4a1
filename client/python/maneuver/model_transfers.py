"""Bringing model versions to a server. Private to the package."""

from __future__ import annotations

import pathlib
from typing import Iterator, List, Optional, Sequence, Tuple

from maneuver import v1
from maneuver.connection import Connection
from maneuver.downloads import sha256_of
from maneuver.uploads import LocalFile, OnUploaded, Upload

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
