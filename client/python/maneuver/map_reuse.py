"""Sends each road once, for callers that see the same one ten times a second.

    maps = maneuver.MapReuse(client)
    while driving:
        answer = maps.predict(scene, timeout=0.08)  # as client.predict

A scene's map is registered with the server when it is seen for the first time. From then on
requests name the map by its id, which is twenty times smaller on real scenes. When the server does
not hold a map any more it is registered again, and the request repeated. A map that cannot be
registered is sent along as if MapReuse were not there.

Behind a balancer each call may reach another server, and each server has the maps that were
registered with it. While servers without a map keep turning up, it is registered again and again
until all have it. A request is answered meanwhile, too; it only takes more calls.
"""

from __future__ import annotations

import collections
import hashlib
import random
import threading
from typing import Dict, List, Optional, Sequence, TypeVar

from maneuver import v1
from maneuver.client import Client
from maneuver.errors import (FailedPreconditionError, InvalidArgumentError, ManeuverError,
                             UnimplementedError)
from maneuver.predictor import PredictionRequest, Predictor

_Response = TypeVar("_Response")

# Once no map was missing for so many calls, every server has them.
_CALLS_TO_TRUST = 64


def _cannot_be_held(error: ManeuverError) -> bool:
    """Whether registering failed for what the map, or the server, is."""
    return (isinstance(error, (InvalidArgumentError, UnimplementedError))
            or error.reason == "MAP_TOO_LARGE")


class MapReuse(Predictor):
    """A client's predictions, with maps that are sent once. Thread-safe.

    max_maps: how many maps, those that were used last, it remembers.
    """

    def __init__(self, client: Client, max_maps: int = 16) -> None:
        self._client = client
        self._max_maps = max_maps
        self._lock = threading.Lock()  # guards what follows
        # Digest of the features -> id on the server; the one used last is at the end.
        self._known: "collections.OrderedDict[bytes, str]" = collections.OrderedDict()
        self._found = _CALLS_TO_TRUST  # calls since a map was last missing
        self._spreads = False  # whether maps go missing again and again
        self._random = random.Random(1)

    def forget(self) -> None:
        """Has every map registered again before it is named the next time."""
        with self._lock:
            self._known.clear()

    def name_maps(self, scenes: Sequence[v1.Scenario], *, timeout: Optional[float] = None) -> None:
        """For a stream: puts map ids in the place of maps, and registers those that are new.

        When an answer has the reason MAP_NOT_REGISTERED, call forget() and send the scenes anew.
        """
        self._set_aside(scenes, self._client.deadline(timeout))

    def _ask(self, method: str, request: PredictionRequest, timeout: Optional[float],
             response: "type[_Response]") -> _Response:
        deadline = self._client.deadline(timeout)
        for _ in range(2):  # the second time every map is registered anew
            aside = self._set_aside(request.scenarios, deadline)
            try:
                answer = self._client.ask_until(method, request, deadline, response)
                if aside:
                    self._note(was_missing=False)
                return answer
            except FailedPreconditionError as error:
                if not aside or error.reason != "MAP_NOT_REGISTERED":
                    raise
            self._note(was_missing=True)
            self.forget()
            for index, features in aside.items():
                request.scenarios[index].map_id = ""
                request.scenarios[index].map_features.extend(features)
        # The server has no room for all of them at once.
        return self._client.ask_until(method, request, deadline, response)

    def _note(self, was_missing: bool) -> None:
        """Learns from a call whether servers without a map keep turning up."""
        with self._lock:
            # The first time it was lost by a server that was started again.
            if was_missing:
                self._spreads = self._found < _CALLS_TO_TRUST
            self._found = 0 if was_missing else min(self._found + 1, _CALLS_TO_TRUST)
            if self._found == _CALLS_TO_TRUST:
                self._spreads = False

    def _set_aside(self, scenes: Sequence[v1.Scenario],
                   deadline: float) -> Dict[int, List[v1.MapFeature]]:
        """Puts map ids in the place of maps; returns the maps by the index of their scene."""
        aside = {}
        for index, scene in enumerate(scenes):
            # Both at once is for the server to refuse.
            if not scene.map_features or scene.map_id:
                continue
            map_id = self._id_of(scene, deadline)
            if map_id:
                aside[index] = list(scene.map_features)
                del scene.map_features[:]
                scene.map_id = map_id
        return aside

    def _id_of(self, scene: v1.Scenario, deadline: float) -> str:
        """Returns the id of a scene's map; empty if it cannot be registered."""
        request = v1.RegisterMapRequest(map_features=scene.map_features)
        digest = hashlib.sha256(request.SerializeToString(deterministic=True)).digest()
        with self._lock:
            known = self._known.get(digest)
            # By chance: a balancer that takes turns would always pass over the same server.
            spreads = self._spreads and self._random.random() < 0.5
            if known is not None and not spreads:
                self._known.move_to_end(digest)
                return known
        try:
            for _ in range(2 if spreads and known is None else 1):
                map_id = self._client.ask_until("RegisterMap", request, deadline,
                                                v1.RegisterMapResponse).map_id
        except ManeuverError as error:
            if _cannot_be_held(error):
                return ""
            raise
        with self._lock:
            self._known[digest] = map_id
            while len(self._known) > self._max_maps:
                self._known.popitem(last=False)
        return map_id
