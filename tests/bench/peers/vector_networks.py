"""A stored model's networks in PyTorch, for models that read vectors and no raster.

The names and shapes of the weights, and the formulas, are in model/artifact/tensor.h.
"""

import json
import os

import torch
from torch.nn.functional import linear

from networks import read_safetensors

SPEED_BINS = torch.tensor([0.5, 2.0, 5.0, 10.0, 15.0], dtype=torch.float64)
LEAST_LOG_STDDEV, MOST_LOG_STDDEV = -3.0, 4.0


def relu(x):
    return torch.relu_(x)


class VectorNetworks:
    """p(y|s), q(z|y,s) and p(x|z,y,s). Evaluates N targets at once, and describes B actions at
    once, each of one of the targets."""

    def __init__(self, folder):
        with open(os.path.join(folder, "model.json"), encoding="utf-8") as file:
            self.spec = spec = json.load(file)["spec"]
        needed = ("scene_vectors", "action_geometry", "mean_residual", "scene_covariance")
        if "raster" in spec or not all(spec.get(part) for part in needed):
            raise SystemExit("only models of the presets lanes and lanes-metres are supported")
        if len(spec["scenario_encoder"]["hidden"]) != 1:
            raise SystemExit("scenario encoders must have one hidden layer")
        if len(spec["scene_covariance"]["hidden"]) != 1:
            raise SystemExit("covariance networks must have one hidden layer")
        self.weights = w = read_safetensors(os.path.join(folder, "weights.safetensors"))
        self.actions, self.latent = spec["actions"], spec["latent_dimensions"]
        self.waypoints = spec["trajectory"]["waypoints"]
        self.interval = float(spec["trajectory"]["waypoint_interval"].rstrip("s"))
        vectors = spec["scene_vectors"]
        self.path_heads = vectors["attention_heads"]
        self.agent_heads = vectors["agent_heads"]
        self.pair_heads = spec["action_geometry"]["attention_heads"]
        # Everything that reads the scene's features, as one layer.
        parts = [
            (w["action_predictor.0.weight"], w["action_predictor.0.bias"]),
            (w["action_geometry.scene.weight"], None),
            (w["action_geometry.joint_scene.weight"], None),
            (w["scenario_encoder.0.weight"].flatten(0, 1), w["scenario_encoder.0.bias"].flatten()),
            (w["scene_covariance.0.weight"].flatten(0, 1), w["scene_covariance.0.bias"].flatten()),
            (w["mean_residual.scene.weight"].flatten(0, 1), None),
        ]
        self.of_scene = torch.cat([weight for weight, _ in parts])
        self.of_scene_bias = torch.cat(
            [torch.zeros(len(weight)) if bias is None else bias for weight, bias in parts]
        )
        self.of_scene_sizes = [len(weight) for weight, _ in parts]
        self.mixture_stddev = (0.5 * w["mixture.log_variance"].double()).exp()
        self.mixture_mean = w["mixture.mean"].double()
        self.mixture_log_variance = w["mixture.log_variance"].double()
        self.trajectory_mean = w["trajectory.mean"].double().flatten()
        self.trajectory_stddev = w["trajectory.stddev"].double().flatten()
        self.speed_factor = w["scene_covariance.speed_factor"].double()
        times = self.interval * torch.arange(1, self.waypoints + 1, dtype=torch.float64)
        share = 2.0 * times / times[-1]
        self.terms = torch.stack(
            (torch.ones_like(times), share.log(), share - 1.0, (-times).exp()), 1
        )
        with torch.inference_mode():
            self.generic = self.decode(w["mixture.mean"]).unflatten(1, (-1, 2)).numpy()

    def _layer(self, name, x):
        return linear(x, self.weights[name + ".weight"], self.weights.get(name + ".bias"))

    def _layers(self, name, x, first=0):
        """A stack of layers with ReLU between them."""
        i = first
        while True:
            x = self._layer(f"{name}.{i}", x)
            i += 1
            if f"{name}.{i}.weight" not in self.weights:
                return x
            x = relu(x)

    @staticmethod
    def _pool(elements, scores, mask):
        """What is kept of sets [.., I, W] of which those of mask [.., I] are there."""
        elements = elements * mask.unsqueeze(-1)
        share = torch.softmax(scores.masked_fill_(~mask.unsqueeze(-1), -1e9), -2)
        heads = share.shape[-1]
        attended = elements.unflatten(-1, (heads, -1)) * share.unsqueeze(-1)
        return attended.sum(-3).flatten(-2), elements.amax(-2)

    def _set(self, name, numbers, mask, own):
        x = self._layers(name, numbers) + self._layer(name + ".history", own).unsqueeze(1)
        x = relu(self._layer(name + ".output", relu(x)))
        return x, self._pool(x, self._layer(name + ".attention", x), mask)

    def encode(self, history, paths, path_mask, agents, agent_mask, pairs, numbers):
        """p(y|s) [N, K] in f64, and what describe() needs of the scenes."""
        own = relu(self._layers("history", history))
        path, pooled_paths = self._set("lane_path", paths, path_mask, own)
        _, pooled_agents = self._set("agent", agents, agent_mask, own)
        joined = torch.cat((own, *pooled_paths, *pooled_agents), 1)
        features = relu(self._layer("join", joined))
        hidden, scene, joint_scene, encoder, covariance, residual = linear(
            features, self.of_scene, self.of_scene_bias
        ).split(self.of_scene_sizes, 1)
        # Actions held against the lane paths.
        x = self._layer("action_geometry.pair", pairs)
        x += (self._layer("action_geometry.path", path) + scene.unsqueeze(1)).unsqueeze(1)
        x += self.weights["action_geometry.action.bias"].unsqueeze(1)
        x = relu(self._layer("action_geometry.hidden", relu(x)))
        scores = self._layer("action_geometry.attention", x)
        pooled = self._pool(x, scores, path_mask.unsqueeze(1).expand(-1, self.actions, -1))
        x = self._layer("action_geometry.joint", torch.cat((*pooled, numbers), 2))
        x += joint_scene.unsqueeze(1)
        x += self.weights["action_geometry.joint_action.bias"]
        geometry = relu(self._layer("action_geometry.output", relu(x)))
        logits = self._layers("action_predictor", relu(hidden), 1)
        logits = logits + self._layer("action_geometry.logit", geometry).squeeze(2)
        scenes = (
            relu(encoder.unflatten(1, (self.actions, -1))),
            relu(covariance.unflatten(1, (self.actions, -1))),
            residual.unflatten(1, (self.actions, -1)),
            geometry,
        )
        return torch.softmax(logits.double(), 1), scenes

    def decode(self, latents):
        """Trajectories [.., 2T] of latents [.., D], metres, without reference and residual, f64."""
        x = self._layers("decoder", latents).double()
        return x * self.trajectory_stddev + self.trajectory_mean

    def describe(self, scenes, target, action, reference, speed):
        """What actions [B] of targets [B] look like in the target's frame: latent mean and
        deviation [B, D], sigma trajectories [B, 2D+1, T, 2], mean [B, T, 2], covariance [B, T, 3].

        reference: [N, T, 2]; speed: [N]; both f64"""
        encoder, covariance, residual, geometry = (part[target, action] for part in scenes)
        w = self.weights
        column = geometry.unsqueeze(2)
        x = torch.baddbmm(
            w["scenario_encoder.1.bias"][action].unsqueeze(2),
            w["scenario_encoder.1.weight"][action],
            encoder.unsqueeze(2),
        )
        x = torch.baddbmm(x, w["action_geometry.latent.weight"][action], column)
        a, b = x.squeeze(2).double().split(self.latent, 1)
        mean = self.mixture_mean[action] + self.mixture_stddev[action] * a
        stddev = (0.5 * (self.mixture_log_variance[action] + b)).exp()
        steps = torch.diag_embed(stddev)  # [B, D, D]
        center = mean.unsqueeze(1)
        points = torch.stack((center + steps, center - steps), 2).flatten(1, 2)
        points = torch.cat((center, points), 1).float()
        residual = torch.baddbmm(
            residual.unsqueeze(2), w["mean_residual.geometry.weight"][action], column
        ).squeeze(2)
        shift = linear(residual, w["mean_residual.curves"]).double()
        shift = shift + reference.flatten(1)[target]
        sigma = self.decode(points) + shift.unsqueeze(1)
        sigma = sigma.unflatten(2, (-1, 2))
        plus, minus = sigma[:, 1::2], sigma[:, 2::2]
        moment = sigma[:, 0] + 0.5 * (plus - 2 * sigma[:, :1] + minus).sum(1)
        half = 0.5 * (plus - minus)
        spread = torch.stack(
            (half[..., 0] ** 2, half[..., 0] * half[..., 1], half[..., 1] ** 2), 3
        ).sum(1)
        covariance = spread + self._own(covariance, action, moment, speed[target])
        return mean, stddev, sigma, moment, covariance

    def _own(self, hidden, action, mean, speed):
        """The covariance [B, T, 3] that the scene predicts, along and across the mean."""
        w = self.weights
        numbers = torch.baddbmm(
            w["scene_covariance.1.bias"][action].unsqueeze(2),
            w["scene_covariance.1.weight"][action],
            hidden.unsqueeze(2),
        )
        log_stddev = numbers.double().view(-1, 2, 4) @ self.terms.T  # [B, 2, T]
        variance = (2 * log_stddev.clamp(LEAST_LOG_STDDEV, MOST_LOG_STDDEV)).exp()
        bins = torch.bucketize(speed.abs(), SPEED_BINS, right=True)
        along, across = (variance * self.speed_factor[bins].unsqueeze(2)).unbind(1)
        x, y = self._directions(mean).unbind(2)
        return torch.stack(
            (
                along * x * x + across * y * y,
                (along - across) * x * y,
                along * y * y + across * x * x,
            ),
            2,
        )

    def _directions(self, mean):
        """Where a mean [B, T, 2] heads, over 0.2 s before and after each waypoint."""
        half = round(0.2 / self.interval)
        index = torch.arange(self.waypoints)
        first = (index - half).clamp(min=0)
        last = (index + half).clamp(max=self.waypoints - 1)
        known = torch.cat((torch.zeros_like(mean[:, :1]), mean), 1)
        step = (known[:, last + 1] - known[:, first]) / (last - first + 1).unsqueeze(1)
        length = (step * step).sum(2, keepdim=True).sqrt_()
        slow = length < 0.5 * self.interval
        ahead = torch.tensor([1.0, 0.0], dtype=step.dtype)
        return torch.where(slow, ahead, step / length.clamp(min=1e-9))
