"""Scenes to ask about.

A scene is a Scenario of this module, a v1.Scenario, or a dict as the contract's JSON has it
(proto/maneuver/v1/scenario.proto). Units are metres, seconds and radians. The world frame is flat
and right-handed; angles are counter-clockwise from +x.

    scene = maneuver.Scenario(
        prediction_time=1.0,
        target_ids=[7],
        agents=[maneuver.Agent(id=7, length=4.5, width=1.9, states=[
            # time, x, y, heading, velocity_x, velocity_y
            (0.0, 100.0, 50.0, 0.5, 8.0, 4.0),
            (1.0, 108.0, 54.0, 0.5, 8.0, 4.0)])])
"""

from __future__ import annotations

import dataclasses
import json
import os
import pathlib
from typing import Any, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

from google.protobuf import json_format

from maneuver import v1
from maneuver.arrays import Rows, columns

STATE_COLUMNS = ("time", "x", "y", "heading", "velocity_x", "velocity_y")


@dataclasses.dataclass
class Agent:
    """A road user and its states over time."""

    id: int  # unique within the scene
    # [N, 6], in increasing time: time s, x m, y m, heading rad, velocity_x m/s, velocity_y m/s
    states: Rows
    length: float  # of the bounding box, along the heading, metres
    width: float  # of the bounding box, metres
    type: str = "vehicle"  # vehicle, pedestrian, cyclist, other or unspecified


@dataclasses.dataclass
class MapFeature:
    """A line or an area of the map."""

    # lane_centerline, bike_lane, road_line, road_edge, crosswalk, stop_line, speed_bump, driveway
    # or stop_sign
    type: str
    points: Rows  # [P, 2]: x, y in metres; the points of an area go around it once
    id: int = 0  # of a lane; 0: none
    speed_limit: float = 0.0  # of a lane, m/s; 0: not known
    successor_ids: Sequence[int] = ()  # lanes that a vehicle can enter at the end of this one
    left_neighbor_ids: Sequence[int] = ()  # lanes of the same direction on the left
    right_neighbor_ids: Sequence[int] = ()  # lanes of the same direction on the right


@dataclasses.dataclass
class TrafficSignal:
    """What one signal showed to one lane."""

    lane_id: int  # MapFeature.id
    # (time s, light) in increasing time; lights: stop, caution, go, unspecified
    readings: Sequence[Tuple[float, str]]


@dataclasses.dataclass
class Scenario:
    """A scene of one place and a few seconds, world frame."""

    agents: Sequence[Agent]  # everyone on the road, targets included
    target_ids: Sequence[int]  # agents to answer for; each has a state at the prediction time
    prediction_time: float  # "now", on the clock of the states, seconds
    map_features: Sequence[Union[MapFeature, v1.MapFeature]] = ()
    traffic_signals: Sequence[TrafficSignal] = ()
    scenario_id: str = ""  # echoed in answers
    map_id: str = ""  # a map that the server holds (Client.register_map), in place of map_features

    @staticmethod
    def from_arrays(*, times: Sequence[float], tracks: Any, sizes: Rows, ids: Sequence[int],
                    target_ids: Sequence[int], types: Optional[Sequence[str]] = None,
                    prediction_time: Optional[float] = None,
                    map_features: Sequence[Union[MapFeature, v1.MapFeature]] = (),
                    traffic_signals: Sequence[TrafficSignal] = (), scenario_id: str = "",
                    map_id: str = "") -> "Scenario":
        """Returns the scene of A agents that were seen at N common times.

        times: [N] seconds, increasing.
        tracks: [A, N, 5]: x, y, heading, velocity_x, velocity_y. A row with a NaN says that the
            agent was not seen at that time.
        sizes: [A, 2]: length, width. ids: [A]. types: [A], vehicles if None.
        prediction_time: the last time if None.

        Raises ValueError if the lengths differ.
        """
        lengths, widths = columns(sizes, ("length", "width"), "sizes")
        types = ["vehicle"] * len(ids) if types is None else types
        if not len(tracks) == len(ids) == len(lengths) == len(types):
            raise ValueError(f"tracks, ids, sizes and types are of {len(tracks)}, {len(ids)}, "
                             f"{len(lengths)} and {len(types)} agents")
        agents = []
        for index, track in enumerate(tracks):
            path = f"tracks[{index}]"
            values = columns(track, STATE_COLUMNS[1:], path)
            if len(values[0]) != len(times):
                raise ValueError(f"{path} has {len(values[0])} rows for {len(times)} times")
            rows = [row for row in zip(map(float, times), *values)
                    if all(value == value for value in row)]
            agents.append(Agent(ids[index], rows, lengths[index], widths[index], types[index]))
        return Scenario(agents, target_ids,
                        float(times[-1]) if prediction_time is None else prediction_time,
                        map_features, traffic_signals, scenario_id, map_id)

    @staticmethod
    def from_proto(message: v1.Scenario) -> "Scenario":
        """Returns the scene of a message, such as a recording of a dataset."""
        return Scenario(
            agents=[Agent(agent.id,
                          [tuple(getattr(state, name) for name in STATE_COLUMNS)
                           for state in agent.states],
                          agent.length, agent.width,
                          _short_name(v1.AgentType.Name(agent.type), "AGENT_TYPE_"))
                    for agent in message.agents],
            target_ids=list(message.target_ids),
            prediction_time=message.prediction_time,
            map_features=[MapFeature(
                _short_name(v1.MapFeatureType.Name(feature.type), "MAP_FEATURE_TYPE_"),
                list(zip(feature.x, feature.y)), feature.id, feature.speed_limit,
                list(feature.successor_ids), list(feature.left_neighbor_ids),
                list(feature.right_neighbor_ids)) for feature in message.map_features],
            traffic_signals=[TrafficSignal(
                signal.lane_id,
                [(reading.time,
                  _short_name(v1.TrafficSignalState.Name(reading.state), "TRAFFIC_SIGNAL_STATE_"))
                 for reading in signal.readings]) for signal in message.traffic_signals],
            scenario_id=message.scenario_id,
            map_id=message.map_id)

    def to_proto(self) -> v1.Scenario:
        """Returns the message. Raises ValueError, with the field's path, if it is not a number."""
        message = v1.Scenario(scenario_id=self.scenario_id, prediction_time=self.prediction_time,
                              target_ids=[int(target) for target in self.target_ids],
                              map_id=self.map_id)
        for index, agent in enumerate(self.agents):
            _add_agent(message, agent, f"agents[{index}]")
        message.map_features.extend(map_to_proto(self.map_features))
        for index, signal in enumerate(self.traffic_signals):
            readings = message.traffic_signals.add(lane_id=signal.lane_id).readings
            for time, light in signal.readings:
                readings.add(time=time, state=_value(v1.TrafficSignalState, light,
                                                     "TRAFFIC_SIGNAL_STATE_",
                                                     f"traffic_signals[{index}].readings"))
        return message


# What a client takes for a scene.
Scene = Union[Scenario, v1.Scenario, Mapping[str, Any]]
# One scene, or a batch of them.
Scenes = Union[Scene, Sequence[Scene]]


def load_scenario(path: Union[str, "os.PathLike[str]"]) -> v1.Scenario:
    """Reads a scene from a JSON file, as `maneuver scenario extract` writes it.

    Skips the byte order mark that some editors begin a file with.

    Raises OSError, and ValueError with what is wrong in the file.
    """
    try:
        return to_proto(json.loads(pathlib.Path(path).read_text(encoding="utf-8-sig")))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def to_proto(scene: Scene) -> v1.Scenario:
    """Returns the message of a scene. Raises ValueError if it is not a scene."""
    if isinstance(scene, v1.Scenario):
        return scene
    if isinstance(scene, Scenario):
        return scene.to_proto()
    if not isinstance(scene, Mapping):
        raise ValueError(f"a scene is a maneuver.Scenario, a v1.Scenario or a dict, and no "
                         f"{type(scene).__name__}")
    try:
        message: v1.Scenario = json_format.ParseDict(scene, v1.Scenario())
    except (json_format.ParseError, TypeError) as error:
        raise ValueError(f"no scene: {error}") from None
    return message


def to_protos(scenes: Scenes) -> List[v1.Scenario]:
    """Returns the messages of one scene or of several."""
    if isinstance(scenes, (Scenario, v1.Scenario, Mapping)):
        return [to_proto(scenes)]
    return [to_proto(scene) for scene in scenes]


def map_to_proto(features: Iterable[Union[MapFeature, v1.MapFeature]]) -> List[v1.MapFeature]:
    """Returns the messages of a map. Raises ValueError, with the field's path."""
    messages = []
    for index, feature in enumerate(features):
        if not isinstance(feature, MapFeature):
            messages.append(feature)
            continue
        path = f"map_features[{index}]"
        x, y = columns(feature.points, ("x", "y"), f"{path}.points")
        messages.append(v1.MapFeature(
            id=feature.id, x=x, y=y, speed_limit=feature.speed_limit,
            type=_value(v1.MapFeatureType, str(feature.type), "MAP_FEATURE_TYPE_", f"{path}.type"),
            successor_ids=feature.successor_ids, left_neighbor_ids=feature.left_neighbor_ids,
            right_neighbor_ids=feature.right_neighbor_ids))
    return messages


def _add_agent(message: v1.Scenario, agent: Agent, path: str) -> None:
    added = message.agents.add(
        id=int(agent.id), length=float(agent.length), width=float(agent.width),
        type=_value(v1.AgentType, agent.type, "AGENT_TYPE_", f"{path}.type"))
    for row in zip(*columns(agent.states, STATE_COLUMNS, f"{path}.states")):
        added.states.add(**dict(zip(STATE_COLUMNS, row)))


def _short_name(name: str, prefix: str) -> str:
    return name[len(prefix):].lower()


def _value(enum: Any, name: str, prefix: str, path: str) -> Any:
    full = prefix + name.upper()
    if full not in enum.keys():
        known = ", ".join(_short_name(key, prefix) for key in enum.keys())
        raise ValueError(f"{path}: {name!r} is none of {known}")
    return enum.Value(full)
