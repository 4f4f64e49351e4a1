#!/usr/bin/python3
"""Predictions for a CommonRoad scenario, in CommonRoad's own format.

    predict.py SCENARIO.xml OUTPUT.xml [HOST:PORT] [--model models/town] [--occupancies]

Reads XML of versions 2018b and 2020a with `maneuver import commonroad`, asks about every vehicle
that is there at the prediction time (one second after the scenario's first step), and writes the
scenario with its dynamic obstacles as they are predicted:

  by default     <trajectory>: the most probable action's mean, a state for each time step
  --occupancies  <occupancySet>: at each time step the boxes of all actions with a probability of
                 at least 0.05

Lanelets, static obstacles and planning problems stay as they are. Dynamic obstacles that could not
be predicted are left out, and named on standard error.
"""

import argparse
import math
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from typing import Container, List, NamedTuple, Sequence

import maneuver
from maneuver import v1


class Pose(NamedTuple):
    """Where a vehicle is, world frame."""

    x: float  # metres
    y: float
    heading: float  # radians
    speed: float  # m/s


def run_maneuver(*arguments: str) -> None:
    done = subprocess.run(["maneuver", *arguments], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        sys.exit(done.stdout)


def read_scene(scenario: pathlib.Path, benchmark: str, dynamic: Container[int]) -> v1.Scenario:
    """Returns the scenario as `maneuver` reads it, with every vehicle of `dynamic` as a target."""
    with tempfile.TemporaryDirectory() as folder:
        dataset, scene = (str(pathlib.Path(folder, name)) for name in ("dataset", "scene.json"))
        run_maneuver("import", "commonroad", dataset, str(scenario))
        run_maneuver("scenario", "extract", dataset, benchmark, "--no-future", "--out", scene)
        message = maneuver.load_scenario(scene)
    message.target_ids[:] = [
        agent.id for agent in message.agents
        if agent.id in dynamic and agent.type == v1.AGENT_TYPE_VEHICLE
        and abs(agent.states[-1].time - message.prediction_time) < 1e-6]
    return message


def poses(path: Sequence[Sequence[float]], times: Sequence[float], now: Pose,
          step: float) -> List[Pose]:
    """Returns where a vehicle on a path is at each time step from now on, up to its last waypoint.

    path: [T, 2] metres, at `times` seconds from now. Between waypoints it moves evenly.
    """
    points = [(0.0, now.x, now.y)] + [(time, *point) for time, point in zip(times, path)]
    result: List[Pose] = []
    last = now
    for count in range(1, int(times[-1] / step + 1e-6) + 1):
        time = count * step
        after = next(i for i, point in enumerate(points) if point[0] >= time - 1e-6)
        (t0, x0, y0), (t1, x1, y1) = points[after - 1], points[after]
        share = (time - t0) / (t1 - t0)
        x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        distance = math.hypot(x - last.x, y - last.y)
        # A vehicle that hardly moves keeps its heading.
        heading = math.atan2(y - last.y, x - last.x) if distance > 0.05 else last.heading
        last = Pose(x, y, heading, distance / step)
        result.append(last)
    return result


def add(parent: ElementTree.Element, path: str, value: object = None) -> ElementTree.Element:
    """Adds nested elements, such as position/point/x, and returns the last one."""
    for name in path.split("/"):
        parent = ElementTree.SubElement(parent, name)
    if value is not None:
        parent.text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return parent


def add_state(state: ElementTree.Element, pose: Pose, step: int) -> None:
    point = add(state, "position/point")
    add(point, "x", pose.x)
    add(point, "y", pose.y)
    add(state, "orientation/exact", pose.heading)
    add(state, "time/exact", step)
    add(state, "velocity/exact", pose.speed)


def add_occupancy(occupancies: ElementTree.Element, boxes: Sequence[Pose], agent: v1.Agent,
                  step: int) -> None:
    occupancy = add(occupancies, "occupancy")
    shape = add(occupancy, "shape")
    for pose in boxes:
        rectangle = add(shape, "rectangle")
        add(rectangle, "length", agent.length)
        add(rectangle, "width", agent.width)
        add(rectangle, "orientation", pose.heading)
        center = add(rectangle, "center")
        add(center, "x", pose.x)
        add(center, "y", pose.y)
    add(occupancy, "time/exact", step)


def predict_obstacle(obstacle: ElementTree.Element, agent: v1.Agent,
                     target: maneuver.TargetPrediction, times: Sequence[float], first: int,
                     step: float, occupancies: bool) -> None:
    """Replaces what an obstacle did by what it is predicted to do.

    first: number of the time step of the prediction. step: length of a step, seconds.
    """
    for name in ("initialState", "trajectory", "occupancySet", "initialSignalState",
                 "signalSeries"):
        for element in obstacle.findall(name):
            obstacle.remove(element)
    state = agent.states[-1]
    now = Pose(state.x, state.y, state.heading, math.hypot(state.velocity_x, state.velocity_y))
    add_state(add(obstacle, "initialState"), now, first)
    ways = [poses(path, times, now, step) for path in target.mean_trajectories]
    predicted = add(obstacle, "occupancySet" if occupancies else "trajectory")
    for count in range(len(ways[0])):
        if occupancies:
            add_occupancy(predicted, [way[count] for way in ways], agent, first + 1 + count)
        else:
            add_state(add(predicted, "state"), ways[0][count], first + 1 + count)


def is_dynamic(element: ElementTree.Element) -> bool:
    return element.tag == "dynamicObstacle" or (
        element.tag == "obstacle" and element.findtext("role") == "dynamic")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", type=pathlib.Path)
    parser.add_argument("output", type=pathlib.Path)
    parser.add_argument("address", nargs="?", default="127.0.0.1:8470")
    parser.add_argument("--model", default="")
    parser.add_argument("--occupancies", action="store_true")
    options = parser.parse_args()

    try:
        tree = ElementTree.parse(options.scenario)
    except (OSError, ElementTree.ParseError) as error:
        sys.exit(f"{options.scenario}: {error}")
    root = tree.getroot()
    obstacles = {int(element.get("id", "0")): element for element in root if is_dynamic(element)}
    scene = read_scene(options.scenario, root.get("benchmarkID", ""), obstacles)
    with maneuver.Client(options.address) as client:
        answer = client.predict(scene, model=options.model, sigma_trajectories=False,
                                top_k=None if options.occupancies else 1)
    if answer.predictions[0].error is not None:
        sys.exit(str(answer.predictions[0].error))
    targets = {target.target_id: target for target in answer.predictions[0].targets
               if target.error is None and target.action_ids}
    errors = {target.target_id: target.error for target in answer.predictions[0].targets
              if target.error is not None}
    agents = {agent.id: agent for agent in scene.agents}

    step = float(root.get("timeStepSize", "0.1"))
    for number, obstacle in obstacles.items():
        if number not in targets:
            root.remove(obstacle)
            why = errors.get(number, f"no vehicle that is there at {scene.prediction_time:g} s")
            print(f"obstacle {number}: not predicted: {why}", file=sys.stderr)
            continue
        predict_obstacle(obstacle, agents[number], targets[number], list(answer.waypoint_times),
                         round(scene.prediction_time / step), step, options.occupancies)
    ElementTree.indent(tree)
    tree.write(options.output, encoding="UTF-8", xml_declaration=True)
    print(f"{len(targets)} obstacles predicted by {answer.model_version}, from "
          f"{scene.prediction_time:g} s on for {answer.waypoint_times[-1]:g} s")


if __name__ == "__main__":
    main()
