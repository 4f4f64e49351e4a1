"""Answers with a model of preset lanes or lanes-metres: inputs by NumPy, networks by PyTorch."""

import hashlib
import sys

import numpy as np
import torch

import answers
from contract import prediction
from lane_paths import LaneGraph, Paths, describe_paths, signals_of
from vector_inputs import ActionGeometry, Agents, Histories, Target
from vector_networks import VectorNetworks

TOLERANCE = 0.125  # seconds, of a target's state


class VectorService:
    """Evaluates all targets of a request as one batch. Registered maps are indexed once.

    remember: what is kept from call to call, although no server could rely on seeing a scene again:
    "nothing"; "paths", which depend on place and speed alone: only leaders, signals and stop signs
    are looked for again; "inputs": everything that the networks read"""

    def __init__(self, folder, remember):
        self.networks = VectorNetworks(folder)
        spec = self.networks.spec
        if spec.get("inputs_version", 1) != 3:
            sys.exit("this server reads scenes by version 3 of the inputs, the model by another one")
        self.reference = spec.get("reference", "TRAJECTORY_REFERENCE_NONE")
        self.interval = self.networks.interval
        self.times = [self.interval * (t + 1) for t in range(self.networks.waypoints)]
        self.geometry = ActionGeometry(self.networks.generic, self.interval)
        self.remember = remember
        self.maps, self.paths, self.inputs = {}, {}, {}

    def register_map(self, request, _):
        """RegisterMap, with an id of our own."""
        identity = hashlib.sha256(request.SerializeToString()).hexdigest()
        if identity not in self.maps:
            self.maps[identity] = LaneGraph(request.map_features)
        return prediction.RegisterMapResponse(map_id=identity)

    def predict(self, request, _):
        """Predict."""
        response = prediction.PredictResponse(model_version="models/peer/versions/1")
        response.waypoint_times.extend(self.times)
        with torch.inference_mode():
            inputs, poses, reference, speeds = self._batch(request.scenarios)
            probabilities, scenes = self.networks.encode(*inputs)
            self._answer(request, response, probabilities, scenes, poses, reference, speeds)
        return response

    def _batch(self, scenarios):
        """The networks' inputs of all targets, their poses, references and speeds."""
        if self.remember == "inputs":
            key = tuple((scene.scenario_id, *scene.target_ids) for scene in scenarios)
            if key not in self.inputs:
                self.inputs[key] = self._read(scenarios)
            return self.inputs[key]
        return self._read(scenarios)

    def _read(self, scenarios):
        by_scene = [self._targets(scene) for scene in scenarios]
        targets = [target for of_scene in by_scene for target in of_scene]
        histories = Histories(targets)
        ids = np.array([target.id for target in targets])
        poses = np.array([target.pose for target in targets])
        paths, counts, agents, masks, begin = [], [], [], [], 0
        for scene, of_scene in zip(scenarios, by_scene):
            part = slice(begin, begin + len(of_scene))
            lengths = [target.length for target in of_scene]
            self._look(
                scene, ids[part], poses[part], histories.speed[part], lengths, paths, counts, agents, masks
            )
            begin = part.stop
        paths, agents = np.concatenate(paths), np.concatenate(agents)
        counts = np.concatenate(counts)
        reference = histories.roll_out(self.reference, self.networks.waypoints, self.interval)
        pairs, actions = self.geometry.describe(reference, paths, counts, histories.speed)
        there = np.arange(paths.shape[1]) < counts[:, None]
        inputs = (histories.history, paths, there, agents, np.concatenate(masks), pairs, actions)
        return (
            [torch.from_numpy(array) for array in inputs],
            poses,
            torch.from_numpy(reference),
            torch.from_numpy(histories.speed),
        )

    @staticmethod
    def _targets(scene):
        agents = {agent.id: agent for agent in scene.agents}
        now = scene.prediction_time
        return [Target(agents[identity], now, TOLERANCE) for identity in scene.target_ids]

    def _look(self, scene, ids, poses, speeds, lengths, paths, counts, agents, masks):
        time = scene.prediction_time
        others = Agents(scene, time)
        graph, of_place = self._paths(scene, ids, poses, speeds)
        signals = signals_of(scene, time)
        paths.append(
            describe_paths(of_place, graph, others, signals, ids, np.array(lengths), speeds)
        )
        counts.append(np.array(of_place.counts))
        numbers, mask = others.describe(ids, poses, speeds)
        agents.append(numbers)
        masks.append(mask)

    def _paths(self, scene, ids, poses, speeds):
        key = (scene.scenario_id, scene.map_id, *ids)
        known = self.paths.get(key) if self.remember == "paths" else None
        if known is None:
            graph = self.maps[scene.map_id] if scene.map_id else LaneGraph(scene.map_features)
            known = graph, Paths(graph, poses, speeds)
            if self.remember == "paths":
                self.paths[key] = known
        return known

    def _answer(self, request, response, probabilities, scenes, poses, reference, speeds):
        numbers = probabilities.numpy()
        target, action = [], []
        for i, row in enumerate(numbers):
            chosen = answers.chosen(request.query, row)
            target += [i] * len(chosen)
            action += chosen
        first = np.searchsorted(target, np.arange(len(numbers) + 1)).tolist()
        if target:
            described = self.networks.describe(
                scenes, torch.tensor(target), torch.tensor(action), reference, speeds
            )
            mean, stddev, sigma, moment, covariance = (part.numpy() for part in described)
            pose = poses[target]
            sigma = in_world(sigma, pose[:, :, None, None])
            moment = in_world(moment, pose[:, :, None])
            covariance = turned(covariance, pose[:, :, None])
        i = 0
        for index, scene in enumerate(request.scenarios):
            answer = response.predictions.add(scenario_index=index, scenario_id=scene.scenario_id)
            for identity in scene.target_ids:
                out = answer.targets.add(target_id=identity)
                out.probabilities.extend(numbers[i].tolist())
                for j in range(first[i], first[i + 1]):
                    answers.write(
                        out, request.query, action[j], numbers[i, action[j]],
                        (mean[j], stddev[j]), sigma[j], moment[j], covariance[j],
                    )  # fmt: skip
                i += 1


def in_world(points, pose):
    """Points [B, .., T, 2] in the target's frame to [B, .., 2, T] in the world's."""
    x, y = points[..., 0], points[..., 1]
    own_x, own_y, cosine, sine = (pose[:, i] for i in range(4))
    return np.stack((own_x + cosine * x - sine * y, own_y + sine * x + cosine * y), -2)


def turned(covariance, pose):
    """Covariances [B, T, 3] xx, xy, yy in the target's frame to [B, 3, T] in the world's."""
    xx, xy, yy = covariance[..., 0], covariance[..., 1], covariance[..., 2]
    c, s = pose[:, 2], pose[:, 3]
    return np.stack(
        (
            c * c * xx - 2 * c * s * xy + s * s * yy,
            c * s * (xx - yy) + (c * c - s * s) * xy,
            s * s * xx + 2 * c * s * xy + c * c * yy,
        ),
        1,
    )
