"""Trying again when a server cannot be reached for a moment."""

from __future__ import annotations

import dataclasses
import math
import random
import time
from typing import Callable, Optional, TypeVar

from maneuver.errors import ManeuverError, UnavailableError

_Answer = TypeVar("_Answer")

# Told before each wait: the failure, and the seconds until the next attempt.
OnRetry = Callable[[ManeuverError, float], None]


@dataclasses.dataclass(frozen=True)
class RetryPolicy:
    """When and how often a call is tried again. Times are in seconds.

    A call is tried again if it failed with UNAVAILABLE, or if the server refused it and said when
    to come back (RetryInfo). The wait is then at least what the server asked for.
    """

    max_attempts: int = 4  # the first one included; 1: never retry
    initial_backoff: float = 0.1
    backoff_multiplier: float = 2.0
    max_backoff: float = 5.0
    jitter: float = 0.2  # each wait is longer or shorter by up to this share, in [0, 1]

    def __post_init__(self) -> None:
        if (self.max_attempts < 1 or self.initial_backoff < 0.0 or self.backoff_multiplier < 1.0
                or not 0.0 <= self.jitter <= 1.0):
            raise ValueError("retries need max_attempts >= 1, initial_backoff >= 0, "
                             "backoff_multiplier >= 1 and jitter in [0, 1]")


@dataclasses.dataclass(frozen=True)
class Clock:
    """Time and chance, as the client sees them."""

    now: Callable[[], float] = time.monotonic  # seconds
    sleep: Callable[[float], None] = time.sleep
    uniform: Callable[[], float] = random.random  # in [0, 1)


def backoff_after(policy: RetryPolicy, failures: int, uniform: float) -> float:
    """Returns the seconds to wait after failure number `failures` (from 1).

    uniform: in [0, 1), decides the jitter.
    """
    try:
        growth = policy.backoff_multiplier ** (failures - 1)
    except OverflowError:  # a watch may have failed a thousand times
        growth = math.inf if policy.initial_backoff > 0.0 else 0.0
    nominal = min(policy.initial_backoff * growth, policy.max_backoff)
    return nominal * (1.0 + policy.jitter * (2.0 * uniform - 1.0))


def retry(policy: RetryPolicy, deadline: float, attempt: Callable[[], _Answer], *,
          on_retry: Optional[OnRetry] = None, clock: Clock = Clock()) -> _Answer:
    """Calls `attempt` until it succeeds; returns what it returned.

    Raises the last attempt's error if it may not be tried again, if attempts run out, or if the
    next wait would pass `deadline` (on the clock).
    """
    failures = 0
    while True:
        try:
            return attempt()
        except ManeuverError as failure:
            failures += 1
            may_retry = isinstance(failure, UnavailableError) or failure.retry_delay is not None
            wait = max(backoff_after(policy, failures, clock.uniform()), failure.retry_delay or 0.0)
            if not may_retry or failures >= policy.max_attempts or clock.now() + wait >= deadline:
                raise
            if on_retry is not None:
                on_retry(failure, wait)
        clock.sleep(wait)
