#!/usr/bin/python3
"""Asks a server what the target of a scene will do: predict.py SCENE.json [HOST:PORT]."""

import sys

import maneuver


def main() -> None:
    scene = maneuver.load_scenario(sys.argv[1])
    with maneuver.Client(sys.argv[2] if len(sys.argv) > 2 else "127.0.0.1:8470") as client:
        try:
            answer = client.predict(scene, top_k=3, timeout=5.0).raise_errors()
        except maneuver.ManeuverError as error:
            sys.exit(str(error))
    last = -1
    for target in answer.predictions[0].targets:
        print(f"vehicle {target.target_id}, by {answer.model_version}")
        for action, probability, mean in zip(target.action_ids, target.action_probabilities,
                                             target.mean_trajectories):
            x, y = mean[last]  # world frame, metres
            print(f"action {action}  probability {probability:.3f}  after "
                  f"{answer.waypoint_times[last]:.1f} s at ({x:.1f}, {y:.1f})")


if __name__ == "__main__":
    main()
