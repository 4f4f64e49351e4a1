"""What one would write in an afternoon in place of maneuverd: grpcio, OpenCV and PyTorch.

  /usr/bin/python3 server.py MODEL_FOLDER [--listen 127.0.0.1:8470]

Answers maneuver.v1.PredictionService/Predict with the same weights on the same scenes: parses, draws
each target with OpenCV, evaluates all targets of a request as one batch, describes the actions asked
for and answers in the world's frame. As its author would reasonably tune it: PyTorch in inference
mode, channels-last; a scene's points and boxes projected at once by NumPy; what the picture cannot
show passed over; lines of one kind drawn by one call. Nothing is validated, batched over calls,
cancelled or dropped when late.

It is here for its speed. OpenCV's boxes and lines are up to a pixel thicker than those that the
weights were learned with, so that its p(y|s) is off by some tenths; with floats of the engine's own
rasters it is the engine's (pytorch.py).

Prints the address that it listens on, when it is ready.
"""

import argparse
import importlib
import math
import pathlib
import subprocess
import sys
import tempfile
from concurrent import futures

import cv2
import grpc
import numpy as np
import torch

from networks import Networks

CONTRACT = pathlib.Path(__file__).resolve().parents[3] / "proto"
METHOD = "/maneuver.v1.PredictionService/Predict"
MIN_PROBABILITY = 0.05
REACH = 2  # pixels that a feature's lines reach beyond its points
SHIFT = 3  # bits of a pixel's fraction
LANE, BIKE_LANE, EDGE, LINE, STOP_SIGN, STOP_LINE = 255, 48, 255, 160, 255, 224
AREAS = {}  # by type, filled in once the contract is loaded
BOXES = {}


def load_contract():
    with tempfile.TemporaryDirectory() as folder:
        protos = sorted(str(p) for p in (CONTRACT / "maneuver" / "v1").glob("*.proto"))
        subprocess.run(
            ["protoc", f"--proto_path={CONTRACT}", f"--python_out={folder}", *protos], check=True
        )
        sys.path.insert(0, folder)
        return (
            importlib.import_module("maneuver.v1.prediction_service_pb2"),
            importlib.import_module("maneuver.v1.scenario_pb2"),
        )


prediction, contract = load_contract()
AREAS.update(
    {
        contract.MAP_FEATURE_TYPE_CROSSWALK: 128,
        contract.MAP_FEATURE_TYPE_SPEED_BUMP: 192,
        contract.MAP_FEATURE_TYPE_DRIVEWAY: 64,
    }
)
BOXES.update(
    {
        contract.AGENT_TYPE_VEHICLE: 255,
        contract.AGENT_TYPE_CYCLIST: 192,
        contract.AGENT_TYPE_PEDESTRIAN: 128,
    }
)


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


class Service:
    def __init__(self, folder):
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
        order = torch.argsort(probabilities, descending=True)
        selection = query.WhichOneof("selection")
        if selection == "top_k":
            chosen = order[: query.top_k]
        elif selection == "action_ids":
            chosen = torch.tensor(list(query.action_ids.ids))
        else:
            least = query.min_probability if selection else MIN_PROBABILITY
            chosen = order[probabilities[order] >= least]
        if len(chosen) == 0:
            return
        means, stddevs, sigma, own = self.networks.describe(features, chosen)
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
        for i, action in enumerate(chosen.tolist()):
            out = answer.distributions.add(
                action_id=action, probability=probabilities[action].item()
            )
            out.latent_mean.extend(means[i].tolist())
            out.latent_stddev.extend(stddevs[i].tolist())
            out.mean_trajectory.x.extend(world[i, 0, :, 0])
            out.mean_trajectory.y.extend(world[i, 0, :, 1])
            if not query.omit_sigma_trajectories:
                for trajectory in world[i]:
                    out.sigma_trajectories.add(x=trajectory[:, 0], y=trajectory[:, 1])
            out.moments.mean_x.extend(mean[i, :, 0])
            out.moments.mean_y.extend(mean[i, :, 1])
            out.moments.covariance_xx.extend(covariance[i, :, 0, 0])
            out.moments.covariance_xy.extend(covariance[i, :, 0, 1])
            out.moments.covariance_yy.extend(covariance[i, :, 1, 1])


class Handler(grpc.GenericRpcHandler):
    def __init__(self, service):
        self.handler = grpc.unary_unary_rpc_method_handler(
            service.predict,
            request_deserializer=prediction.PredictRequest.FromString,
            response_serializer=prediction.PredictResponse.SerializeToString,
        )

    def service(self, details):
        return self.handler if details.method == METHOD else None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("--listen", default="127.0.0.1:0")
    parser.add_argument("--threads", type=int, default=2, help="that answer calls")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    service = Service(options.model)
    server = grpc.server(
        futures.ThreadPoolExecutor(options.threads),
        options=[("grpc.max_receive_message_length", 64 << 20)],
    )
    server.add_generic_rpc_handlers((Handler(service),))
    port = server.add_insecure_port(options.listen)
    server.start()
    print(f"{options.listen.rsplit(':', 1)[0]}:{port}", flush=True)
    server.wait_for_termination()


if __name__ == "__main__":
    main()
