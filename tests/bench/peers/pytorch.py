"""PyTorch beside the engine, in turn in one run, on one thread each: backbone and p(y|s) of eight
targets of one scene; in eager mode, and traced, frozen and optimised for inference.

  /usr/bin/python3 pytorch.py MODEL_FOLDER [DATASET_FOLDER]

BIN (build/release/bin) is where maneuver-bench is; ROUNDS (40) how often each takes its turn. Ends
with status 1 if they give other probabilities.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
import torch

from networks import Networks

BOUND = 1e-5  # of a probability, between two orders of summation in f32
TURN = 0.05  # seconds


def quantile(values, share):
    return sorted(values)[int(share * (len(values) - 1))]


class Engine:
    """Takes its turns when it is told to."""

    def __init__(self, model, dataset, file):
        here = os.path.dirname(os.path.abspath(__file__))
        folder = os.environ.get("BIN", os.path.join(here, "../../../build/release/bin"))
        arguments = [os.path.join(folder, "maneuver-bench"), "--turns", file, "--model", model]
        if dataset:
            arguments += ["--dataset", dataset]
        self.process = subprocess.Popen(
            arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def line(self):
        return self.process.stdout.readline()

    def encode(self, repeats):
        self.process.stdin.write(f"encode {repeats}\n")
        self.process.stdin.flush()
        return float(self.line())


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    model = sys.argv[1]
    dataset = sys.argv[2] if len(sys.argv) > 2 else None
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as work:
        file = os.path.join(work, "inputs")
        engine = Engine(model, dataset, file)
        sizes = json.loads(engine.line())
        floats = torch.from_numpy(np.fromfile(file, dtype="<f4"))
    n, k = sizes["scenes"], sizes["actions"]
    inputs, at = {"motion": torch.zeros(n, 4)}, 0
    for given in sizes["inputs"]:
        count = int(np.prod(given["sizes"]))
        inputs[given["name"]] = floats[at : at + count].reshape(given["sizes"])
        at += count
    expected = floats[at:].reshape(n, k)
    if set(inputs) != {"raster", "motion"}:
        sys.exit("networks.py has the networks of models that read a raster alone")
    raster = inputs["raster"].contiguous(memory_format=torch.channels_last)
    motion = inputs["motion"]

    eager = Networks(model).to(memory_format=torch.channels_last)
    different = False
    with torch.inference_mode():
        traced = torch.jit.optimize_for_inference(
            torch.jit.freeze(torch.jit.trace(eager, (raster, motion)))
        )
        print(f"{sizes['model']}, {'x'.join(map(str, raster.shape[1:]))}, batch {n}, one thread")
        for name, network in (("eager, channels-last", eager), ("traced and frozen", traced)):

            def theirs(repeats, network=network):
                begin = time.thread_time()
                for _ in range(repeats):
                    network(raster, motion)
                return time.thread_time() - begin

            difference = (network(raster, motion) - expected).abs().max().item()
            different |= sizes["precision"] == "f32" and not difference <= BOUND
            theirs(3)  # tracing optimises in its first runs
            repeats = max(1, round(3 * TURN / theirs(3)))
            engine.encode(repeats)
            theirs(repeats)
            ours, others = [], []
            for _ in range(int(os.environ.get("ROUNDS", "40"))):
                ours.append(engine.encode(repeats) / repeats / n)
                others.append(theirs(repeats) / repeats / n)
            ratios = [other / own for other, own in zip(others, ours)]
            print(
                f"engine ({sizes['precision']}): {1e6 * quantile(ours, 0.5):.1f} us a target\n"
                f"PyTorch {torch.__version__}, {name}: {1e6 * quantile(others, 0.5):.1f} us a target\n"
                f"PyTorch / engine: {quantile(ratios, 0.5):.2f} (middle half "
                f"{quantile(ratios, 0.25):.2f} to {quantile(ratios, 0.75):.2f})\n"
                f"largest difference of p(y|s): {difference:.1e}"
            )
    engine.process.stdin.close()
    engine.process.wait()
    if different:
        sys.exit(f"the probabilities differ by more than {BOUND}")


if __name__ == "__main__":
    main()
