"""Client of Maneuver, a prediction server for driving.

    import maneuver

    client = maneuver.Client("127.0.0.1:8470")
    scene = maneuver.load_scenario("scene.json")
    answer = client.predict(scene, model="models/town").target()
    print(answer.probabilities)  # p(y|s) of each action, [K]
    print(answer.mean_trajectories)  # of the likely ones, [A, T, 2] metres, world frame

Client has all calls, MapReuse sends maps once, PredictStream is for a planner's loop. maneuver.v1
has the contract's messages. Everything else that is meant for callers is named here.
"""

from maneuver import v1
from maneuver.answers import (ActionSet, Classifications, DoubtfulSceneWarning, JointCombination,
                              JointPrediction, Predictions, Representative, ScenarioClassification,
                              ScenarioPrediction, SceneWarning, TargetClassification,
                              TargetPrediction)
from maneuver.client import Client
from maneuver.connection import Deadlines
from maneuver.credentials import Tls
from maneuver.errors import (AbortedError, AlreadyExistsError, CancelledError, DataLossError,
                             DeadlineExceededError, FailedPreconditionError, FieldViolation,
                             InternalError, InvalidArgumentError, ManeuverError, NotFoundError,
                             PermissionDeniedError, ResourceExhaustedError, UnauthenticatedError,
                             UnavailableError, UnimplementedError)
from maneuver.jobs import has_ended
from maneuver.map_reuse import MapReuse
from maneuver.retry import Clock, RetryPolicy
from maneuver.scenes import Agent, MapFeature, Scenario, TrafficSignal, load_scenario
from maneuver.stream import PredictStream, StreamAnswer
from maneuver.uploads import UploadProgress

__all__ = [
    "AbortedError", "ActionSet", "Agent", "AlreadyExistsError", "CancelledError", "Classifications",
    "Client", "Clock", "DataLossError", "DeadlineExceededError", "Deadlines",
    "DoubtfulSceneWarning", "FailedPreconditionError", "FieldViolation", "InternalError",
    "InvalidArgumentError", "JointCombination", "JointPrediction", "ManeuverError", "MapFeature", "MapReuse", "NotFoundError",
    "PermissionDeniedError", "PredictStream", "Predictions", "Representative",
    "ResourceExhaustedError", "RetryPolicy", "Scenario", "ScenarioClassification",
    "ScenarioPrediction", "SceneWarning", "StreamAnswer", "TargetClassification",
    "TargetPrediction", "Tls", "TrafficSignal", "UnauthenticatedError", "UnavailableError",
    "UnimplementedError", "UploadProgress", "has_ended", "load_scenario", "v1",
]
