"""The largest difference between the answers of two servers on the same scenes.

  /usr/bin/python3 compare_answers.py OURS THEIRS DATASET_FOLDER [SCENES (40)] [TARGETS (8)]

OURS and THEIRS are addresses. Asks both for p(y|s) and the actions of at least 5 % of up to TARGETS
vehicles of each of the first SCENES recordings, past states only; every other recording a little
after its last states. Ends with status 1 if a number differs by 1e-4 or more; numbers in metres and
correlations by 1e-3. Rounding in f32 grows with the length of a trajectory, and it turns the
direction of a slow mean, which covariances follow.
"""

import pathlib
import struct
import sys

import grpc
import numpy as np

from contract import prediction, scenario

BOUND, BOUND_OF_WAYPOINTS = 1e-4, 1e-3
LATE = 0.07  # seconds


def recordings(folder):
    """The scenarios of a dataset (model/data/tfrecord.h has the framing)."""
    for shard in sorted(pathlib.Path(folder).glob("*.tfrecord")):
        with shard.open("rb") as file:
            while header := file.read(12):
                (size,) = struct.unpack("<Q", header[:8])
                yield scenario.Scenario.FromString(file.read(size))
                file.read(4)


def observed(scene, most):
    """The scene without its future, and with up to `most` targets."""
    now = scene.prediction_time + 1e-6
    vehicles = []
    for agent in scene.agents:
        present = [state for state in agent.states if state.time <= now]
        del agent.states[len(present) :]
        if present and present[-1].time > now - 0.05 and agent.type == scenario.AGENT_TYPE_VEHICLE:
            vehicles.append(agent.id)
    kept = [agent for agent in scene.agents if agent.states]
    del scene.agents[:]
    scene.agents.extend(kept)
    for signal in scene.traffic_signals:
        readings = [reading for reading in signal.readings if reading.time <= now]
        del signal.readings[len(readings) :]
    targets = [identity for identity in scene.target_ids if identity in vehicles]
    targets += [identity for identity in vehicles if identity not in targets]
    del scene.target_ids[:]
    scene.target_ids.extend(targets[:most])
    return scene


def described(answer):
    """The actions that a target's answer describes."""
    return {distribution.action_id for distribution in answer.distributions}


def numbers(answer, actions):
    """What a target's answer says of all actions, and of some actions, by kind."""
    by_action = {distribution.action_id: distribution for distribution in answer.distributions}
    found = {"p(y|s)": [answer.probabilities[:]]}
    for action in actions:
        distribution = by_action[action]
        moments = distribution.moments
        ways = (distribution.mean_trajectory, *distribution.sigma_trajectories)
        xx, yy = np.sqrt(moments.covariance_xx), np.sqrt(moments.covariance_yy)
        for kind, rows in {
            "latent": (distribution.latent_mean[:], distribution.latent_stddev[:]),
            "waypoints, m": [part[:] for way in ways for part in (way.x, way.y)],
            "means, m": (moments.mean_x[:], moments.mean_y[:]),
            "standard deviations, m": (xx, yy),
            "correlations": (np.array(moments.covariance_xy) / (xx * yy),),
        }.items():
            found.setdefault(kind, []).extend(rows)
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


def main():
    ours, theirs, folder, *limits = sys.argv[1:]
    scenes, targets = (int(limit) for limit in (limits + ["40", "8"][len(limits) :]))
    calls = []
    for address in (ours, theirs):
        options = [("grpc.max_receive_message_length", 64 << 20)]
        channel = grpc.insecure_channel(address, options=options)
        calls.append(
            channel.unary_unary(
                "/maneuver.v1.PredictionService/Predict",
                request_serializer=prediction.PredictRequest.SerializeToString,
                response_deserializer=prediction.PredictResponse.FromString,
            )
        )
    largest, targets_compared, actions_compared = {}, 0, 0
    for i, scene in zip(range(scenes), recordings(folder)):
        scene = observed(scene, targets)
        scene.prediction_time += LATE * (i % 2)
        request = prediction.PredictRequest(scenarios=[scene])
        first, second = (call(request, timeout=60) for call in calls)
        for a, b in zip(first.predictions[0].targets, second.predictions[0].targets):
            if a.HasField("error"):
                continue
            # An action whose probability is all but 0.05 may be described by one of them alone.
            actions = described(a) & described(b)
            targets_compared += 1
            actions_compared += len(actions)
            theirs_of = numbers(b, actions)
            for kind, values in numbers(a, actions).items():
                difference = float(np.abs(values - theirs_of[kind]).max())
                if not difference <= largest.get(kind, (-1.0,))[0]:
                    largest[kind] = difference, scene.scenario_id, a.target_id
    print(
        f"{targets_compared} targets of {scenes} scenes, {actions_compared} actions described; "
        "largest difference of"
    )
    agree = targets_compared > 0
    for kind, (difference, identity, target) in largest.items():
        print(f"  {kind}: {difference:.1e} (scene {identity}, target {target})")
        agree &= difference < (BOUND if kind in ("p(y|s)", "latent") else BOUND_OF_WAYPOINTS)
    if not agree:
        sys.exit("the answers differ")


if __name__ == "__main__":
    main()
