"""Answers as arrays, with and without numpy. No server."""

import subprocess
import sys
import unittest

import numpy

import maneuver
from maneuver import v1
from maneuver.answers import predictions_of

# Of an answer with two actions (A), three waypoints (T) and one latent dimension (D).
PROGRAM = """
import sys
sys.modules["numpy"] = None  # as where it is not installed
from maneuver.answers import predictions_of
from maneuver.arrays import columns
from maneuver import v1
answer = predictions_of(v1.PredictResponse.FromString(bytes.fromhex(sys.argv[1]))).target()
print(answer.mean_trajectories, answer.waypoint_covariances[1][2])
for points in ([(1, 2.5)], [], [(1, 2, 3)], [1, 2], [("a", 1)]):
    try:
        print(columns(points, ("x", "y"), "points"))
    except ValueError as error:
        print("refused:", str(error)[:34])
"""


def trajectory(offset):
    return v1.Trajectory(x=[offset, offset + 1, offset + 2], y=[-offset] * 3)


def response():
    actions = [v1.ActionDistribution(
        action_id=action, probability=0.5, latent_mean=[float(action)], latent_stddev=[1.0],
        mean_trajectory=trajectory(10.0 * action),
        sigma_trajectories=[trajectory(10.0 * action + i) for i in range(3)],
        moments=v1.WaypointMoments(mean_x=[1, 2, 3], mean_y=[4, 5, 6], covariance_xx=[1, 2, 3],
                                   covariance_xy=[0.1, 0.2, 0.3], covariance_yy=[7, 8, 9]))
        for action in (1, 0)]
    target = v1.TargetPrediction(target_id=7, probabilities=[0.5, 0.5], distributions=actions,
                                 representatives=[v1.Representative(action_id=1, weight=1.0)])
    joint = v1.JointPrediction(target_ids=[7], combinations=[
        v1.JointCombination(action_ids=[1], log_probability=-0.7, weight=1.0)])
    return v1.PredictResponse(model_version="models/m/versions/1", waypoint_times=[0.5, 1.0, 1.5],
                              predictions=[v1.ScenarioPrediction(targets=[target], joint=joint)])


class AnswersTest(unittest.TestCase):

    def test_arrays_have_the_shapes_that_are_stated(self):
        answer = predictions_of(response())
        target = answer.target()
        self.assertEqual(answer.waypoint_times.tolist(), [0.5, 1.0, 1.5])
        self.assertEqual(target.action_ids, [1, 0])
        self.assertEqual(target.mean_trajectories.shape, (2, 3, 2))
        self.assertEqual(target.mean_trajectories[0].tolist(), [[10, -10], [11, -10], [12, -10]])
        self.assertEqual(target.sigma_trajectories.shape, (2, 3, 3, 2))
        self.assertEqual(target.sigma_trajectories[0, 2, 0].tolist(), [12, -12])
        self.assertEqual(target.waypoint_means[1, 2].tolist(), [3, 6])
        self.assertEqual(target.waypoint_covariances.shape, (2, 3, 2, 2))
        self.assertEqual(target.waypoint_covariances[1, 2].tolist(), [[3, 0.3], [0.3, 9]])
        self.assertEqual(target.latent_means.tolist(), [[1], [0]])
        self.assertEqual(target.representatives[0].action_id, 1)
        joint = answer.predictions[0].joint
        self.assertEqual(joint, maneuver.JointPrediction(
            [7], [maneuver.JointCombination([1], -0.7, 1.0)], False))

    def test_what_was_not_asked_for_is_empty(self):
        message = response()
        del message.predictions[0].targets[0].distributions[:]
        message.predictions[0].ClearField("joint")
        self.assertIsNone(predictions_of(message).predictions[0].joint)
        target = predictions_of(message).target()
        self.assertEqual(target.mean_trajectories.shape, (0, 3, 2))
        self.assertEqual(target.waypoint_covariances.shape, (0, 3, 2, 2))
        message = response()
        for action in message.predictions[0].targets[0].distributions:
            del action.sigma_trajectories[:]
        self.assertEqual(predictions_of(message).target().sigma_trajectories.shape, (2, 0, 3, 2))

    def test_target_raises_the_error_of_the_scene_or_target(self):
        for path in ("predictions[0]", "predictions[0].targets[0]"):
            message = response()
            item = eval(f"message.{path}", {"message": message})
            item.error.code, item.error.message = 3, "wrong"
            with self.assertRaisesRegex(Exception, "INVALID_ARGUMENT: wrong"):
                predictions_of(message).target()
            with self.assertRaisesRegex(Exception, "INVALID_ARGUMENT: wrong"):
                predictions_of(message).raise_errors()

    def test_target_is_of_answers_with_one_target(self):
        message = response()
        message.predictions.add().CopyFrom(message.predictions[0])
        with self.assertRaisesRegex(ValueError, "2 targets"):
            predictions_of(message).target()

    def test_without_numpy_the_same_numbers_are_lists(self):
        printed = subprocess.run(
            [sys.executable, "-c", PROGRAM, response().SerializeToString().hex()], check=True,
            stdout=subprocess.PIPE, text=True).stdout
        with_numpy = predictions_of(response()).target()
        refused = "refused: points: expected rows of 2 numbers"
        self.assertEqual(printed.splitlines(), [
            f"{with_numpy.mean_trajectories.tolist()} "
            f"{with_numpy.waypoint_covariances[1, 2].tolist()}",
            "[[1.0], [2.5]]", "[[], []]", refused, refused, refused])
        self.assertIsInstance(with_numpy.mean_trajectories, numpy.ndarray)


if __name__ == "__main__":
    unittest.main()
