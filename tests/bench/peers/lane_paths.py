"""Lane paths in NumPy: the 84 numbers a path that model/scene/lane_paths.h defines, by version 2 of the inputs.

All targets of a scene are searched together. Python loops over lanes, starts and paths alone; what
is done for each point, segment or agent is done for whole arrays. A map's lanes are indexed once
(LaneGraph), as are the tracks along them.
"""

import math
from bisect import bisect_right

import numpy as np

from contract import scenario as contract

MOST_PATHS = 6
NUMBERS = 84
DISTANCES = np.array([2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80, 100])
SCALES = np.maximum(DISTANCES, 5.0)
SECONDS = np.arange(1.0, 6.0)
PIECE = 16  # segments
SAME_POINT, MOST_GAP, MOST_DECLARED_GAP = 1e-3, 0.6, 5.0
REACH, BEHIND, AHEAD = 110.0, 1.0, 80.0
START_DISTANCE, START_COSINE, TURN_COST = 5.0, 0.5, 4.0
MOST_STARTS, MOST_BRANCHES, MOST_WAYS_ON, MOST_SUCCESSORS, MOST_EXTENSIONS = 6, 5, 4, 8, 128
SAME_PATH, LEADER_DISTANCE, LEADER_AHEAD, SIGN_DISTANCE = 1.5, 1.8, 1.5, 7.0
NOBODY, MOST_SPEED, FAR_APART = 100.0, 100.0, 1e5
RANKS = {
    contract.TRAFFIC_SIGNAL_STATE_STOP: 3,
    contract.TRAFFIC_SIGNAL_STATE_CAUTION: 2,
    contract.TRAFFIC_SIGNAL_STATE_GO: 1,
}
COLUMN_OF_RANK = (0, 3, 2, 1)  # of numbers 74 to 77


def distinct(x, y):
    """The points without those within SAME_POINT of the one before."""
    kept = [0]
    for i in range(1, len(x)):
        if math.hypot(x[i] - x[kept[-1]], y[i] - y[kept[-1]]) > SAME_POINT:
            kept.append(i)
    return [x[i] for i in kept], [y[i] for i in kept]


class Track:
    """Lanes one after the other. Rows of `points`: arc length, x, y, how x and y grow with arc
    length, heading (cosine, sine), length of the segment (-1: a gap, or the end)."""

    def __init__(self, graph, lanes):
        parts, self.starts, start = [], [], 0.0
        for i, lane in enumerate(lanes):
            if i > 0:
                start += graph.lengths[lanes[i - 1]] + graph.gap(lanes[i - 1], lane)
            part = graph.points[:, graph.first[lane] : graph.last[lane] + 1].copy()
            part[0] += start
            parts.append(part)
            self.starts.append(start)
        for before, after in zip(parts, parts[1:]):
            gap = after[0, 0] - before[0, -1]
            if gap > 0:
                before[3:5, -1] = (after[1:3, 0] - before[1:3, -1]) / gap
                before[5:7, -1] = after[5:7, 0]
        self.points = np.concatenate(parts, 1)
        self.distances = self.points[0].tolist()
        self.end = self.distances[-1]
        self.ids = [graph.ids[lane] for lane in lanes]
        self.speed_limit = min(graph.speed_limits[lanes[0]], MOST_SPEED)


class LaneGraph:
    """The lanes of a map (model/scene/lane_graph.h)."""

    def __init__(self, features):
        x, y, counts, declared = [], [], [], []
        self.ids, self.speed_limits, signs = [], [], []
        for feature in features:
            if feature.type == contract.MAP_FEATURE_TYPE_STOP_SIGN and len(feature.x) > 0:
                signs.append((feature.x[0], feature.y[0]))
            if feature.type != contract.MAP_FEATURE_TYPE_LANE_CENTERLINE:
                continue
            lane_x, lane_y = feature.x[:], feature.y[:]
            if len(lane_x) < 2:
                continue
            x += lane_x
            y += lane_y
            counts.append(len(lane_x))
            self.ids.append(feature.id)
            self.speed_limits.append(feature.speed_limit)
            declared.append(feature.successor_ids[:])
        self.signs = np.array(signs).reshape(-1, 2)
        self.tracks = {}
        self._place(np.array(x), np.array(y), np.array(counts, int), declared)
        self._cut()
        self._link(declared)

    def _place(self, x, y, counts, declared):
        last = np.cumsum(counts) - 1
        step_x, step_y = np.diff(x, append=0.0), np.diff(y, append=0.0)
        length = np.sqrt(step_x * step_x + step_y * step_y)
        length[last] = -1.0
        if ((length >= 0) & (length <= SAME_POINT)).any():
            x, y, counts = self._without_repeated(x, y, counts, declared)
            self._place(x, y, counts, declared)
            return
        first = last - counts + 1
        with np.errstate(invalid="ignore"):
            cosine, sine = step_x / length, step_y / length
        cosine[last], sine[last] = cosine[last - 1], sine[last - 1]
        along = np.concatenate(([0.0], np.cumsum(np.maximum(length, 0.0))[:-1]))
        along -= np.repeat(along[first], counts)
        self.points = np.array((along, x, y, cosine, sine, cosine, sine, length))
        self.first, self.last = first.tolist(), last.tolist()
        self.lengths = along[last].tolist()

    def _without_repeated(self, x, y, counts, declared):
        lanes = []
        for i, end in enumerate(np.cumsum(counts)):
            points = distinct(x[end - counts[i] : end].tolist(), y[end - counts[i] : end].tolist())
            lanes.append(points)
        kept = [i for i, lane in enumerate(lanes) if len(lane[0]) >= 2]
        self.ids = [self.ids[i] for i in kept]
        self.speed_limits = [self.speed_limits[i] for i in kept]
        declared[:] = [declared[i] for i in kept]
        return (
            np.concatenate([lanes[i][0] for i in kept] or [[]]),
            np.concatenate([lanes[i][1] for i in kept] or [[]]),
            np.array([len(lanes[i][0]) for i in kept], int),
        )

    def _cut(self):
        """The pieces of the lanes, and the boxes around them."""
        first, last = np.array(self.first, int), np.array(self.last, int)
        pieces = (last - first + PIECE - 1) // PIECE
        self.piece_lane = np.repeat(np.arange(len(first)), pieces)
        number = np.arange(len(self.piece_lane)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        self.piece_first = first[self.piece_lane] + PIECE * number
        self.piece_last = np.minimum(self.piece_first + PIECE, last[self.piece_lane])
        self.low, self.high = boxes(self.points[1:3], self.piece_first, self.piece_last)

    def _link(self, declared):
        lane_of = {}
        for lane, identity in enumerate(self.ids):
            if identity != 0:
                lane_of.setdefault(identity, lane)
        starts, ends = self.points[:, self.first], self.points[:, self.last]
        self.start_x, self.start_y = starts[1].tolist(), starts[2].tolist()
        self.end_x, self.end_y = ends[1].tolist(), ends[2].tolist()
        self.successors = []
        for lane, ids in enumerate(declared):
            found = []
            for identity in ids:
                other = lane_of.get(identity, lane) if identity != 0 else lane
                if other == lane or other in found:
                    continue
                if self.gap(lane, other) <= MOST_DECLARED_GAP:
                    found.append(other)
            self.successors.append(found[:MOST_SUCCESSORS])
        alone = np.array([lane for lane, found in enumerate(self.successors) if not found], int)
        off_x = starts[1] - ends[1, alone, None]
        off_y = starts[2] - ends[2, alone, None]
        near = np.nonzero(off_x * off_x + off_y * off_y <= MOST_GAP**2)
        turn = starts[5:7, near[1]] * ends[5:7, alone[near[0]]]
        for lane, other, cosine in zip(alone[near[0]].tolist(), near[1].tolist(), turn.sum(0)):
            if cosine > 0.8 and other != lane and len(self.successors[lane]) < MOST_SUCCESSORS:
                self.successors[lane].append(other)

    def gap(self, lane, other):
        off = math.hypot(
            self.start_x[other] - self.end_x[lane], self.start_y[other] - self.end_y[lane]
        )
        return off if off > SAME_POINT else 0.0

    def track(self, lanes):
        track = self.tracks.get(lanes)
        if track is None:
            track = self.tracks[lanes] = Track(self, lanes)
        return track


def boxes(points, first, last):
    """Corners [2, n] of the boxes around points [2, P] first .. last, which adjoin."""
    if len(first) == 0:
        return np.zeros((2, 0)), np.zeros((2, 0))
    end = points[:, last]
    return (
        np.minimum(np.minimum.reduceat(points, first, 1), end),
        np.maximum(np.maximum.reduceat(points, first, 1), end),
    )


def squared_distances(points, paths):
    """From each of the points [n, P, 2] to the lines of each path [n, P, 2], whose first and last
    have no end: [n, n, P]."""
    step = np.diff(paths, axis=1)
    squared = (step * step).sum(2)
    least, most = np.zeros(squared.shape[1]), np.ones(squared.shape[1])
    least[0], most[-1] = -np.inf, np.inf
    off = points[:, None, :, None] - paths[:, None, :-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((off * step[:, None]).sum(4) / squared[:, None], least, most)
    off = off - share[..., None] * step[:, None]
    return np.where(squared[:, None] > 0, (off * off).sum(4), np.inf).min(3)


def find_starts(graph, poses):
    """For each target, up to six of (cost, lane, foot, offset, heading), the cheapest first.

    poses: [N, 4] x, y, cosine and sine of the heading"""
    x, y, cosine, sine = poses.T
    near = (
        (graph.low[0] <= x[:, None] + START_DISTANCE)
        & (graph.high[0] >= x[:, None] - START_DISTANCE)
        & (graph.low[1] <= y[:, None] + START_DISTANCE)
        & (graph.high[1] >= y[:, None] - START_DISTANCE)
    )
    target, piece = np.nonzero(near)
    segment = graph.piece_first[piece][:, None] + np.arange(PIECE)
    exists = segment < graph.piece_last[piece][:, None]
    segment = np.where(exists, segment, 0)
    _, from_x, from_y, _, _, along_x, along_y, length = graph.points[:, segment]
    turn = along_x * cosine[target, None] + along_y * sine[target, None]
    dx, dy = x[target, None] - from_x, y[target, None] - from_y
    along = np.minimum(np.maximum(dx * along_x + dy * along_y, 0.0), length)
    off_x, off_y = dx - along * along_x, dy - along * along_y
    squared = off_x * off_x + off_y * off_y
    hit = np.nonzero(exists & (turn > START_COSINE) & (squared < START_DISTANCE**2))
    cost = np.sqrt(squared[hit]) + TURN_COST * (1.0 - turn[hit])
    target, lane, point = target[hit[0]], graph.piece_lane[piece[hit[0]]], segment[hit]
    # The cheapest segment of each lane.
    key = target * len(graph.ids) + lane
    order = np.lexsort((point, cost, key))
    order = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
    order = order[np.lexsort((point[order], cost[order], target[order]))]
    foot = graph.points[0, point] + along[hit]
    offset = (off_y * along_x - off_x * along_y)[hit]
    starts = [[] for _ in poses]
    columns = (target, cost, lane, foot, offset, along_x[hit], along_y[hit])
    for owner, *start in zip(*(column[order].tolist() for column in columns)):
        if len(starts[owner]) < MOST_STARTS:
            starts[owner].append(start)
    return starts


def extend(graph, lane, foot):
    """The lanes of each path from a start."""
    nodes = [((lane,), graph.lengths[lane])]
    found = []
    i = 0
    while i < len(nodes) and len(found) < MOST_BRANCHES:
        lanes, end = nodes[i]
        ways = 0
        if i < MOST_EXTENSIONS and end - foot < REACH:
            for other in graph.successors[lanes[-1]]:
                if ways == MOST_WAYS_ON:
                    break
                if other not in lanes:
                    reached = end + graph.gap(lanes[-1], other) + graph.lengths[other]
                    nodes.append((lanes + (other,), reached))
                    ways += 1
        if ways == 0:
            found.append(lanes)
        i += 1
    return found


class Paths:
    """The paths of some targets of one scene, and their numbers 0 to 68: what depends on place and
    speed alone."""

    def __init__(self, graph, poses, speeds):
        self.owner, self.foot, self.tracks, starts, counts = [], [], [], [], [0] * len(poses)
        if len(graph.ids) > 0:
            for owner, of_target in enumerate(find_starts(graph, poses)):
                for start in of_target:
                    for lanes in extend(graph, start[1], start[2]):
                        self.owner.append(owner)
                        self.foot.append(start[2])
                        self.tracks.append(graph.track(lanes))
                        starts.append(start)
        self.counts = counts
        if not self.owner:
            return
        ahead = np.maximum(np.minimum(speeds, MOST_SPEED), 0.0)
        self._join(ahead)
        owner = np.array(self.owner)
        straight = ahead[owner, None] * SECONDS
        ways = np.concatenate((np.broadcast_to(DISTANCES, (len(owner), 13)), straight), 1)
        points, headings = self._read(ways, poses[owner])
        kept, self.row = self._different(points[:, :13], counts)
        self.kept = np.array(kept)
        self._write(points[kept], headings[kept, :13], straight[kept], starts, poses)

    def _join(self, ahead):
        """All tracks from behind the foot as far as they are read, one after the other."""
        parts, ends, end = [], [], 0
        for owner, foot, track in zip(self.owner, self.foot, self.tracks):
            far = foot + max(REACH, 5.0 * ahead[owner])
            begin = max(bisect_right(track.distances, foot - BEHIND) - 1, 0)
            part = track.points[:, begin : bisect_right(track.distances, far) + 1]
            parts.append(part)
            end += part.shape[1]
            ends.append(end)
        self.points = np.concatenate(parts, 1)
        self.ends = np.array(ends)
        self.sizes = np.diff(self.ends, prepend=0)
        self.points[0] -= np.repeat(np.array(self.foot), self.sizes)

    def _read(self, ways, poses):
        """Places [M, W, 2] and headings [M, W, 2] at arc lengths [M, W], in the target's frame."""
        shift = FAR_APART * np.arange(len(ways))
        keys = self.points[0] + np.repeat(shift, self.sizes)
        at = np.searchsorted(keys, (ways + shift[:, None]).ravel(), "right") - 1
        begin, x, y, dx, dy, cosine, sine, _ = self.points[:, at].reshape(8, *ways.shape)
        ahead = ways - begin
        own_x, own_y, own_cosine, own_sine = poses.T[:, :, None]
        x = x + ahead * dx - own_x
        y = y + ahead * dy - own_y
        return (
            np.stack((own_cosine * x + own_sine * y, own_cosine * y - own_sine * x), 2),
            np.stack(
                (own_cosine * cosine + own_sine * sine, own_cosine * sine - own_sine * cosine), 2
            ),
        )

    def _different(self, points, counts):
        """The paths that are not close to an earlier one of the same target, at most six each, and
        which of the target's paths each is."""
        kept, rows, begin = [], [], 0
        for owner in range(len(counts)):
            end = bisect_right(self.owner, owner)
            own = points[begin:end]
            same = (squared_distances(own, own) < SAME_PATH**2).all(2).tolist()
            mine = []
            for i in range(end - begin):
                if len(mine) < MOST_PATHS and not any(same[i][j] for j in mine):
                    mine.append(i)
            counts[owner] = len(mine)
            kept += [begin + i for i in mine]
            rows += range(len(mine))
            begin = end
        return kept, np.array(rows)

    def _write(self, points, headings, straight, starts, poses):
        starts = [starts[i] for i in self.kept]
        self.owner = np.array(self.owner)[self.kept]
        self.foot = [self.foot[i] for i in self.kept]
        self.tracks = [self.tracks[i] for i in self.kept]
        numbers = self.numbers = np.zeros((len(starts), 69))
        numbers[:, 0:26] = (points[:, :13] / SCALES[:, None]).reshape(-1, 26)
        numbers[:, 26:39] = headings[..., 0]
        numbers[:, 39:52] = headings[..., 1]
        look = points[:, 13:] / 10.0
        look[..., 0] -= straight / 10.0
        numbers[:, 52:62] = look.reshape(-1, 10)
        cost, _, foot, offset, cosine, sine = np.array(starts).T
        _, _, own_cosine, own_sine = poses[self.owner].T
        numbers[:, 62] = offset
        numbers[:, 63] = own_sine * cosine - own_cosine * sine
        numbers[:, 64] = own_cosine * cosine + own_sine * sine
        ends = np.array([track.end for track in self.tracks])
        numbers[:, 65] = np.minimum(ends - foot, REACH) / 50.0
        numbers[:, 66] = cost / 3.0
        numbers[:, 67] = self.row == 0
        numbers[:, 68] = [track.speed_limit / 15.0 for track in self.tracks]
        self._box()

    def _box(self):
        """Boxes around the pieces of the kept paths."""
        sizes = self.sizes[self.kept]
        pieces = (sizes - 2) // PIECE + 1  # the last point begins no segment
        self.piece_path = np.repeat(np.arange(len(sizes)), pieces)
        number = np.arange(len(self.piece_path)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        last = (self.ends[self.kept] - 1)[self.piece_path]
        self.piece_first = (last - sizes[self.piece_path] + 1) + PIECE * number
        self.piece_last = np.minimum(self.piece_first + PIECE, last)
        # Dropped paths lie between: the boxes are found of each piece's own points.
        around = self.piece_first[:, None] + np.arange(PIECE + 1)
        around = np.minimum(around, self.piece_last[:, None])
        places = self.points[1:3, around]
        self.low, self.high = places.min(2), places.max(2)

    def pass_by(self, x, y, reach, ids=None, own_ids=None):
        """Where the paths pass points [P] within `reach`: path, point, arc length, heading. A path
        does not pass the point that is its own target."""
        near = (
            (self.low[0][:, None] <= x + reach)
            & (self.high[0][:, None] >= x - reach)
            & (self.low[1][:, None] <= y + reach)
            & (self.high[1][:, None] >= y - reach)
        )
        if ids is not None:
            near &= own_ids[self.owner[self.piece_path]][:, None] != ids
        piece, point = np.nonzero(near)
        segment = self.piece_first[piece][:, None] + np.arange(PIECE)
        exists = segment < self.piece_last[piece][:, None]
        segment = np.where(exists, segment, 0)
        begin, from_x, from_y, _, _, cosine, sine, length = self.points[:, segment]
        least = np.maximum(-BEHIND - begin, 0.0)
        most = np.minimum(AHEAD - begin, length)
        dx, dy = x[point][:, None] - from_x, y[point][:, None] - from_y
        along = np.minimum(np.maximum(dx * cosine + dy * sine, least), most)
        off_x, off_y = dx - along * cosine, dy - along * sine
        squared = off_x * off_x + off_y * off_y
        hit = np.nonzero(exists & (least <= most) & (squared < reach * reach))
        if len(hit[0]) == 0:
            return None
        path, point = self.piece_path[piece[hit[0]]], point[hit[0]]
        at, squared = (begin + along)[hit], squared[hit]
        # The nearest place of each path and point; the first of equally near ones.
        key = path * len(x) + point
        order = np.lexsort((segment[hit], key))
        key, squared = key[order], squared[order]
        group = np.flatnonzero(np.diff(key, prepend=-1))
        nearest = np.repeat(np.minimum.reduceat(squared, group), np.diff(group, append=len(key)))
        order, key = order[squared <= nearest + 1e-9], key[squared <= nearest + 1e-9]
        order = order[np.flatnonzero(np.diff(key, prepend=-1))]
        return path[order], point[order], at[order], cosine[hit][order], sine[hit][order]


def first_along(path, at):
    """Of places on paths, the first of each path."""
    order = np.lexsort((at, path))
    return order[np.flatnonzero(np.diff(path[order], prepend=-1))]


def signals_of(scene, time):
    """The most restrictive light that each lane shows."""
    ranks = {}
    for signal in scene.traffic_signals:
        readings = [r for r in signal.readings if r.time <= time + 1e-6]
        if readings and signal.lane_id != 0:
            rank = RANKS.get(readings[-1].state, 0)
            ranks[signal.lane_id] = max(rank, ranks.get(signal.lane_id, 0))
    return ranks


def describe_paths(paths, graph, agents, signals, own_ids, own_lengths, speeds):
    """Inputs [N, 6, 84] of the targets of one scene, f32."""
    inputs = np.zeros((len(own_ids), MOST_PATHS, NUMBERS), np.float32)
    if not any(paths.counts):
        return inputs
    rest = np.zeros((len(paths.owner), NUMBERS - 69))  # numbers 69 to 83
    rest[:, 1] = NOBODY / 30.0
    passed = paths.pass_by(agents.x, agents.y, LEADER_DISTANCE, agents.ids, own_ids)
    if passed is not None:
        path, agent, at, cosine, sine = passed
        ahead = np.flatnonzero(at > LEADER_AHEAD)
        ahead = ahead[first_along(path[ahead], at[ahead])]
        path, agent = path[ahead], agent[ahead]
        owner = paths.owner[path]
        gap = at[ahead] - 0.5 * (agents.length[agent] + own_lengths[owner])
        along = agents.velocity_x[agent] * cosine[ahead] + agents.velocity_y[agent] * sine[ahead]
        along = np.clip(along, -MOST_SPEED, MOST_SPEED)
        own = np.clip(speeds[owner], -MOST_SPEED, MOST_SPEED)
        rest[path, 0] = 1.0
        rest[path, 1] = gap / 30.0
        rest[path, 2] = along / 10.0
        rest[path, 3] = (along - own) / 10.0
        rest[path, 4] = np.exp(-np.maximum(gap, 0.0) / 15.0)
    if signals:
        for i, (track, foot) in enumerate(zip(paths.tracks, paths.foot)):
            for identity, start in zip(track.ids, track.starts):
                if start - foot > -3.0 and identity in signals:
                    rank, closeness = signals[identity], math.exp(-max(start - foot, 0.0) / 15.0)
                    rest[i, 5 + COLUMN_OF_RANK[rank]] = 1.0
                    rest[i, 9] = (start - foot - NOBODY) / 30.0
                    rest[i, 10] = closeness if rank == 3 else 0.0
                    rest[i, 11] = closeness if rank == 2 else 0.0
                    break
    if len(graph.signs) > 0:
        passed = paths.pass_by(graph.signs[:, 0], graph.signs[:, 1], SIGN_DISTANCE)
        if passed is not None:
            path, _, at, _, _ = passed
            first = first_along(path, at)
            rest[path[first], 12] = 1.0
            rest[path[first], 13] = (at[first] - NOBODY) / 30.0
            rest[path[first], 14] = np.exp(-np.abs(at[first]) / 10.0)
    inputs[paths.owner, paths.row, :69] = paths.numbers
    inputs[paths.owner, paths.row, 69:] = rest
    return inputs
