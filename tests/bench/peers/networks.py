"""A stored model's networks in PyTorch, from model.json and weights.safetensors alone."""

import json
import os
import struct

import numpy as np
import torch
from torch import nn


def read_safetensors(path):
    """The tensors of a file, by name."""
    with open(path, "rb") as file:
        (size,) = struct.unpack("<Q", file.read(8))
        header = json.loads(file.read(size))
        data = file.read()
    tensors = {}
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        begin, end = entry["data_offsets"]
        values = np.frombuffer(data[begin:end], dtype="<f4").reshape(entry["shape"])
        tensors[name] = torch.from_numpy(values.copy())
    return tensors


def mlp(widths):
    layers = []
    for i, (inputs, outputs) in enumerate(zip(widths, widths[1:])):
        layers.append(nn.Linear(inputs, outputs))
        if i + 2 < len(widths):
            layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers)


def convolution(inputs, outputs, kernel, stride):
    return nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)


class Block(nn.Module):
    """A residual block as torchvision has them."""

    def __init__(self, inputs, width, stride, bottleneck):
        super().__init__()
        outputs = 4 * width if bottleneck else width
        shapes = (
            [(inputs, width, 1, 1), (width, width, 3, stride), (width, outputs, 1, 1)]
            if bottleneck
            else [(inputs, width, 3, stride), (width, width, 3, 1)]
        )
        self.convolution = nn.ModuleList(convolution(*shape) for shape in shapes)
        self.normalization = nn.ModuleList(nn.BatchNorm2d(shape[1]) for shape in shapes)
        self.shortcut = nn.ModuleDict()
        if stride != 1 or inputs != outputs:
            self.shortcut["convolution"] = convolution(inputs, outputs, 1, stride)
            self.shortcut["normalization"] = nn.BatchNorm2d(outputs)
        self.outputs = outputs

    def forward(self, x):
        y = x
        for i, (convolve, normalize) in enumerate(zip(self.convolution, self.normalization)):
            y = normalize(convolve(y))
            if i + 1 < len(self.convolution):
                y = torch.relu(y)
        if len(self.shortcut) > 0:
            x = self.shortcut["normalization"](self.shortcut["convolution"](x))
        return torch.relu(x + y)


class Backbone(nn.Module):
    """Names its parts as the file does: see model/artifact/tensor.h."""

    def __init__(self, spec):
        super().__init__()
        raster, backbone = spec["raster"], spec["backbone"]
        channels = 3 + 2 * raster["history_frames"]
        height, width = raster["height"], raster["width"]
        self.convolution = nn.ModuleList()
        self.normalization = nn.ModuleList()
        self.stem = nn.ModuleDict()
        self.stage = nn.ModuleList()
        self.max_pool = None
        if "residual" in backbone:
            residual = backbone["residual"]
            stem = residual["stem"]
            self.stem["convolution"] = convolution(
                channels, stem["channels"], stem["kernel_size"], stem["stride"]
            )
            self.stem["normalization"] = nn.BatchNorm2d(stem["channels"])
            if stem.get("max_pool"):
                self.max_pool = nn.MaxPool2d(3, 2, 1)
            channels = stem["channels"]
            bottleneck = residual["block"] == "RESIDUAL_BLOCK_BOTTLENECK"
            for stage in residual["stages"]:
                blocks = nn.ModuleList()
                for i in range(stage["blocks"]):
                    stride = stage["stride"] if i == 0 else 1
                    blocks.append(Block(channels, stage["width"], stride, bottleneck))
                    channels = blocks[-1].outputs
                self.stage.append(nn.ModuleDict({"block": blocks}))
            height = width = 1
        else:
            for layer in backbone["convolutions"]:
                stride = layer["stride"]
                self.convolution.append(convolution(channels, layer["channels"], 3, stride))
                self.normalization.append(nn.BatchNorm2d(layer["channels"]))
                channels = layer["channels"]
                height, width = (height - 1) // stride + 1, (width - 1) // stride + 1
        self.projection = nn.Linear(channels * height * width, backbone["features"])

    def forward(self, x):
        if len(self.stem) > 0:
            x = torch.relu(self.stem["normalization"](self.stem["convolution"](x)))
            if self.max_pool is not None:
                x = self.max_pool(x)
            for stage in self.stage:
                for block in stage["block"]:
                    x = block(x)
            x = x.mean((2, 3), keepdim=True)
        for convolve, normalize in zip(self.convolution, self.normalization):
            x = torch.relu(normalize(convolve(x)))
        return torch.relu(self.projection(x.flatten(1)))


class Networks(nn.Module):
    """p(y|s), q(z|y,s) and p(x|z)."""

    def __init__(self, folder):
        super().__init__()
        with open(os.path.join(folder, "model.json"), encoding="utf-8") as file:
            spec = json.load(file)["spec"]
        weights = read_safetensors(os.path.join(folder, "weights.safetensors"))
        self.spec = spec
        self.actions = spec["actions"]
        self.latent = spec["latent_dimensions"]
        self.waypoints = spec["trajectory"]["waypoints"]
        self.motion = spec.get("target_motion", False)
        features = spec["backbone"]["features"] + (4 if self.motion else 0)

        def widths(name):
            return spec.get(name, {}).get("hidden", [])

        self.backbone = Backbone(spec)
        self.action_predictor = mlp([features, *widths("action_predictor"), self.actions])
        self.decoder = mlp([self.latent, *widths("decoder"), 2 * self.waypoints])
        # The K encoders side by side, evaluated as batched products.
        self.encoder_weights, self.encoder_biases = [], []
        layer = 0
        while f"scenario_encoder.{layer}.weight" in weights:
            self.encoder_weights.append(
                weights[f"scenario_encoder.{layer}.weight"].transpose(1, 2).contiguous()
            )
            self.encoder_biases.append(weights[f"scenario_encoder.{layer}.bias"])
            layer += 1
        self.mixture_mean = weights["mixture.mean"]
        self.mixture_stddev = (0.5 * weights["mixture.log_variance"]).exp()
        self.covariance_network = None
        if widths("decoder_covariance"):
            self.decoder_covariance = mlp(
                [self.latent, *widths("decoder_covariance"), 3 * self.waypoints]
            )
            self.covariance_network = self.decoder_covariance
        else:
            self.covariance_table = weights["decoder.covariance"]
        self.trajectory_mean = weights["trajectory.mean"].flatten()
        self.trajectory_stddev = weights["trajectory.stddev"].flatten()
        state = {
            name: self._stored(name, weights) for name in self.state_dict() if "num_batches" not in name
        }
        self.load_state_dict(state, strict=False)
        self.eval()

    @staticmethod
    def _stored(name, weights):
        parts = name.split(".")
        if parts[0] in ("action_predictor", "decoder", "decoder_covariance"):
            parts[1] = str(int(parts[1]) // 2)  # ReLUs have a number of their own in a Sequential
        return weights[".".join(parts)]

    def encode(self, raster, motion):
        """Features, and p(y|s). raster: [N, C, H, W] of 0 to 1."""
        features = self.backbone(raster)
        if self.motion:
            features = torch.cat((features, motion), 1)
        return features, torch.softmax(self.action_predictor(features), 1)

    def forward(self, raster, motion):
        return self.encode(raster, motion)[1]

    def covariance(self, actions, mean):
        """What p(x|z) adds to the moments, [A, T, 3] xx, xy, yy."""
        if self.covariance_network is None:
            return self.covariance_table[actions]
        a, b, c = self.covariance_network(mean).unflatten(1, (self.waypoints, 3)).unbind(2)
        a, b = a.clamp(-3, 4).exp(), b.clamp(-3, 4).exp()
        c = c * b
        return torch.stack((a * a, a * c, c * c + b * b), 2)

    def describe(self, features, actions):
        """Latent mean and deviation [A, D] of actions [A], sigma trajectories [A, 2D+1, T, 2] and
        the decoder's covariances [A, T, 3]."""
        x = features.expand(len(actions), 1, -1)
        for i, (weight, bias) in enumerate(zip(self.encoder_weights, self.encoder_biases)):
            x = torch.baddbmm(bias[actions].unsqueeze(1), x, weight[actions])
            if i + 1 < len(self.encoder_weights):
                x = torch.relu(x)
        a, b = x.squeeze(1).split(self.latent, 1)
        stddev = self.mixture_stddev[actions]
        mean = self.mixture_mean[actions] + stddev * a
        stddev = stddev * (0.5 * b).exp()
        steps = torch.diag_embed(stddev)  # [A, D, D]
        points = torch.stack((mean.unsqueeze(1) + steps, mean.unsqueeze(1) - steps), 2)
        points = torch.cat((mean.unsqueeze(1), points.flatten(1, 2)), 1)
        metres = self.decoder(points) * self.trajectory_stddev + self.trajectory_mean
        sigma = metres.unflatten(2, (self.waypoints, 2))
        return mean, stddev, sigma, self.covariance(actions, mean)
