#!/usr/bin/env python3
"""Ten minutes in the life of a server, as the dashboard's queries see them through a real Prometheus: steady load,
a job that learns, a candidate in the shadow, more load than it can take, a swap, callers who do what they should not.

    record_story.py PROGRAMS SERIES.json DATASET MODEL CANDIDATE [MINUTES]

DATASET is a folder of recordings, MODEL and CANDIDATE are folders of models. Draw it: draw_dashboard.py.
"""

import json
import math
import pathlib
import sys
import tempfile
import time

import dashboard
from scraped_server import Prometheus, Server, wait_for

STEP = 3  # seconds between two points


def story(server, prometheus, dataset, minutes):
    """Each thing at its share of the time; when the steady load ended."""
    begin, end = time.monotonic(), time.time() + 0.97 * 60 * minutes
    running = []

    def start(*arguments):
        running.append(server.start_maneuver(*arguments))

    def at(share):
        time.sleep(max(0.0, begin + share * 60 * minutes - time.monotonic()))

    def load(share, *arguments):
        seconds = share * 60 * minutes
        start("load", "--dataset", dataset, "--warm-up", 0, "--duration", f"{seconds:.0f}", *arguments)

    wait_for("a first scrape", lambda: prometheus.now("up == 1"))
    server.maneuver("model", "promote", "town/1")
    server.maneuver("model", "promote", "town/2", "--alias", "candidate")
    load(1.0, "--rate", 15, "--targets", "1-8", "--register-maps")
    load(1.0, "--rate", 4, "--targets", "8-16", "--priority", "bulk")
    load(1.0, "--rate", 8, "--method", "probability", "--targets", "1-4")
    at(0.03)
    job = server.train("--promote", "never", "--epochs", 200, "--pretraining-epochs", 15, "--mixture-epochs", 30,
                       "--set", "examples.max_examples=1500", "--set", "augmentation.mirror=false")
    at(0.2)
    load(0.08, "--rate", 40, "--targets", "1-8")
    at(0.38)
    load(0.09, "--rate", 400, "--targets", "2-12", "--deadline", 400)
    at(0.53)
    load(0.07, "--rate", 60, "--deadline", "4-30")
    at(0.64)
    server.maneuver("model", "promote", "town/2")
    server.maneuver("model", "promote", "town/1", "--alias", "candidate")
    at(0.7)
    for _ in range(8):
        server.maneuver("model", "list", token="A" * 43, fails=True)
        server.maneuver("job", "list", token=server.planner, fails=True)
        server.maneuver("load", "--model", "nobody", "--calls", 40, "--warm-up", 0, fails=True)
    at(0.86)
    server.maneuver("job", "cancel", job)
    server.maneuver("job", "watch", server.train("--horizon", "60s"), fails=True)
    for process in running:
        process.wait()
    return end


def main(programs, output, dataset, model, candidate, minutes="10"):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        server = Server(programs, folder, ["--workers", "1", "--shadow-fraction", "0.5", "--max-queue", "128"], [model, candidate],
                        recordings=60)
        prometheus = Prometheus(folder, server.metrics)
        try:
            server.maneuver("dataset", "upload", folder / "town", "town")
            prometheus.start = time.time()
            end = story(server, prometheus, dataset, float(minutes))
            courses = {}
            for query in dashboard.queries():
                courses[query.expr] = [
                    {"labels": labels, "values": [(at, value if math.isfinite(value) else None) for at, value in values]}
                    for labels, values in prometheus.course(dashboard.written_out(query.expr), end=end, step=STEP)]
            pathlib.Path(output).write_text(json.dumps({"start": prometheus.start, "step": STEP, "courses": courses}))
        finally:
            prometheus.stop()
            server.stop()


if __name__ == "__main__":
    if len(sys.argv) not in (6, 7):
        sys.exit(__doc__)
    main(*sys.argv[1:])
