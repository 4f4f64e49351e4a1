#!/usr/bin/python3
"""From nothing to answers, in cells: walkthrough.py [HOST:PORT] [FOLDER]

Editors that know "# %%" (VS Code, Spyder, Jupyter with jupytext) run it cell by cell. The server
needs maneuver-trainer, and the PATH `maneuver`, which makes the synthetic town. It takes a minute.
"""

# %% Connect. Nothing is sent yet: the first call finds out whether the server answers.
import pathlib
import subprocess
import sys
import tempfile

import numpy

import maneuver
from maneuver import v1

address = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:8470"
folder = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)
client = maneuver.Client(address)
client.check_health()

# %% A dataset: recordings of a synthetic town, uploaded once.
if "datasets/walkthrough" not in {dataset.name for dataset in client.list_datasets()}:
    subprocess.run(["maneuver", "synthesize", str(folder / "town"), "--recordings", "24"],
                   check=True, stdout=subprocess.DEVNULL)
    client.upload_dataset(folder / "town", "datasets/walkthrough")
summary = client.describe_dataset("datasets/walkthrough")
print(f"{summary.dataset.recordings} recordings, {summary.examples} examples")

# %% Train a small model. The job goes on if this program ends; its name finds it again.
settings = {
    "preset": "compact",
    "model": {"actions": 12, "latent_dimensions": 3,
              "raster": {"height": 48, "width": 48, "meters_per_pixel": 2},
              "backbone": {"convolutions": [{"channels": 16, "stride": 2},
                                            {"channels": 24, "stride": 2}], "features": 48},
              "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"}},
    "examples": {"max_examples": 300},
    "optimization": {"pretraining_epochs": 2, "mixture_epochs": 2, "joint_epochs": 2,
                     "posterior_epochs": 1},
}
job = client.train("models/walkthrough", ["datasets/walkthrough"], settings)
job = client.wait_for_job(job, lambda seen: print(
    f"{seen.progress.phase:10} {seen.progress.fraction:4.0%}") if seen.progress.epoch else None)
print("made", job.model_version)

# %% A scene: one recording, with one vehicle as the target.
recording = next(client.list_scenarios("datasets/walkthrough"))
scene = client.get_scenario("datasets/walkthrough", recording.scenario_id)
vehicles = {agent.id for agent in scene.agents if agent.type == v1.AGENT_TYPE_VEHICLE}
scene.target_ids[:] = [target for target in scene.target_ids if target in vehicles][:1]

# %% How probable is each action, and what would the likely ones look like?
answer = client.predict(scene, model="models/walkthrough")
target = answer.target()
print("probabilities [K]", numpy.round(target.probabilities, 3))
print("mean trajectories [A, T, 2]", target.mean_trajectories.shape)
print("covariances [A, T, 2, 2]", target.waypoint_covariances.shape)
expected = numpy.einsum("a,atc->tc", target.action_probabilities, target.mean_trajectories)
expected /= target.action_probabilities.sum()
print("expected path of the likely actions, metres:\n", numpy.round(expected, 1))

# %% Which action was it really? Recordings have the future; classification looks at it.
driven = client.classify_trajectories(scene, model="models/walkthrough").target()
print("driven: action", int(numpy.argmax(driven.responsibilities)))

# %% A mistake is named by its field.
scene.agents[0].length = -1.0
try:
    client.predict(scene, model="models/walkthrough").raise_errors()
except maneuver.InvalidArgumentError as error:
    for field, description in error.violations:
        print(f"{field}: {description}")
client.close()
