"""PyTorch in eager mode beside the trainer, in turn in one run: examples a second of the joint phase,
which is where the time of a training goes. Prints the rows of a Markdown table.

  taskset -c 0 /usr/bin/python3 pytorch_training.py MODEL_FOLDER DATASET_FOLDER

Both start from the model's weights, with the same networks, bound, batch size and optimiser, the same
number of threads (THREADS, 1) and the same cores. The trainer draws its rasters meanwhile, varied anew
for each epoch, on those cores; PyTorch has them drawn, in memory: made up ones, since the speed of the
networks does not depend on what is in them. SECONDS_EACH (10) is the length of a turn, ROUNDS (3) how
often each takes its; BIN (build/release/bin) where maneuver-trainer is.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from datetime import datetime

import torch

from training_networks import TrainingNetworks

BATCH = 64
CACHED = 2048  # rasters; more would only be slower to reach
RATE, LATENT_RATE, DECAY = 1e-3, 1e-4, 1e-4
DRAWN = 0.05  # share of a raster's bytes that are not 0
WARM_UP = 5  # steps
PATIENCE = 300  # seconds, for a turn of the trainer with reading the dataset


class PyTorch:
    def __init__(self, model):
        torch.manual_seed(1)
        self.networks = TrainingNetworks(model)
        self.optimizer = torch.optim.AdamW(self.networks.groups(RATE, LATENT_RATE, DECAY))
        stem = next(self.networks.backbone.parameters())
        with open(os.path.join(model, "model.json"), encoding="utf-8") as file:
            raster = json.load(file)["spec"]["raster"]
        # As the trainer's rasterizer lays them out, which is channels-last.
        shape = (CACHED, raster["height"], raster["width"], stem.shape[1])
        self.rasters = (torch.rand(shape) < DRAWN).to(torch.uint8) * 255
        self.motions = torch.randn(CACHED, 4)
        with torch.no_grad():
            latents = torch.randn(CACHED, self.networks.mixture_mean.shape[1])
            self.trajectories = self.networks.decode(latents)
        self.order = torch.empty(0, dtype=torch.long)
        self.step_for(WARM_UP)

    def step(self):
        if len(self.order) < BATCH:
            self.order = torch.randperm(CACHED)
        chosen, self.order = self.order[:BATCH], self.order[BATCH:]
        raster = self.rasters[chosen].permute(0, 3, 1, 2).to(torch.float32).mul_(1 / 255)
        loss = self.networks.loss(raster, self.motions[chosen], self.trajectories[chosen])
        if not torch.isfinite(loss):
            sys.exit("PyTorch's loss is no longer finite")
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()

    def step_for(self, steps):
        for _ in range(steps):
            self.step()

    def turn(self, seconds):
        """Examples a second, and milliseconds of processor time an example."""
        begin, processor, examples = time.monotonic(), time.process_time(), 0
        while time.monotonic() - begin < seconds:
            self.step()
            examples += BATCH
        elapsed, spent = time.monotonic() - begin, time.process_time() - processor
        return examples / elapsed, 1000 * spent / examples


def processor_time(process):
    """Seconds that a process has used so far."""
    with open(f"/proc/{process.pid}/stat", encoding="utf-8") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def instant(text):
    """Seconds, of a time in JSON."""
    whole, _, fraction = text.rstrip("Z").partition(".")
    return datetime.strptime(whole, "%Y-%m-%dT%H:%M:%S").timestamp() + float(f"0.{fraction or 0}")


def trainer_turn(model, dataset, threads, seconds):
    """Examples a second, milliseconds of processor time an example, and the share of the steps' time
    that they waited for rasters: of `seconds` of the joint phase, validation left out."""
    here = os.path.dirname(os.path.abspath(__file__))
    folder = os.environ.get("BIN", os.path.join(here, "../../../build/release/bin"))
    with tempfile.TemporaryDirectory() as work:
        settings = os.path.join(work, "settings.json")
        with open(settings, "w", encoding="utf-8") as file:
            optimization = {"joint_epochs": 1000, "batch_size": BATCH}
            model_settings = {"objective": "OBJECTIVE_UNIFIED"}
            json.dump({"model": model_settings, "optimization": optimization}, file)
        complaints = open(os.path.join(work, "stderr"), "w+", encoding="utf-8")
        process = subprocess.Popen(
            [os.path.join(folder, "maneuver-trainer"), "train", "--settings", settings]
            + ["--dataset", dataset, "--start-from", model, "--output", os.path.join(work, "model")]
            + ["--threads", str(threads), "--progress", "json"],
            stdout=subprocess.PIPE,
            stderr=complaints,
            text=True,
        )
        impatience = threading.Timer(PATIENCE, process.kill)
        impatience.start()
        elapsed = spent = waiting = 0.0
        steps = 0
        before = None
        for line in process.stdout:
            progress = json.loads(line)
            if progress.get("phase") != "joint":
                continue
            now = (instant(progress["time"]), int(progress.get("step", 0)), processor_time(process))
            if before is not None and "epoch_report" not in progress:
                elapsed += now[0] - before[0]
                steps += now[1] - before[1]
                spent += now[2] - before[2]
            before = now
            waiting = progress.get("waiting_fraction", 0.0)
            if elapsed >= seconds:
                break
        process.terminate()
        process.stdout.read()
        process.wait()
        impatience.cancel()
        if elapsed < seconds:
            complaints.seek(0)
            sys.exit(f"{complaints.read()}maneuver-trainer ended before its turn was over")
    return steps * BATCH / elapsed, 1000 * spent / (steps * BATCH), waiting


def median(values):
    return sorted(values)[(len(values) - 1) // 2]


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    model, dataset = sys.argv[1:]
    threads = int(os.environ.get("THREADS", "1"))
    seconds = float(os.environ.get("SECONDS_EACH", "10"))
    torch.set_num_threads(threads)
    pytorch = PyTorch(model)
    ours, theirs = [], []
    for _ in range(int(os.environ.get("ROUNDS", "3"))):
        ours.append(trainer_turn(model, dataset, threads, seconds))
        theirs.append(pytorch.turn(seconds))
    ratios = sorted(own[0] / other[0] for own, other in zip(ours, theirs))
    cores = len(os.sched_getaffinity(0))
    print(
        f"| {threads} on {cores} | {median([own[0] for own in ours]):.0f} "
        f"| {median([other[0] for other in theirs]):.0f} "
        f"| {median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}) "
        f"| {median([own[1] for own in ours]):.2f} | {median([other[1] for other in theirs]):.2f} "
        f"| {100 * median([own[2] for own in ours]):.1f} % |"
    )


if __name__ == "__main__":
    main()
