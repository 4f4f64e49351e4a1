#!/usr/bin/python3
"""A planner's loop at 10 Hz: each cycle asks about the scene as it is now, and has a deadline.

    planner.py [HOST:PORT] [--cycles 50] [--deadline 0.08]

The map is sent once (MapReuse). A cycle without an answer in time goes on with the last one, and a
planner falls back on its own assumption when that is too old. The car drives along a road of 200 m
behind another one.
"""

import argparse
import time
from typing import List, Optional, Tuple

import maneuver

PERIOD = 0.1  # seconds
HISTORY = 11  # states that are sent of each agent: one second
OLDEST = 0.5  # seconds that an answer may be used for

ROAD = [maneuver.MapFeature("lane_centerline", [(x, 0.0) for x in range(-20, 201, 5)], id=1,
                            speed_limit=13.9),
        maneuver.MapFeature("road_edge", [(-20.0, -1.75), (200.0, -1.75)]),
        maneuver.MapFeature("road_edge", [(-20.0, 1.75), (200.0, 1.75)])]


def perceive(now: float) -> maneuver.Scenario:
    """Stands in for perception: the scene at a time, seconds."""
    times = [now + PERIOD * (i - HISTORY + 1) for i in range(HISTORY)]

    def drive(start: float, speed: float) -> List[Tuple[float, ...]]:
        return [(t, start + speed * t, 0.0, 0.0, speed, 0.0) for t in times]

    return maneuver.Scenario(
        prediction_time=times[-1], target_ids=[2], map_features=ROAD,
        agents=[maneuver.Agent(1, drive(0.0, 10.0), length=4.5, width=1.9),
                maneuver.Agent(2, drive(30.0, 8.0), length=4.8, width=2.0)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address", nargs="?", default="127.0.0.1:8470")
    parser.add_argument("--cycles", type=int, default=50)
    parser.add_argument("--deadline", type=float, default=0.08, help="seconds")
    options = parser.parse_args()

    # A call that came too late is of no use: no retries.
    client = maneuver.Client(options.address, deadline=options.deadline, retries=0)
    maps = maneuver.MapReuse(client)
    # The first call connects and sends the map: before the loop, with time.
    maps.predict(perceive(0.0), sigma_trajectories=False, timeout=30.0)

    latencies: List[float] = []
    late = 0
    latest: Optional[maneuver.Predictions] = None
    answered_at = 0.0  # when the latest came
    start = time.monotonic()
    for cycle in range(options.cycles):
        began = time.monotonic()
        try:
            latest = maps.predict(perceive(cycle * PERIOD), top_k=3, sigma_trajectories=False)
            answered_at = time.monotonic()
            latencies.append(answered_at - began)
        except (maneuver.DeadlineExceededError, maneuver.ResourceExhaustedError,
                maneuver.UnavailableError) as error:
            late += 1
            print(f"cycle {cycle}: {error.code.name}")
        if latest is None or time.monotonic() - answered_at > OLDEST:
            print(f"cycle {cycle}: no prediction that is new enough; assuming constant velocity")
        time.sleep(max(0.0, start + (cycle + 1) * PERIOD - time.monotonic()))

    latencies.sort()
    print(f"{options.cycles} cycles, {len(latencies)} answered in time, {late} not")
    if latencies and latest is not None:
        target = latest.target()
        print(f"latency: median {1e3 * latencies[len(latencies) // 2]:.1f} ms, "
              f"slowest {1e3 * latencies[-1]:.1f} ms")
        print(f"last answer: action {target.action_ids[0]}, "
              f"probability {target.action_probabilities[0]:.3f}")
    client.close()


if __name__ == "__main__":
    main()
