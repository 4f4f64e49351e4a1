#!/usr/bin/python3
"""Joint combinations beside independent marginals, on recordings of Waymo Open Motion: prints Markdown tables.

  MANEUVER_REAL_DATA=FOLDER tests/bench/joint.py --folder WORK

Trains a model of the default preset for each of five folds (maneuver-trainer cross-validate, groups of recordings stay
whole), starts a server with all of them, and asks it about held-out recordings only: `joint_combinations` for pairs,
triples and larger sets of vehicles that move. The same answers give the marginals' most probable combinations, which are
the largest products of p(y|s). Both are scored with the same trajectories, the moments' means:

  minADE, minFDE  joint: the best combination by the mean over its targets, metres
  missed          no combination has each of its targets within 2 m at the end
  overlap         combinations in which two targets' rectangles overlap at a waypoint; `first`: the most probable one

Overlap is computed here, from rectangles, not by the server. Sets whose true rectangles overlap, now or later, are left
out. If the server finds no combination, the marginals' stand in; the table counts these. Intervals are of 95 %, by a
bootstrap over recordings. WORK keeps the dataset, the models and what was measured on each recording (rows.json): the
same command goes on after an interruption. --no-training takes the folds that are there. Needs the targets maneuver, maneuverd, maneuver-trainer and maneuver_python, and numpy.
"""

import argparse
import collections
import heapq
import itertools
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import time

import numpy

TIMES = (2.5,)  # prediction times, seconds
NEAR = 50.0  # metres between the vehicles of a set, now
MOVES = 2.0  # metres that each of them drives within the horizon, at least
COUNT = 6
LARGEST = 8
METRICS = ("minADE, m", "minFDE, m", "missed", "overlap", "overlap, first", "ADE, first, m", "FDE, first, m")


def records(dataset):
    """Yields the recordings of a dataset folder, as bytes."""
    for shard in json.loads((dataset / "dataset.json").read_text())["shards"]:
        data = (dataset / shard["file"]).read_bytes()
        place = 0
        while place < len(data):
            size, = struct.unpack_from("<Q", data, place)
            yield data[place + 12:place + 12 + size]
            place += size + 16


def prepare(options, folder):
    """Makes the dataset and trains the models that are missing."""
    if not (folder / "waymo").exists():
        recordings = pathlib.Path(os.environ["MANEUVER_REAL_DATA"]) / "waymo_open_motion"
        files = sorted(recordings.glob("training*")) + sorted(recordings.glob("validation*"))
        subprocess.run([options.bin / "maneuver", "import", "waymo", folder / "waymo", *files], check=True)
    if not options.no_training:
        subprocess.run([options.bin / "maneuver-trainer", "cross-validate", "--dataset", folder / "waymo", "--models",
                        folder / "models", "--checkpoints", folder / "checkpoints", "--output", folder / "report.json",
                        "--folds", str(options.folds)], check=True)


def folds_of(v1, folder):
    """Returns the fold, counted from 1, that measures each recording whose model is there."""
    files = sorted((folder / "checkpoints").glob("checkpoint-*"))
    parts = [v1.CrossValidationPart.FromString(one.read_bytes()) for one in files]
    trained = {part.runs[0].fold for part in parts}
    return {one.scenario_id: one.fold + 1 for one in parts[0].plan.recordings if one.fold in trained}


class Server:
    """A maneuverd with the model of each fold as a version of `folds`."""

    def __init__(self, options, folder, work, folds):
        for fold in folds:
            shutil.copytree(folder / "models" / f"seed-1-fold-{fold}", work / "data" / "models" / "folds" / str(fold))
        ports = work / "ports.json"
        self.process = subprocess.Popen(
            [options.bin / "maneuverd", "--data-dir", work / "data", "--listen", "127.0.0.1:0", "--metrics-listen",
             "127.0.0.1:0", "--port-file", ports], stdout=subprocess.DEVNULL,
            stderr=(work / "log").open("w"))
        while not ports.exists() or not ports.stat().st_size:
            if self.process.poll() is not None:
                sys.exit((work / "log").read_text())
            time.sleep(0.01)
        self.address = json.loads(ports.read_text())["grpc"]

    def close(self):
        self.process.terminate()
        self.process.wait()


def corners(centres, headings, size):
    """Corners of rectangles. centres: [..., 2]; headings: [...]; returns [..., 4, 2]"""
    ahead = numpy.stack([numpy.cos(headings), numpy.sin(headings)], -1) * size[0] / 2
    left = numpy.stack([-numpy.sin(headings), numpy.cos(headings)], -1) * size[1] / 2
    return numpy.stack([centres + ahead + left, centres + ahead - left, centres - ahead - left,
                        centres - ahead + left], -2)


def overlap(a, b):
    """Whether rectangles overlap, by the separating axes. a, b: [..., 4, 2]; returns [...]"""
    apart = numpy.zeros(a.shape[:-2], bool)
    for sides in (a, b):
        for axis in (sides[..., 0, :] - sides[..., 1, :], sides[..., 1, :] - sides[..., 2, :]):
            of_a = (a * axis[..., None, :]).sum(-1)
            of_b = (b * axis[..., None, :]).sum(-1)
            apart |= (of_a.max(-1) <= of_b.min(-1)) | (of_b.max(-1) <= of_a.min(-1))
    return ~apart


def clearance(a, b):
    """Distance of rectangles that do not overlap: some corner is nearest. a, b: [..., 4, 2]; returns [...]"""
    least = numpy.full(a.shape[:-2], numpy.inf)
    for points, sides in ((a, b), (b, a)):
        start, end = sides, numpy.roll(sides, 1, -2)
        along = (end - start)[..., None, :, :]
        share = ((points[..., :, None, :] - start[..., None, :, :]) * along).sum(-1)
        share = numpy.clip(share / (along ** 2).sum(-1), 0, 1)
        nearest = start[..., None, :, :] + share[..., None] * along
        least = numpy.minimum(least, numpy.linalg.norm(points[..., :, None, :] - nearest, axis=-1).min((-1, -2)))
    return least


def headings_of(path, now):
    """Directions of motion from one waypoint to the next but one; where it hardly moves, as before. path: [T+1, 2]"""
    before, after = path[numpy.r_[0, 0:len(path) - 1]], path[numpy.r_[1:len(path), len(path) - 1]]
    moved = after - before
    headings = numpy.arctan2(moved[:, 1], moved[:, 0])
    headings[0] = now
    for t in numpy.nonzero(numpy.hypot(*moved.T) < 0.1)[0]:
        headings[t] = headings[t - 1] if t else now
    return headings


class Vehicle:
    """A vehicle of a recording: its box, and where it really was now and at the waypoints."""

    def __init__(self, agent, now, waypoints):
        states = agent.states
        times = numpy.array([state.time for state in states])
        at = now + numpy.concatenate([[0.0], waypoints])
        near = numpy.searchsorted(times, at - 1e-6)
        self.known = bool(len(times)) and near.max() < len(times) and (abs(times[near] - at) < 0.06).all()
        if not self.known:
            return
        self.id, self.size = agent.id, (agent.length, agent.width)
        self.truth = numpy.array([[states[i].x, states[i].y] for i in near])
        self.heading = states[int(near[0])].heading
        self.box = corners(self.truth, numpy.array([states[i].heading for i in near]), self.size)
        self.moves = numpy.hypot(*(self.truth[-1] - self.truth[0])) > MOVES


def sets_of(vehicles):
    """Returns sets of vehicles that move: pairs, triples of one and its two nearest, and the most in one place."""
    moving = [one for one in vehicles if one.moves]
    distance = lambda a, b: numpy.hypot(*(a.truth[0] - b.truth[0]))
    found = {2: [pair for pair in itertools.combinations(moving, 2) if distance(*pair) < NEAR], 3: {}, LARGEST: {}}
    for one in moving:
        near = sorted((other for other in moving if other is not one and distance(one, other) < NEAR),
                      key=lambda other: distance(one, other))
        for size in (3, LARGEST):
            group = [one, *near[:size - 1]]
            if len(group) == 3 or (size == LARGEST and len(group) > 3):
                found[size][frozenset(vehicle.id for vehicle in group)] = group
    # The largest sets overlap one another: the one with the most vehicles of each scene will do.
    largest = max(found[LARGEST].values(), key=len, default=None)
    return [(2, pair) for pair in found[2]] + [(3, group) for group in found[3].values()] + (
        [(LARGEST, largest)] if largest else [])


def most_probable(probabilities, count):
    """Returns the combinations with the largest products, as places in each target's list. Lists are sorted."""
    score = lambda places: -sum(numpy.log(max(p[i], 1e-300)) for p, i in zip(probabilities, places))
    start = (0,) * len(probabilities)
    queue, seen, found = [(score(start), start)], {start}, []
    while queue and len(found) < count:
        places = heapq.heappop(queue)[1]
        found.append(places)
        for n, place in enumerate(places):
            after = (*places[:n], place + 1, *places[n + 1:])
            if place + 1 < len(probabilities[n]) and after not in seen:
                seen.add(after)
                heapq.heappush(queue, (score(after), after))
    return found


def score(group, means, combinations):
    """Returns METRICS. means: [A, T, 2] of each target; combinations: places in them"""
    errors, collide = [], []
    for places in combinations:
        boxes, of_each = [], []
        for vehicle, mean, place in zip(group, means, places):
            path = numpy.vstack([vehicle.truth[:1], mean[place]])
            boxes.append(corners(path, headings_of(path, vehicle.heading), vehicle.size)[1:])
            of_each.append(numpy.hypot(*(mean[place] - vehicle.truth[1:]).T))
        errors.append(of_each)
        collide.append(any(overlap(a, b).any() for a, b in itertools.combinations(boxes, 2)))
    errors = numpy.array(errors)  # [combinations, targets, T]
    ade, fde = errors.mean((1, 2)), errors[:, :, -1].mean(1)
    return numpy.array([ade.min(), fde.min(), (errors[:, :, -1].max(1) > 2.0).all(), numpy.mean(collide), collide[0],
                        ade[0], fde[0]])


def measure(maneuver, client, recording, now, fold, waypoints):
    """Yields a row for each set of a recording at one time."""
    vehicles = [Vehicle(agent, now, waypoints) for agent in recording.agents
                if agent.type == maneuver.v1.AGENT_TYPE_VEHICLE]
    sets = sets_of([one for one in vehicles if one.known])
    kept = []
    for size, group in sets:
        pairs = list(itertools.combinations(group, 2))
        if any(overlap(a.box, b.box).any() for a, b in pairs):
            continue
        kept.append((size, group, min(clearance(a.box, b.box).min() for a, b in pairs)))
    scene = maneuver.v1.Scenario()
    scene.CopyFrom(recording)
    scene.prediction_time = now
    for agent in scene.agents:
        past = [state for state in agent.states if state.time <= now + 1e-6]
        del agent.states[:]
        agent.states.extend(past)
    for start in range(0, len(kept), 16):
        batch = kept[start:start + 16]
        requests = []
        for _, group, _ in batch:
            requests.append(maneuver.v1.Scenario())
            requests[-1].CopyFrom(scene)
            requests[-1].target_ids[:] = [one.id for one in group]
        answer = client.predict(requests, model=f"models/folds/versions/{fold}", min_probability=0.0,
                                sigma_trajectories=False, joint=COUNT)
        numpy.testing.assert_allclose(answer.waypoint_times, waypoints)
        for (size, group, gap), one in zip(batch, answer.predictions):
            if one.error or any(target.error for target in one.targets):
                continue
            means = [target.waypoint_means for target in one.targets]
            marginal = most_probable([target.action_probabilities for target in one.targets], COUNT)
            joint = [tuple(target.action_ids.index(action) for target, action in zip(one.targets, each.action_ids))
                     for each in one.joint.combinations]
            yield {"recording": recording.scenario_id, "size": size, "gap": float(gap),
                   "fewer": len(joint) < COUNT, "none": not joint, "truncated": one.joint.truncated,
                   "changed": bool(joint) and joint != marginal, "marginal": score(group, means, marginal).tolist(),
                   "joint": score(group, means, joint or marginal).tolist()}


def table(rows, random):
    """Returns Markdown: each metric of the marginals, of the combinations, and the difference with its interval."""
    by_recording = collections.defaultdict(list)
    for row in rows:
        by_recording[row["recording"]].append(row)
    pairs = numpy.array([[row["marginal"], row["joint"]] for row in rows])
    sums = numpy.array([sum(numpy.subtract(row["joint"], row["marginal"]) for row in group)
                        for group in by_recording.values()])
    counts = numpy.array([len(group) for group in by_recording.values()])
    drawn = random.integers(0, len(counts), (2000, len(counts)))
    low, high = numpy.percentile(sums[drawn].sum(1) / counts[drawn].sum(1)[:, None], [2.5, 97.5], axis=0)
    lines = [f"| {len(rows):,} sets of {len(counts)} recordings | marginals | joint | difference |", "|---|---|---|---|"]
    for n, name in enumerate(METRICS):
        marginal, joint = pairs[:, 0, n].mean(), pairs[:, 1, n].mean()
        lines.append(f"| {name} | {marginal:.4f} | {joint:.4f} | {joint - marginal:+.4f} ({low[n]:+.4f} to "
                     f"{high[n]:+.4f}) |")
    share = lambda what: f"{100 * numpy.mean([row[what] for row in rows]):.2f} %"
    lines.append(f"\nOther combinations than the marginals': {share('changed')}; fewer than {COUNT}: {share('fewer')}; "
                 f"none: {share('none')}; search ended at its bound: {share('truncated')}.")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("build/release/bin"))
    parser.add_argument("--python", type=pathlib.Path, help="the Python package; default: beside --bin")
    parser.add_argument("--folder", type=pathlib.Path, required=True, help="for the dataset and the models")
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--no-training", action="store_true", help="take the folds that are there")
    parser.add_argument("--only", type=int, help="measure the recordings of this fold; default: all")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    prepare(options, options.folder)
    sys.path.insert(0, str(options.python or options.bin.parent / "python"))
    import maneuver  # pylint: disable=import-outside-toplevel

    folds = folds_of(maneuver.v1, options.folder)
    kept = options.folder / "rows.json"
    measured = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {one["recording"] for one in measured}
    with tempfile.TemporaryDirectory() as work:
        server = Server(options, options.folder, pathlib.Path(work), sorted(set(folds.values())))
        try:
            with maneuver.Client(server.address) as plain:
                client = maneuver.MapReuse(plain)
                for data in records(options.folder / "waymo"):
                    recording = maneuver.v1.Scenario.FromString(data)
                    fold = folds.get(recording.scenario_id)
                    if fold is None or recording.scenario_id in done or options.only not in (None, fold):
                        continue
                    rows = []
                    version = plain.get_model_version(f"models/folds/versions/{fold}").manifest.spec.trajectory
                    interval = version.waypoint_interval.ToTimedelta().total_seconds()
                    waypoints = interval * numpy.arange(1, version.waypoints + 1)
                    end = max(agent.states[-1].time for agent in recording.agents if agent.states)
                    for now in TIMES:
                        if now + waypoints[-1] < end + 0.05:
                            rows += measure(maneuver, client, recording, now, fold, waypoints)
                    measured.append({"recording": recording.scenario_id, "fold": fold, "rows": rows})
                    with kept.open("a") as file:
                        print(json.dumps(measured[-1]), file=file)
        finally:
            server.close()
    random = numpy.random.default_rng(1)
    rows = [row for one in measured for row in one["rows"]]
    print(f"{len(measured)} recordings, folds {', '.join(map(str, sorted({one['fold'] for one in measured})))} of "
          f"{options.folds}.")
    for size, name in ((2, "Pairs"), (3, "Triples"), (LARGEST, f"Four to {LARGEST} targets")):
        for gap, which in ((numpy.inf, "all"), (5.0, "that come within 5 m of each other"),
                           (2.0, "that come within 2 m of each other")):
            chosen = [row for row in rows if row["size"] == size and row["gap"] < gap]
            if chosen:
                print(f"\n## {name}: {which}\n\n{table(chosen, random)}")


if __name__ == "__main__":
    main()
