"""Answers with a model that reads rasters: drawn by OpenCV, networks by PyTorch.

As its author would reasonably tune it: channels last; a scene's points and boxes projected at once
by NumPy; what the picture cannot show passed over; lines of one kind drawn by one call.

It is here for its speed. OpenCV's boxes and lines are up to a pixel thicker than those that the
weights were learned with, so that its p(y|s) is off by some tenths; with floats of the engine's own
rasters it is the engine's (pytorch.py).
"""

import math

import cv2
import numpy as np
import torch

import answers
from contract import prediction
from contract import scenario as contract
from networks import Networks

REACH = 2  # pixels that a feature's lines reach beyond its points
SHIFT = 3  # bits of a pixel's fraction
LANE, BIKE_LANE, EDGE, LINE, STOP_SIGN, STOP_LINE = 255, 48, 255, 160, 255, 224
AREAS = {
    contract.MAP_FEATURE_TYPE_CROSSWALK: 128,
    contract.MAP_FEATURE_TYPE_SPEED_BUMP: 192,
    contract.MAP_FEATURE_TYPE_DRIVEWAY: 64,
}
BOXES = {
    contract.AGENT_TYPE_VEHICLE: 255,
    contract.AGENT_TYPE_CYCLIST: 192,
    contract.AGENT_TYPE_PEDESTRIAN: 128,
}


def state_at(agent, time, tolerance, latest):
    best = None
    for state in agent.states:
        if state.time > latest + 1e-6:
            break
        if best is None or abs(state.time - time) <= abs(best.time - time):
            best = state
    return best if best is not None and abs(best.time - time) <= tolerance + 1e-6 else None


class Scene:
    """What all targets of a scenario have in common, as arrays."""

    def __init__(self, scenario, frames, interval):
        now = scenario.prediction_time
        dim = {}
        for signal in scenario.traffic_signals:
            readings = [r for r in signal.readings if r.time <= now + 1e-6]
            if readings and readings[-1].state == contract.TRAFFIC_SIGNAL_STATE_STOP:
                dim[signal.lane_id] = 96
            elif readings and readings[-1].state == contract.TRAFFIC_SIGNAL_STATE_CAUTION:
                dim[signal.lane_id] = min(dim.get(signal.lane_id, 255), 176)
        self.styles = [style_of(feature, dim) for feature in scenario.map_features]
        x, y, starts = [], [], [0]
        for feature in scenario.map_features:
            x.extend(feature.x)
            y.extend(feature.y)
            starts.append(len(x))
        self.points = np.array((x, y)).T
        self.starts = starts
        self.agents = {agent.id: agent for agent in scenario.agents}
        self.boxes = []  # agent id, frame, intensity
        poses = []
        for agent in scenario.agents:
            level = BOXES.get(agent.type, 96)
            for frame, state in enumerate(past(agent, now, frames, interval)):
                if state is not None:
                    self.boxes.append((agent.id, frame, level))
                    poses.append((state.x, state.y, state.heading, agent.length, agent.width))
        x, y, heading, length, width = np.array(poses).T
        along = 0.5 * length * np.array((np.cos(heading), np.sin(heading)))
        across = 0.5 * width * np.array((-np.sin(heading), np.cos(heading)))
        corners = (along + across, along - across, -along - across, -along + across)
        self.corners = np.stack([np.array((x, y)) + corner for corner in corners]).transpose(2, 0, 1)


def style_of(feature, dim):
    """How a feature is drawn: "line", "area" or "disc", channel, intensity."""
    kind = feature.type
    if kind in AREAS:
        return "area", 2, AREAS[kind]
    if kind == contract.MAP_FEATURE_TYPE_STOP_SIGN:
        return "disc", 2, STOP_SIGN
    if kind == contract.MAP_FEATURE_TYPE_STOP_LINE:
        return ("disc" if len(feature.x) == 1 else "line"), 2, STOP_LINE
    if kind == contract.MAP_FEATURE_TYPE_ROAD_EDGE:
        return "line", 1, EDGE
    if kind == contract.MAP_FEATURE_TYPE_ROAD_LINE:
        return "line", 1, LINE
    if kind == contract.MAP_FEATURE_TYPE_BIKE_LANE:
        return "line", 0, BIKE_LANE
    return "line", 0, dim.get(feature.id, LANE)


def past(agent, now, frames, interval):
    """The states at now, now - interval, ...; None where there is none within half of it."""
    states = [state for state in agent.states if state.time <= now + 1e-6]
    found, last = [], len(states) - 1
    for frame in range(frames):
        time = now - frame * interval
        while last > 0 and abs(states[last - 1].time - time) < abs(states[last].time - time):
            last -= 1
        near = last >= 0 and abs(states[last].time - time) <= interval / 2 + 1e-6
        found.append(states[last] if near else None)
    return found


def motion_of(agent, now):
    def speed(state):
        return state.velocity_x * math.cos(state.heading) + state.velocity_y * math.sin(
            state.heading
        )

    states = [state_at(agent, now - t, 0.15, now) for t in (0.0, 0.5, 1.0)]
    motion = [0.0] * 4
    if states[0]:
        motion[0] = speed(states[0]) / 10
        if states[1]:
            motion[1] = speed(states[0]) - speed(states[1])
            turn = math.remainder(states[0].heading - states[1].heading, 2 * math.pi)
            motion[3] = turn / 0.5
            if states[2]:
                motion[2] = speed(states[1]) - speed(states[2])
    return np.clip(np.array(motion, np.float32), -4, 4)


class RasterService:
    def __init__(self, folder):
        cv2.setNumThreads(1)
        self.networks = Networks(folder).to(memory_format=torch.channels_last)
        spec = self.networks.spec
        raster = spec["raster"]
        self.height, self.width = raster["height"], raster["width"]
        self.scale = 1.0 / raster["meters_per_pixel"]
        self.origin = (raster["target_position"] * self.width, 0.5 * self.height)
        self.frames = raster["history_frames"]
        self.interval = float(raster["frame_interval"].rstrip("s"))
        step = float(spec["trajectory"]["waypoint_interval"].rstrip("s"))
        self.times = [step * (t + 1) for t in range(self.networks.waypoints)]

    def draw(self, scene, target, pose):
        channels = [
            np.zeros((self.height, self.width), np.uint8) for _ in range(3 + 2 * self.frames)
        ]
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        turn = np.array([[c, s], [s, -c]]) * self.scale  # to columns and rows
        size = np.array([self.width, self.height])

        def project(points):
            return (points - np.array([pose.x, pose.y])) @ turn.T + self.origin - 0.5

        def fixed(pixels):
            return np.round(pixels * (1 << SHIFT)).astype(np.int32)

        if len(scene.points) > 0:
            pixels = project(scene.points)
            starts = scene.starts[:-1]
            low = np.minimum.reduceat(pixels, starts)
            high = np.maximum.reduceat(pixels, starts)
            seen = ((high > -REACH) & (low < size + REACH)).all(1)
            pixels = fixed(pixels)
            alike = {}
            for i in np.nonzero(seen)[0]:
                points = pixels[scene.starts[i] : scene.starts[i + 1]]
                alike.setdefault(scene.styles[i], []).append(points)
            # The brighter ones last: they cover the others.
            for (kind, channel, level), lines in sorted(alike.items(), key=lambda item: item[0][2]):
                if kind == "line":
                    cv2.polylines(channels[channel], lines, False, level, 1, cv2.LINE_AA, SHIFT)
                    continue
                for points in lines:
                    if kind == "area":
                        cv2.fillPoly(channels[channel], [points], level, cv2.LINE_AA, SHIFT)
                    else:
                        radius = int(1.5 * (1 << SHIFT))
                        center = points[0].tolist()
                        cv2.circle(
                            channels[channel], center, radius, level, -1, cv2.LINE_AA, SHIFT
                        )
        corners = project(scene.corners)
        seen = ((corners.max(1) > 0) & (corners.min(1) < size)).all(1)
        corners = fixed(corners)
        for i in np.nonzero(seen)[0]:
            agent, frame, level = scene.boxes[i]
            channel = 3 + frame if agent == target else 3 + self.frames + frame
            cv2.fillConvexPoly(channels[channel], corners[i], level, cv2.LINE_AA, SHIFT)
        return cv2.merge(channels)

    def predict(self, request, _):
        work = []
        response = prediction.PredictResponse(model_version="models/peer/versions/1")
        response.waypoint_times.extend(self.times)
        for index, scenario in enumerate(request.scenarios):
            scene = Scene(scenario, self.frames, self.interval)
            answer = response.predictions.add(
                scenario_index=index, scenario_id=scenario.scenario_id
            )
            for target in scenario.target_ids:
                agent = scene.agents[target]
                now = scenario.prediction_time
                pose = state_at(agent, now, self.interval / 2, now)
                raster = self.draw(scene, target, pose)
                work.append((answer.targets.add(target_id=target), pose, raster, motion_of(agent, now)))
        with torch.inference_mode():
            rasters = torch.from_numpy(np.stack([item[2] for item in work]))
            motions = torch.from_numpy(np.stack([item[3] for item in work]))
            rasters = rasters.permute(0, 3, 1, 2).float().mul_(1.0 / 255.0)
            features, probabilities = self.networks.encode(rasters, motions)
            for i, (answer, pose, _, _) in enumerate(work):
                self.describe(request.query, features[i], probabilities[i], pose, answer)
        return response

    def describe(self, query, features, probabilities, pose, answer):
        answer.probabilities.extend(probabilities.tolist())
        chosen = answers.chosen(query, probabilities.numpy())
        if not chosen:
            return
        means, stddevs, sigma, own = self.networks.describe(features, torch.tensor(chosen))
        sigma = sigma.double().numpy()
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        turn = np.array([[c, s], [-s, c]])
        center = np.array([pose.x, pose.y])
        world = sigma @ turn + center
        plus, minus = world[:, 1::2], world[:, 2::2]
        mean = world[:, 0] + 0.5 * (plus - 2 * world[:, :1] + minus).sum(1)
        half = 0.5 * (plus - minus)
        covariance = np.einsum("adti,adtj->atij", half, half)
        own = own.double().numpy()[..., [[0, 1], [1, 2]]]
        covariance += np.einsum("ki,atkl,lj->atij", turn, own, turn)
        covariance = covariance.reshape(*covariance.shape[:2], 4)[..., [0, 1, 3]]
        for i, action in enumerate(chosen):
            answers.write(
                answer, query, action, probabilities[action].item(), (means[i], stddevs[i]),
                world[i].transpose(0, 2, 1), mean[i].T, covariance[i].T,
            )  # fmt: skip
