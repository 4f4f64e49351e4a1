"""What a model with scene vectors reads beside the lane paths, in NumPy: the target's history and
motion, the agents nearby, the rolled-out reference, and actions held against the lane paths.

model/scene has the formulas: target_history.h, agent_inputs.h, motion_reference.h and
action_geometry.h.
"""

import math

import numpy as np

from contract import scenario as contract

SAME_TIME = 1e-6
OTHERS_TOLERANCE = 0.125  # seconds, of the state of an agent that is not the target
HISTORY = 42
TIMES = np.arange(-10, 1) * 0.1  # of a history's states
SPREAD = 1.1  # the sum of their squared distances from the mean time
MOST_AGENTS, AGENT_NUMBERS, AGENT_REACH = 12, 24, 50.0
ARC_LENGTHS = np.array([0, 2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80], np.float32)
POINT_SCALES = np.array([5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80, 100], np.float32)
PAIR_NUMBERS, ACTION_NUMBERS, BEYOND = 18, 13, 1000.0


def latest(states, time):
    """The index of the last state at or before `time`, or -1."""
    i = len(states) - 1
    while i >= 0 and states[i].time > time + SAME_TIME:
        i -= 1
    return i


def turn_between(first, second):
    return math.remainder(second - first, 2 * math.pi)


class Target:
    """One target as it is now, and its states of the last second as numbers."""

    def __init__(self, agent, now, tolerance):
        states = agent.states
        i = latest(states, now)
        if i < 0 or states[i].time < now - tolerance - SAME_TIME:
            raise ValueError(f"agent {agent.id} has no state at the prediction time")
        state = states[i]
        self.id, self.length, self.width = agent.id, agent.length, agent.width
        age = now - state.time  # since then it has gone on as it was
        place = state.x + age * state.velocity_x, state.y + age * state.velocity_y
        self.pose = (*place, math.cos(state.heading), math.sin(state.heading))
        heading, rows = 0.0, []
        before = state.heading
        while i >= 0:
            state = states[i]
            time = state.time - now
            if time < -1.0 - SAME_TIME:
                break
            heading += turn_between(before, state.heading)
            before = state.heading
            rows.append((time, state.x, state.y, heading, state.velocity_x, state.velocity_y))
            i -= 1
        rows = np.array(rows[::-1]).T
        past = np.array([np.interp(TIMES, rows[0], row) for row in rows[1:]])
        # It keeps the velocity of its first state before that state, and of its last one after it.
        missing, since = np.minimum(TIMES - rows[0, 0], 0.0), np.maximum(TIMES - rows[0, -1], 0.0)
        past[0] += missing * rows[4, 0] + since * rows[4, -1] - self.pose[0]
        past[1] += missing * rows[5, 0] + since * rows[5, -1] - self.pose[1]
        self.past = past


class Histories:
    """The past and the motion of all targets. history: [N, 42] f32"""

    def __init__(self, targets):
        past = np.stack([target.past for target in targets], 1)
        _, _, cosine, sine = np.array([target.pose for target in targets]).T[:, :, None]

        def turned(x, y):
            return cosine * x + sine * y, cosine * y - sine * x

        x, y = turned(past[0], past[1])
        heading = past[2]
        velocity_x, velocity_y = turned(past[3], past[4])
        speeds = velocity_x * np.cos(heading) + velocity_y * np.sin(heading)
        acceleration, noise = self._slope(speeds)
        turn_rate, turn_noise = self._slope(heading)
        self.speed = speed = velocity_x[:, -1]
        self.acceleration = acceleration / (1 + 30 * noise / SPREAD)
        self.turn_rate = turn_rate / (1 + 100 * turn_noise / (SPREAD * 0.12**2))
        size = np.array([(target.length / 5, target.width / 2) for target in targets])
        self.history = np.empty((len(targets), HISTORY), np.float32)
        motion = (
            speed / 10,
            velocity_y[:, -1],
            self.acceleration / 2,
            self.turn_rate * 3,
            speeds[:, 10] - speeds[:, 5],
            speeds[:, 5] - speeds[:, 0],
            (heading[:, 10] - heading[:, 5]) / 0.5,
            *size.T,
        )
        self.history[:, :9] = np.clip(np.stack(motion, 1), -4, 4)
        now = speed[:, None]
        departures = np.stack(
            (x - now * TIMES, y, heading * 5, velocity_x - now, velocity_y * 2), 2
        )
        self.history[:, 9:39] = np.clip(departures[:, ::2], -5, 5).reshape(-1, 30)
        self.history[:, 39:] = np.exp(-np.abs(now) / np.array([0.5, 2, 8]))

    @staticmethod
    def _slope(values):
        """Slopes of straight lines through values [N, 11], and the variances of what is left."""
        times = TIMES + 0.5
        off = values - values.mean(1, keepdims=True)
        slope = off @ times / SPREAD
        rest = off - slope[:, None] * times
        return slope, (rest * rest).sum(1) / 9

    def roll_out(self, kind, waypoints, interval):
        """The reference [N, T, 2]."""
        count = len(self.speed)
        if kind == "TRAJECTORY_REFERENCE_CONSTANT_VELOCITY":
            x = self.speed[:, None] * (interval * np.arange(1, waypoints + 1))
            return np.stack((x, np.zeros_like(x)), 2)
        if kind != "TRAJECTORY_REFERENCE_FADING_MOTION":
            return np.zeros((count, waypoints, 2))
        parts = max(1, math.ceil(interval / 0.1 - 1e-6))
        step = interval / parts
        faded = 1.0 - np.exp(-step * np.arange(waypoints * parts + 1))
        speed = self.speed[:, None]
        speeds = speed + np.clip(self.acceleration, -4, 4)[:, None] * faded
        speeds = np.maximum(speeds, np.minimum(speed, 0.0))
        headings = np.clip(self.turn_rate, -1, 1)[:, None] * faded
        speeds = 0.5 * (speeds[:, 1:] + speeds[:, :-1])
        headings = 0.5 * (headings[:, 1:] + headings[:, :-1])
        steps = np.stack((np.cos(headings), np.sin(headings)), 2) * (step * speeds)[..., None]
        return np.cumsum(steps, 1)[:, parts - 1 :: parts]


class Agents:
    """All agents that are there at `time`, as arrays: read once for the targets of a scene."""

    def __init__(self, scene, time):
        rows = []
        for agent in scene.agents:
            states = agent.states
            i = latest(states, time)
            if i < 0:
                continue
            state = states[i]
            age = time - state.time
            if age > OTHERS_TOLERANCE + SAME_TIME:
                continue
            speed = math.hypot(state.velocity_x, state.velocity_y)
            faster = turned = known = 0.0
            wanted, nearest = state.time - 0.5, 0.05 + SAME_TIME
            for j in range(i, -1, -1):
                off = states[j].time - wanted
                if off < -nearest:
                    break
                if abs(off) < nearest:
                    nearest, earlier, known = abs(off), states[j], 1.0
            if known:
                faster = speed - math.hypot(earlier.velocity_x, earlier.velocity_y)
                turned = turn_between(earlier.heading, state.heading)
            kind = agent.type
            rows.append(
                (
                    agent.id, state.x + age * state.velocity_x, state.y + age * state.velocity_y,
                    state.heading, state.velocity_x, state.velocity_y,
                    speed, faster, turned, known, agent.length, agent.width,
                    kind == contract.AGENT_TYPE_VEHICLE, kind == contract.AGENT_TYPE_PEDESTRIAN,
                    kind == contract.AGENT_TYPE_CYCLIST,
                )
            )  # fmt: skip
        self.ids = np.array([row[0] for row in rows], np.int64)
        self.numbers = np.array([row[1:] for row in rows], float).reshape(-1, 14)
        self.x, self.y, _, self.velocity_x, self.velocity_y = self.numbers.T[:5]
        self.length = self.numbers[:, 9]

    def describe(self, ids, poses, speeds):
        """Inputs [N, 12, 24] f32 and mask [N, 12] of targets."""
        inputs = np.zeros((len(ids), MOST_AGENTS, AGENT_NUMBERS), np.float32)
        mask = np.zeros((len(ids), MOST_AGENTS), bool)
        if len(self.ids) == 0:
            return inputs, mask
        own_x, own_y, cosine, sine = poses.T[:, :, None]
        dx, dy = self.x - own_x, self.y - own_y
        squared = dx * dx + dy * dy
        squared[(squared >= AGENT_REACH**2) | (self.ids == ids[:, None])] = np.inf
        order = np.argsort(squared, 1, "stable")[:, :MOST_AGENTS]
        squared = np.take_along_axis(squared, order, 1)
        there = np.isfinite(squared)
        x, y, heading, vx, vy, agent_speed, faster, turned, known, length, width = (
            self.numbers[order].transpose(2, 0, 1)[:11]
        )
        x, y = x - own_x, y - own_y
        x, y = cosine * x + sine * y, cosine * y - sine * x
        vx, vy = cosine * vx + sine * vy, cosine * vy - sine * vx
        distance = np.sqrt(np.where(there, squared, 0.0))
        own = speeds[:, None]
        relative = vx - own
        square = relative * relative + vy * vy
        moving = square > 1e-6
        meeting = -(x * relative + y * vy) / np.where(moving, square, 1.0)
        meeting = np.where(moving, np.clip(meeting, 0.0, 8.0), 0.0)
        closest = np.hypot(x + meeting * relative, y + meeting * vy)
        heading_cosine, heading_sine = np.cos(heading), np.sin(heading)
        numbers = np.stack(
            (
                x / 20, y / 20, np.exp(-distance / 5), np.exp(-distance / 20),
                cosine * heading_cosine + sine * heading_sine,
                cosine * heading_sine - sine * heading_cosine,
                vx / 10, vy / 10, relative / 10, agent_speed / 10, np.exp(-agent_speed / 0.5),
                np.clip(faster, -4, 4), np.clip(turned / 0.25, -4, 4), known,
                length / 5, width / 2, *self.numbers[order, 11:].transpose(2, 0, 1),
                meeting / 4, np.exp(-closest / 2), np.exp(-closest / 8),
                (x + meeting * vx) / 20, (y + meeting * vy) / 20,
            ),
            2,
        )  # fmt: skip
        count = order.shape[1]
        inputs[:, :count] = np.clip(numbers, -8, 8) * there[..., None]
        mask[:, :count] = there
        return inputs, mask


class ActionGeometry:
    """Actions held against lane paths.

    generic: [K, T, 2] decoded means of p(z|y), metres, without the reference"""

    def __init__(self, generic, interval):
        times = interval * np.arange(1, generic.shape[1] + 1)
        known = np.concatenate(([0.0], times))  # with the prediction time

        def nearest(time, count):
            off = np.abs(known[: count + 1] - time)
            return int(np.argmax(off <= off.min() + 1e-9))

        self.at = [max(1, nearest(share * times[-1], len(times))) for share in (0.4, 0.7, 1.0)]
        self.before = [nearest(known[at] - 0.5, at - 1) for at in self.at]
        self.times = known[self.at].astype(np.float32)
        self.steps = (known[self.at] - known[self.before]).astype(np.float32)
        generic = np.concatenate((np.zeros_like(generic[:, :1]), generic), 1)
        self.generic_at = generic[:, self.at].astype(np.float32)
        self.generic_before = generic[:, self.before].astype(np.float32)

    def describe(self, reference, paths, counts, speeds):
        """Numbers of pairs [N, K, 6, 18] and of actions [N, K, 13], f32.

        reference: [N, T, 2]; paths: [N, 6, 84] f32; counts: [N] paths"""
        reference = np.concatenate((np.zeros_like(reference[:, :1]), reference), 1)
        reference = reference.astype(np.float32)
        at = self.generic_at + reference[:, None, self.at]  # [N, K, 3, 2]
        before = self.generic_before + reference[:, None, self.before]
        velocity = (at - before) / self.steps[:, None]
        speed = np.sqrt((velocity * velocity).sum(3))
        directed = speed > 0.5
        direction = velocity / np.where(directed, speed, 1.0)[..., None]
        direction = np.where(directed[..., None], direction, np.array([1, 0], np.float32))
        own = speeds.astype(np.float32)[:, None]
        actions = np.empty((*at.shape[:2], ACTION_NUMBERS), np.float32)
        actions[..., 0:2] = at[:, :, 2] / np.array([50, 20], np.float32)
        actions[..., 2:4] = at[:, :, 0] / np.array([20, 10], np.float32)
        actions[..., 4:7] = speed / 15
        actions[..., 7:11] = direction[:, :, 1:].reshape(*at.shape[:2], 4)
        actions[..., 11] = (speed[..., 2] - own) / 10
        actions[..., 12] = np.exp(-speed[..., 2])
        return self._pairs(at, direction, paths, counts), actions

    def _pairs(self, at, direction, paths, counts):
        scenes, count = at.shape[:2]
        start, along_path, least, most = self._polylines(paths)
        x = at[..., 0].reshape(scenes, 1, -1) - start[..., 0]  # [13, N, 6, 3K]
        y = at[..., 1].reshape(scenes, 1, -1) - start[..., 1]
        along = x * along_path[..., 0] + y * along_path[..., 1]
        across = along_path[..., 0] * y - along_path[..., 1] * x
        within = np.minimum(np.maximum(along, least), most)
        beyond = along - within
        squared = across * across + beyond * beyond
        # A later segment has to be clearly nearer.
        best, segment = squared[0].copy(), np.zeros(squared.shape[1:], np.intp)
        bound = np.empty_like(best)
        for i in range(1, 13):
            np.multiply(best, np.float32(1 - 1e-4), out=bound)
            bound -= np.float32(1e-5)
            nearer = squared[i] < bound
            np.copyto(best, squared[i], where=nearer)
            segment[nearer] = i

        def chosen(values):  # [N, 6, K, 3]
            values = np.broadcast_to(values, squared.shape)
            values = np.take_along_axis(values, segment[None], 0)[0]
            return values.reshape(scenes, -1, count, 3)

        offset, arc = chosen(across), chosen(within) + ARC_LENGTHS[segment].reshape(
            scenes, -1, count, 3
        )
        path_x, path_y = chosen(along_path[..., 0]), chosen(along_path[..., 1])
        own_x, own_y = direction[:, None, ..., 0], direction[:, None, ..., 1]
        pairs = np.zeros((scenes, paths.shape[1], count, PAIR_NUMBERS), np.float32)
        pairs[..., 0:3] = np.clip(offset / 3, -2, 2)
        pairs[..., 3:6] = np.exp(-np.sqrt(best)).reshape(scenes, -1, count, 3)
        pairs[..., 6:9] = path_x * own_y - path_y * own_x
        pairs[..., 9] = (path_x * own_x + path_y * own_y)[..., 2]
        pairs[..., 10] = arc[..., 2] / 50
        pairs[..., 11] = paths[:, :, None, 65] - pairs[..., 10]
        leader = paths[:, :, None, None, 69] > 0.5
        gap = paths[..., None, 70:71] * 30 + paths[..., None, 71:72] * 10 * self.times - arc
        pairs[..., 12:15] = np.where(leader, np.clip(gap / 10, -2, 3), 0)
        pairs[..., 15] = leader[..., 0]
        stop = paths[..., None, 82:83] * 30 - arc[..., ::2]
        pairs[..., 16:18] = np.where(
            paths[:, :, None, None, 81] > 0.5, np.clip(stop / 10, -2, 2), 0
        )
        pairs *= (np.arange(paths.shape[1]) < counts[:, None])[..., None, None]
        return pairs.transpose(0, 2, 1, 3)

    @staticmethod
    def _polylines(paths):
        """Starts and directions [13, N, 6, 1, 2] of a path's segments, and between which metres
        from its start each lies [13, N, 6, 1]."""
        points = paths[..., :26].reshape(*paths.shape[:2], 13, 2) * POINT_SCALES[:, None]
        # From the first point back, in the mean of the headings there and at the foot.
        back = np.stack((paths[..., 64] + paths[..., 26], paths[..., 39] - paths[..., 63]), 2)
        back /= np.maximum(np.linalg.norm(back, axis=2, keepdims=True), 1e-3)
        foot = points[:, :, 0] - 2.5 * back
        points = np.concatenate((foot[:, :, None], points), 2)
        step = np.diff(points, axis=2)
        length = np.sqrt((step * step).sum(3))
        directed = length >= 1e-3
        direction = step / np.where(directed, length, 1.0)[..., None]
        direction = np.where(directed[..., None], direction, np.array([1, 0], np.float32))
        least = np.zeros_like(length)
        least[..., 0] = -BEYOND
        length[..., -1] = BEYOND

        def first(values):
            return np.ascontiguousarray(np.moveaxis(values, 2, 0))

        return (
            first(points[:, :, :13])[:, :, :, None],
            first(direction)[:, :, :, None],
            first(least)[..., None],
            first(length)[..., None],
        )
