"""What a failed call says: code, message, reason, wrong fields, and when to try again.

    try:
        client.predict(scene)
    except maneuver.NotFoundError as error:
        if error.reason == "MODEL_NOT_FOUND": ...

Each code has a class of its own, and all are a ManeuverError. docs/reference/errors.md lists the
reasons.
"""

from __future__ import annotations

from typing import Dict, List, NamedTuple, Optional, Sequence, Type, Union

import grpc
from google.protobuf.message import DecodeError

from maneuver import v1


class FieldViolation(NamedTuple):
    """A field of the request that is wrong."""

    field: str  # path from the request: scenarios[2].agents[0].states[5].x
    description: str  # what is wrong with it


class ManeuverError(Exception):
    """A call, one item of a batch, or a job that failed."""

    code: grpc.StatusCode
    message: str  # what is wrong and what to do
    reason: str  # stable, UPPER_SNAKE_CASE; empty if the server gave none
    metadata: Dict[str, str]  # more about the reason
    violations: Sequence[FieldViolation]
    retry_delay: Optional[float]  # seconds to wait at least before trying again
    # Of the reason ACTION_NAME_GONE: required names that no action bears (the first 16).
    missing_action_names: Sequence[str]

    def __init__(self, code: grpc.StatusCode, message: str, reason: str = "",
                 violations: Sequence[FieldViolation] = (), retry_delay: Optional[float] = None,
                 metadata: Optional[Dict[str, str]] = None) -> None:
        super().__init__(code, message, reason, violations, retry_delay, metadata)
        self.code = code
        self.message = message
        self.reason = reason
        self.metadata = dict(metadata or {})
        self.violations = tuple(violations)
        self.retry_delay = retry_delay
        missing: List[str] = []
        while f"action_name_{len(missing)}" in self.metadata:
            missing.append(self.metadata[f"action_name_{len(missing)}"])
        self.missing_action_names = tuple(missing)

    def __str__(self) -> str:
        reason = f" ({self.reason})" if self.reason else ""
        fields = "".join(f"; {field}: {description}" for field, description in self.violations
                         if field not in self.message)
        return f"{self.code.name}{reason}: {self.message}{fields}"


class CancelledError(ManeuverError):
    """The caller cancelled the call, the stream or the job."""


class InvalidArgumentError(ManeuverError):
    """Fields of the request make no sense: see `violations`."""


class DeadlineExceededError(ManeuverError):
    """The call's time was up."""


class NotFoundError(ManeuverError):
    """There is no such model, version, dataset, scenario or job."""


class AlreadyExistsError(ManeuverError):
    """The name is taken."""


class PermissionDeniedError(ManeuverError):
    """The caller may not do this."""


class ResourceExhaustedError(ManeuverError):
    """The server has too much to do, or the request is too large."""


class FailedPreconditionError(ManeuverError):
    """The state of the server does not allow it: see `reason`."""


class AbortedError(ManeuverError):
    """Another call took over."""


class UnimplementedError(ManeuverError):
    """The server does not have this method: it is older than this client."""


class InternalError(ManeuverError):
    """A fault of the server."""


class UnavailableError(ManeuverError):
    """No server answered, or it is not ready."""


class DataLossError(ManeuverError):
    """Stored or uploaded bytes are damaged."""


class UnauthenticatedError(ManeuverError):
    """The server asks who calls, and does not know this caller."""


_CLASSES: Dict[grpc.StatusCode, Type[ManeuverError]] = {
    grpc.StatusCode.CANCELLED: CancelledError,
    grpc.StatusCode.INVALID_ARGUMENT: InvalidArgumentError,
    grpc.StatusCode.DEADLINE_EXCEEDED: DeadlineExceededError,
    grpc.StatusCode.NOT_FOUND: NotFoundError,
    grpc.StatusCode.ALREADY_EXISTS: AlreadyExistsError,
    grpc.StatusCode.PERMISSION_DENIED: PermissionDeniedError,
    grpc.StatusCode.RESOURCE_EXHAUSTED: ResourceExhaustedError,
    grpc.StatusCode.FAILED_PRECONDITION: FailedPreconditionError,
    grpc.StatusCode.ABORTED: AbortedError,
    grpc.StatusCode.UNIMPLEMENTED: UnimplementedError,
    grpc.StatusCode.INTERNAL: InternalError,
    grpc.StatusCode.UNAVAILABLE: UnavailableError,
    grpc.StatusCode.DATA_LOSS: DataLossError,
    grpc.StatusCode.UNAUTHENTICATED: UnauthenticatedError,
}
_CODES = {code.value[0]: code for code in grpc.StatusCode}


def error(code: grpc.StatusCode, message: str, *, status: Optional[v1.Status] = None
          ) -> ManeuverError:
    """Returns the exception of a code, with those details of `status` that parse."""
    reason, metadata, violations = "", {}, []
    retry_delay: Optional[float] = None
    for detail in status.details if status is not None else ():
        kind = detail.type_url.rpartition(".")[2]
        message_type: Optional[Type[Union[v1.ErrorInfo, v1.BadRequest, v1.RetryInfo]]] = {
            "ErrorInfo": v1.ErrorInfo, "BadRequest": v1.BadRequest, "RetryInfo": v1.RetryInfo,
        }.get(kind)
        if message_type is None:
            continue
        try:
            parsed = message_type.FromString(detail.value)
        except DecodeError:  # a detail that does not parse never hides the error itself
            continue
        if isinstance(parsed, v1.ErrorInfo):
            reason, metadata = parsed.reason, dict(parsed.metadata)
        elif isinstance(parsed, v1.BadRequest):
            violations += [FieldViolation(violation.field, violation.description)
                           for violation in parsed.field_violations]
        else:
            retry_delay = parsed.retry_delay.seconds + parsed.retry_delay.nanos * 1e-9
    return _CLASSES.get(code, ManeuverError)(code, message, reason, violations, retry_delay,
                                             metadata)


def from_status(status: v1.Status) -> ManeuverError:
    """Returns the error of one item of a batch, or of a job."""
    return error(_CODES.get(status.code, grpc.StatusCode.UNKNOWN), status.message, status=status)


def from_rpc(failure: grpc.RpcError) -> ManeuverError:
    """Returns the error of a call that failed."""
    status = None
    for key, value in failure.trailing_metadata() or ():
        if key == "grpc-status-details-bin":
            try:
                status = v1.Status.FromString(value)
            except DecodeError:
                status = None
    return error(failure.code(), failure.details() or "", status=status)
