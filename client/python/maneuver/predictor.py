"""The questions about scenes, as Client and MapReuse both ask them."""

from __future__ import annotations

import abc
from typing import Optional, Sequence, TypeVar, Union

from maneuver import v1
from maneuver.answers import Classifications, Predictions, classifications_of, predictions_of
from maneuver.scenes import Scenes, to_protos

# A request about scenes.
PredictionRequest = Union[v1.PredictRequest, v1.PredictActionProbabilitiesRequest,
                          v1.PredictActionDistributionsRequest, v1.ClassifyTrajectoriesRequest]
_Response = TypeVar("_Response")

_SOURCES = {"posterior": v1.LATENT_SOURCE_POSTERIOR, "prior": v1.LATENT_SOURCE_PRIOR}
_FRAMES = {"world": v1.FRAME_WORLD, "target": v1.FRAME_TARGET}
_PRIORITIES = {"interactive": v1.PRIORITY_INTERACTIVE, "bulk": v1.PRIORITY_BULK}


def query(*, action_ids: Optional[Sequence[int]] = None, min_probability: Optional[float] = None,
          top_k: Optional[int] = None, source: str = "posterior", frame: str = "world",
          sigma_trajectories: bool = True, representatives: int = 0,
          joint: int = 0) -> v1.DistributionQuery:
    """Returns the message of what Predictor.predict takes by these names."""
    if sum(one is not None for one in (action_ids, min_probability, top_k)) > 1:
        raise ValueError("action_ids, min_probability and top_k exclude one another")
    message = v1.DistributionQuery(source=_named(_SOURCES, source, "source"),
                                   frame=_named(_FRAMES, frame, "frame"),
                                   omit_sigma_trajectories=not sigma_trajectories,
                                   representatives=representatives, joint_combinations=joint)
    if action_ids is not None:
        message.action_ids.ids.extend(action_ids)
        message.action_ids.SetInParent()
    elif min_probability is not None:
        message.min_probability = min_probability
    elif top_k is not None:
        message.top_k = top_k
    return message


class Predictor(abc.ABC):
    """Asks a server about scenes.

    All methods take one scene or a sequence of them (maneuver.scenes.Scene), and:

    model: models/{model}, models/{model}@{alias} or models/{model}/versions/{version}; empty where
        the server serves exactly one model.
    priority: "interactive", or "bulk" for logs and evaluations, which goes after the others.
    include_action_names: whether to answer `action_names` too.
    required_action_names: names that the caller counts on. A version in which no action bears one
        of them refuses the call: FailedPreconditionError, reason ACTION_NAME_GONE, with
        `missing_action_names`.
    strict: refuses a scene that has warnings: its error is then an InvalidArgumentError with the
        warnings as `violations`.
    timeout: seconds for the call with all its attempts, in place of Deadlines.prediction.

    They raise ManeuverError if the call fails, and ValueError if an argument is not a scene. A scene
    or a target of a batch fails alone: look at its `error`, or call target() or raise_errors() of
    the answer, which raise it. A scene that looks wrong has `warnings`, which are also shown as
    Python's DoubtfulSceneWarning. The server ignores states after the prediction time, but for
    classify_trajectories.
    """

    def predict(self, scenes: Scenes, *, model: str = "",
                action_ids: Optional[Sequence[int]] = None,
                min_probability: Optional[float] = None, top_k: Optional[int] = None,
                source: str = "posterior", frame: str = "world", sigma_trajectories: bool = True,
                representatives: int = 0, joint: int = 0, priority: str = "interactive",
                include_action_names: bool = False, required_action_names: Sequence[str] = (),
                strict: bool = False, timeout: Optional[float] = None) -> Predictions:
        """Returns how probable each action is, and what chosen actions would look like.

        action_ids, min_probability, top_k: which actions to describe; one of them at most. None of
            them: those with a probability of at least 0.05.
        source: "posterior", the action as it would be executed in this scene, or "prior", the
            generic action.
        frame: of the trajectories: "world", or "target": origin at the target's centre at the
            prediction time, +x along its heading, +y to its left.
        sigma_trajectories: whether to send the 2D+1 sigma trajectories of each action.
        representatives: how many actions that together cover the answer to name, 0 .. K.
        joint: how many combinations of the targets' actions to find for each scene, 0 .. 64; a
            scene may then name at most 8 targets. See ScenarioPrediction.joint.
        """
        request = v1.PredictRequest(
            model=model, scenarios=to_protos(scenes),
            query=query(action_ids=action_ids, min_probability=min_probability, top_k=top_k,
                        source=source, frame=frame, sigma_trajectories=sigma_trajectories,
                        representatives=representatives, joint=joint),
            priority=_named(_PRIORITIES, priority, "priority"),
            include_action_names=include_action_names,
            required_action_names=required_action_names, strict=strict)
        return predictions_of(self._ask("Predict", request, timeout, v1.PredictResponse))

    def predict_action_probabilities(self, scenes: Scenes, *, model: str = "",
                                     priority: str = "interactive",
                                     include_action_names: bool = False,
                                     required_action_names: Sequence[str] = (),
                                     strict: bool = False,
                                     timeout: Optional[float] = None) -> Predictions:
        """Returns p(y|s): how probable each action is. Trajectories are empty."""
        request = v1.PredictActionProbabilitiesRequest(
            model=model, scenarios=to_protos(scenes),
            priority=_named(_PRIORITIES, priority, "priority"),
            include_action_names=include_action_names,
            required_action_names=required_action_names, strict=strict)
        return predictions_of(self._ask("PredictActionProbabilities", request, timeout,
                                        v1.PredictActionProbabilitiesResponse))

    def predict_action_distributions(self, scenes: Scenes, *, model: str = "",
                                     action_ids: Optional[Sequence[int]] = None,
                                     min_probability: Optional[float] = None,
                                     top_k: Optional[int] = None, source: str = "posterior",
                                     frame: str = "world", sigma_trajectories: bool = True,
                                     representatives: int = 0, joint: int = 0,
                                     priority: str = "interactive",
                                     include_action_names: bool = False,
                                     required_action_names: Sequence[str] = (),
                                     strict: bool = False,
                                     timeout: Optional[float] = None) -> Predictions:
        """Returns what chosen actions would look like; see predict. `probabilities` are empty."""
        request = v1.PredictActionDistributionsRequest(
            model=model, scenarios=to_protos(scenes),
            query=query(action_ids=action_ids, min_probability=min_probability, top_k=top_k,
                        source=source, frame=frame, sigma_trajectories=sigma_trajectories,
                        representatives=representatives, joint=joint),
            priority=_named(_PRIORITIES, priority, "priority"),
            include_action_names=include_action_names,
            required_action_names=required_action_names, strict=strict)
        return predictions_of(self._ask("PredictActionDistributions", request, timeout,
                                        v1.PredictActionDistributionsResponse))

    def classify_trajectories(self, scenes: Scenes, *, model: str = "",
                              priority: str = "interactive", include_action_names: bool = False,
                              required_action_names: Sequence[str] = (),
                              strict: bool = False,
                              timeout: Optional[float] = None) -> Classifications:
        """Returns q(y|x,s): which action was the trajectory that each target really took.

        The targets need states after the prediction time, as far as the model's horizon.
        """
        request = v1.ClassifyTrajectoriesRequest(
            model=model, scenarios=to_protos(scenes),
            priority=_named(_PRIORITIES, priority, "priority"),
            include_action_names=include_action_names,
            required_action_names=required_action_names, strict=strict)
        return classifications_of(self._ask("ClassifyTrajectories", request, timeout,
                                            v1.ClassifyTrajectoriesResponse))

    @abc.abstractmethod
    def _ask(self, method: str, request: PredictionRequest, timeout: Optional[float],
             response: "type[_Response]") -> _Response:
        """Calls a method of PredictionService, which answers with `response`.

        request: the callee may change it; it holds copies of the caller's scenes.
        """


def _named(values: "dict[str, _Response]", name: str, what: str) -> _Response:
    if name not in values:
        raise ValueError(f"{what}: {name!r} is none of {', '.join(values)}")
    return values[name]
