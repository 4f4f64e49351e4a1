"""Answers, as numpy arrays (without numpy: nested lists of the same shapes).

K: actions of the model. A: actions that were asked for. T: waypoints. D: latent dimensions.
"""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any, Iterable, List, NamedTuple, Optional, Sequence, Union

from maneuver import v1
from maneuver.arrays import FloatArray, array
from maneuver.errors import ManeuverError, from_status


class SceneWarning(NamedTuple):
    """A value that was accepted and nevertheless looks wrong, such as degrees for radians."""

    field: str  # path from the request: scenarios[2].agents[0].states[5].heading
    description: str  # what looks wrong, and what the field expects

    def __str__(self) -> str:
        return f"{self.field}: {self.description}"


class DoubtfulSceneWarning(UserWarning):
    """A scene has warnings. Shown once a line of code, as Python's `warnings` are by default."""


@dataclasses.dataclass(frozen=True)
class Representative:
    """An action that stands for itself and for actions that look like it."""

    action_id: int
    weight: float  # probability of the actions that it stands for; the weights of a target sum to 1


@dataclasses.dataclass(frozen=True, eq=False)
class TargetPrediction:
    """The answer for one target. Trajectories are in the frame that was asked for, metres.

    Actions are the most probable first. What was not asked for is empty.
    """

    target_id: int
    error: Optional[ManeuverError]  # why there is no answer; all else is then empty
    probabilities: FloatArray  # [K] p(y|s) of action 0 .. K-1; sums to 1
    action_ids: List[int]  # [A] what the following arrays are of
    action_probabilities: FloatArray  # [A] p(y|s)
    mean_trajectories: FloatArray  # [A, T, 2] decoded latent means
    sigma_trajectories: FloatArray  # [A, 2D+1, T, 2] decoded sigma points, the mean first
    waypoint_means: FloatArray  # [A, T, 2] of each waypoint's position
    waypoint_covariances: FloatArray  # [A, T, 2, 2] of each waypoint's position, square metres
    latent_means: FloatArray  # [A, D]
    latent_stddevs: FloatArray  # [A, D]
    representatives: List[Representative]


@dataclasses.dataclass(frozen=True)
class JointCombination:
    """One action for each target. Their expected trajectories are free of collisions."""

    action_ids: List[int]  # in the order of JointPrediction.target_ids
    log_probability: float  # sum of ln p(y|s) over its actions, nats
    weight: float  # its share of the probability of all that are named; the weights sum to 1


@dataclasses.dataclass(frozen=True)
class JointPrediction:
    """What the targets of a scene do together."""

    target_ids: List[int]  # those that have an answer
    # The most probable first. Fewer than asked for: no others are free of collisions, unless
    # `truncated`.
    combinations: List[JointCombination]
    truncated: bool  # the server's search ended at its bound: others may follow


@dataclasses.dataclass(frozen=True, eq=False)
class ScenarioPrediction:
    """The answer for one scene of a batch."""

    scenario_index: int  # in the request
    scenario_id: str
    error: Optional[ManeuverError]  # why the whole scene was refused; `targets` is then empty
    targets: List[TargetPrediction]  # in the order of the scene's target_ids
    warnings: List[SceneWarning]  # what looks wrong in the scene
    joint: Optional[JointPrediction] = None  # None: not asked for, or no target has an answer


@dataclasses.dataclass(frozen=True, eq=False)
class Predictions:
    """The answers to one call, in the order of its scenes. Each may have failed alone."""

    model_version: str  # that answered: models/{model}/versions/{version}
    waypoint_times: FloatArray  # [T] seconds after the prediction time; empty for probabilities
    predictions: List[ScenarioPrediction]
    action_names: List[str]  # [K] of action 0 .. K-1; empty unless asked for

    def target(self) -> TargetPrediction:
        """Returns the answer for the only target of the only scene; raises its error."""
        target: TargetPrediction = _only(self.predictions)
        return target

    def raise_errors(self) -> "Predictions":
        """Returns itself; raises the first error of a scene or target, if there is one."""
        _raise_first(self.predictions)
        return self


@dataclasses.dataclass(frozen=True, eq=False)
class TargetClassification:
    """Which action the trajectory of one target was."""

    target_id: int
    error: Optional[ManeuverError]  # why there is no answer; all else is then empty
    responsibilities: FloatArray  # [K] q(y|x,s) of action 0 .. K-1; sums to 1
    probabilities: FloatArray  # [K] p(y|s) of action 0 .. K-1; sums to 1
    log_likelihood_bound: float  # on ln p(x|s), nats


@dataclasses.dataclass(frozen=True, eq=False)
class ScenarioClassification:
    """The answer for one scene of a batch."""

    scenario_index: int  # in the request
    scenario_id: str
    error: Optional[ManeuverError]  # why the whole scene was refused; `targets` is then empty
    targets: List[TargetClassification]  # in the order of the scene's target_ids
    warnings: List[SceneWarning]  # what looks wrong in the scene


@dataclasses.dataclass(frozen=True, eq=False)
class Classifications:
    """The answers to one call, in the order of its scenes. Each may have failed alone."""

    model_version: str  # that answered: models/{model}/versions/{version}
    classifications: List[ScenarioClassification]
    action_names: List[str]  # [K] of action 0 .. K-1; empty unless asked for

    def target(self) -> TargetClassification:
        """Returns the answer for the only target of the only scene; raises its error."""
        target: TargetClassification = _only(self.classifications)
        return target

    def raise_errors(self) -> "Classifications":
        """Returns itself; raises the first error of a scene or target, if there is one."""
        _raise_first(self.classifications)
        return self


@dataclasses.dataclass(frozen=True, eq=False)
class ActionSet:
    """The actions of a version, whatever the scene. Target frame, metres."""

    model_version: str
    actions: List[v1.Action]  # [K] with names, labels, usage and the whole distribution
    action_names: List[str]  # [K] what to show to people: Action.display_name
    waypoint_times: FloatArray  # [T] seconds after the prediction time
    mean_trajectories: FloatArray  # [K, T, 2]
    # Speed at which the actions are drawn, m/s; None: they are the same at every speed.
    speed: Optional[float]


_Answers = Union[v1.PredictResponse, v1.PredictActionProbabilitiesResponse,
                 v1.PredictActionDistributionsResponse]


def predictions_of(response: _Answers) -> Predictions:
    """Returns a response as arrays."""
    if isinstance(response, v1.PredictActionProbabilitiesResponse):
        times: Sequence[float] = ()
    else:
        times = response.waypoint_times
    _show_warnings(response.predictions)
    return Predictions(
        response.model_version, array(times),
        [ScenarioPrediction(prediction.scenario_index, prediction.scenario_id,
                            _error_of(prediction),
                            [_target_of(target, len(times)) for target in prediction.targets],
                            _warnings_of(prediction), _joint_of(prediction))
         for prediction in response.predictions],
        list(response.action_names))


def classifications_of(response: v1.ClassifyTrajectoriesResponse) -> Classifications:
    """Returns a response as arrays."""
    _show_warnings(response.classifications)
    return Classifications(
        response.model_version,
        [ScenarioClassification(
            scene.scenario_index, scene.scenario_id, _error_of(scene),
            [TargetClassification(target.target_id, _error_of(target),
                                  array(target.responsibilities), array(target.probabilities),
                                  target.log_likelihood_bound) for target in scene.targets],
            _warnings_of(scene))
         for scene in response.classifications],
        list(response.action_names))


def action_set_of(response: v1.ActionSet) -> ActionSet:
    """Returns a response as arrays."""
    times = response.waypoint_times
    return ActionSet(
        response.model_version, list(response.actions),
        [action.display_name for action in response.actions], array(times),
        array([_points(action.distribution.mean_trajectory) for action in response.actions],
              0, len(times), 2),
        response.speed if response.HasField("speed") else None)


def _error_of(item: Union[v1.ScenarioPrediction, v1.TargetPrediction, v1.ScenarioClassification,
                          v1.TargetClassification]) -> Optional[ManeuverError]:
    return from_status(item.error) if item.HasField("error") else None


def _warnings_of(scene: Union[v1.ScenarioPrediction, v1.ScenarioClassification]
                 ) -> List[SceneWarning]:
    return [SceneWarning(one.field, one.description) for one in scene.warnings]


def _joint_of(scene: v1.ScenarioPrediction) -> Optional[JointPrediction]:
    if not scene.HasField("joint"):
        return None
    return JointPrediction(
        list(scene.joint.target_ids),
        [JointCombination(list(one.action_ids), one.log_probability, one.weight)
         for one in scene.joint.combinations],
        scene.joint.truncated)


def _show_warnings(scenes: Iterable[Union[v1.ScenarioPrediction, v1.ScenarioClassification]]
                   ) -> None:
    for scene in scenes:
        for one in scene.warnings:
            # Names the line that called predict: this is its callee's callee.
            warnings.warn(f"{scene.scenario_id}: {one.field}: {one.description}",
                          DoubtfulSceneWarning, stacklevel=4)


def _points(trajectory: v1.Trajectory) -> List[List[float]]:
    return [list(point) for point in zip(trajectory.x, trajectory.y)]


def _target_of(target: v1.TargetPrediction, waypoints: int) -> TargetPrediction:
    actions = target.distributions
    moments = [action.moments for action in actions]
    return TargetPrediction(
        target.target_id, _error_of(target), array(target.probabilities),
        [action.action_id for action in actions],
        array([action.probability for action in actions]),
        array([_points(action.mean_trajectory) for action in actions], 0, waypoints, 2),
        array([[_points(sigma) for sigma in action.sigma_trajectories] for action in actions],
              len(actions), 0, waypoints, 2),
        array([[list(point) for point in zip(moment.mean_x, moment.mean_y)]
               for moment in moments], 0, waypoints, 2),
        array([[[[xx, xy], [xy, yy]] for xx, xy, yy in
                zip(moment.covariance_xx, moment.covariance_xy, moment.covariance_yy)]
               for moment in moments], 0, waypoints, 2, 2),
        array([list(action.latent_mean) for action in actions], 0, 0),
        array([list(action.latent_stddev) for action in actions], 0, 0),
        [Representative(one.action_id, one.weight) for one in target.representatives])


def _raise_first(scenes: Sequence[Union[ScenarioPrediction, ScenarioClassification]]) -> None:
    for scene in scenes:
        for item in (scene, *scene.targets):
            if item.error is not None:
                raise item.error


def _only(scenes: Sequence[Union[ScenarioPrediction, ScenarioClassification]]) -> Any:
    _raise_first(scenes)
    targets = [target for scene in scenes for target in scene.targets]
    if len(targets) != 1:
        raise ValueError(f"the call asked for {len(targets)} targets; see the list of scenes")
    return targets[0]
