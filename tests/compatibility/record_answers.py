#!/usr/bin/python3
"""Answers of a build's server by one model, which later builds have to give as well (ModelFolderTest).

    record_answers.py --programs FOLDER MODEL_FOLDER tests/compatibility/models/NAME      # by hand

Writes to the last folder a copy of the model, request.bin (a PredictRequest whose targets also have a future) and the
server's answers to it in f32: posterior.bin and prior.bin (PredictResponse) and classified.bin
(ClassifyTrajectoriesResponse).
"""

import argparse
import json
import math
import pathlib
import shutil
import subprocess
import tempfile
import time

import grpc
from maneuver.v1 import prediction_service_pb2 as service
from maneuver.v1 import prediction_service_pb2_grpc, scenario_pb2

PATIENCE_S = 30.0
NOW = 2.0
FUTURE_S = 5.0


def add_agent(scenario, number, kind, start, heading, speed, acceleration=0.0, turn_rate=0.0, length=4.6, width=1.9):
    """An agent that is at `start` at 0 s: at 10 Hz up to the prediction time, and the future of targets at 5 Hz."""
    agent = scenario.agents.add(id=number, type=kind, length=length, width=width)
    (x, y), step = start, 0.1
    for i in range(round((NOW + (FUTURE_S if number in scenario.target_ids else 0.0)) / step) + 1):
        velocity = speed * math.cos(heading), speed * math.sin(heading)
        if step * i <= NOW or i % 2 == 0:
            agent.states.add(time=step * i, x=x, y=y, heading=math.remainder(heading, 2 * math.pi), velocity_x=velocity[0],
                             velocity_y=velocity[1])
        x, y = x + step * velocity[0], y + step * velocity[1]
        speed, heading = max(0.0, speed + step * acceleration), heading + step * turn_rate


def add_lane(scenario, number, points, successors=()):
    scenario.map_features.add(id=number, type=scenario_pb2.MAP_FEATURE_TYPE_LANE_CENTERLINE, x=[p[0] for p in points],
                              y=[p[1] for p in points], speed_limit=13.9, successor_ids=successors)


def junction():
    """Vehicles that come to a fork with a signal, one behind the other, among people. The third one has just appeared."""
    scenario = scenario_pb2.Scenario(scenario_id="junction", prediction_time=NOW, target_ids=[1, 2, 3])
    kind = scenario_pb2
    add_agent(scenario, 1, kind.AGENT_TYPE_VEHICLE, (0.0, 0.1), 0.02, 9.0, acceleration=-0.8)
    add_agent(scenario, 2, kind.AGENT_TYPE_VEHICLE, (22.0, -0.2), 0.0, 7.0, acceleration=-0.3, turn_rate=0.1)
    add_agent(scenario, 3, kind.AGENT_TYPE_VEHICLE, (60.0, 3.5), math.pi, 6.0, acceleration=0.7, length=7.9, width=2.5)
    del scenario.agents[2].states[:17]
    add_agent(scenario, 4, kind.AGENT_TYPE_PEDESTRIAN, (55.0, 9.0), -1.6, 1.3, length=0.7, width=0.7)
    add_agent(scenario, 5, kind.AGENT_TYPE_CYCLIST, (12.0, -3.0), 0.0, 4.5, length=1.8, width=0.7)
    turn = [(50.0 + 20.0 * math.sin(0.1 * i), 20.0 * (1.0 - math.cos(0.1 * i))) for i in range(16)]
    add_lane(scenario, 1, [(10.0 * i - 20.0, 0.0) for i in range(8)], [2, 3])
    add_lane(scenario, 2, [(50.0 + 10.0 * i, 0.0) for i in range(9)])
    add_lane(scenario, 3, turn)
    add_lane(scenario, 4, [(120.0 - 10.0 * i, 3.5) for i in range(15)])
    signal = scenario.traffic_signals.add(lane_id=2)
    signal.readings.add(time=0.0, state=scenario_pb2.TRAFFIC_SIGNAL_STATE_CAUTION)
    signal.readings.add(time=1.5, state=scenario_pb2.TRAFFIC_SIGNAL_STATE_STOP)
    return scenario


def open_place():
    """One vehicle that turns on a place without a map, and one that stands."""
    scenario = scenario_pb2.Scenario(scenario_id="place", prediction_time=NOW, target_ids=[1, 2])
    add_agent(scenario, 1, scenario_pb2.AGENT_TYPE_VEHICLE, (-300.0, 800.0), 3.0, 4.0, acceleration=0.5, turn_rate=0.4)
    add_agent(scenario, 2, scenario_pb2.AGENT_TYPE_VEHICLE, (-320.0, 810.0), -1.0, 0.0)
    return scenario


def record(programs, model, output):
    request = service.PredictRequest(model="models/recorded/versions/1", scenarios=[junction(), open_place()])
    request.query.min_probability = 0.0
    request.query.omit_sigma_trajectories = True  # their moments are there
    with tempfile.TemporaryDirectory(prefix="maneuver-answers-") as name:
        data = pathlib.Path(name)
        shutil.copytree(model, data / "models" / "recorded" / "1")
        server = subprocess.Popen([programs / "maneuverd", "--data-dir", data, "--listen", "127.0.0.1:0", "--metrics-listen",
                                   "none", "--port-file", data / "ports", "--precision", "f32"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            give_up = time.monotonic() + PATIENCE_S
            while not (data / "ports").exists():
                if server.poll() is not None or time.monotonic() > give_up:
                    raise SystemExit("the server did not start")
                time.sleep(0.05)
            with grpc.insecure_channel(json.loads((data / "ports").read_text())["grpc"]) as channel:
                stub = prediction_service_pb2_grpc.PredictionServiceStub(channel)
                answers = {}
                for file, source in ("posterior", service.LATENT_SOURCE_POSTERIOR), ("prior", service.LATENT_SOURCE_PRIOR):
                    request.query.source = source
                    answers[file] = stub.Predict(request, timeout=PATIENCE_S)
                answers["classified"] = stub.ClassifyTrajectories(
                    service.ClassifyTrajectoriesRequest(model=request.model, scenarios=request.scenarios), timeout=PATIENCE_S)
        finally:
            server.terminate()
            server.wait()
    output.mkdir(parents=True)
    for file in "model.json", "weights.safetensors":
        shutil.copy(model / file, output / file)
    request.query.ClearField("source")
    for file, message in {"request": request, **answers}.items():
        (output / f"{file}.bin").write_bytes(message.SerializeToString(deterministic=True))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=pathlib.Path, required=True, help="folder of maneuverd")
    parser.add_argument("model", type=pathlib.Path, help="model folder")
    parser.add_argument("output", type=pathlib.Path, help="folder to write; must not exist")
    options = parser.parse_args()
    record(options.programs.resolve(), options.model, options.output)


if __name__ == "__main__":
    main()
