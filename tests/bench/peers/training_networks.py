"""What a model learns in the joint phase, with gradients, in PyTorch: the unified bound of
model/learning/objectives.h over the networks of a model folder."""

import math
import os

import torch
from torch import nn
from torch.nn.functional import linear, log_softmax

from networks import Networks, mlp, read_safetensors

# Of the preset compact: see model/artifact/training_presets.cc.
DROPOUT = 0.2
ACTION_WEIGHT = 5.0
RECONSTRUCTION_WEIGHT = 0.05


def divergence(mean_q, log_variance_q, mean_p, log_variance_p):
    """KL(q || p) over the last dimension."""
    offset = (mean_q - mean_p).square() * (-log_variance_p).exp()
    ratio = (log_variance_q - log_variance_p).exp()
    return 0.5 * (log_variance_p - log_variance_q + ratio + offset - 1).sum(-1)


def cross_entropy(mean_q, log_variance_q, mean_p, log_variance_p):
    """H(q, p) over the last dimension."""
    spread = log_variance_q.exp() + (mean_q - mean_p).square()
    return 0.5 * (math.log(2 * math.pi) + log_variance_p + spread * (-log_variance_p).exp()).sum(-1)


def sample(mean, log_variance):
    return mean + (0.5 * log_variance).exp() * torch.randn_like(mean)


class TrainingNetworks(nn.Module):
    """Networks in training mode, with the encoder of trajectories and the mixture."""

    def __init__(self, folder):
        super().__init__()
        stored = read_safetensors(os.path.join(folder, "weights.safetensors"))
        networks = Networks(folder)
        self.motion, self.actions = networks.motion, networks.actions
        self.stddev = networks.spec["decoder_stddev"]
        self.backbone, self.action_predictor = networks.backbone, networks.action_predictor
        self.encoder_weights = nn.ParameterList(
            nn.Parameter(weight.transpose(1, 2).contiguous()) for weight in networks.encoder_weights
        )
        self.encoder_biases = nn.ParameterList(map(nn.Parameter, networks.encoder_biases))
        self.mixture_mean = nn.Parameter(stored["mixture.mean"])
        self.mixture_log_variance = nn.Parameter(stored["mixture.log_variance"])
        hidden = networks.spec["trajectory_encoder"].get("hidden", [])
        self.trajectory_encoder = mlp([2 * networks.waypoints, *hidden, 2 * networks.latent])
        self.trajectory_encoder.load_state_dict(
            {
                f"{2 * i}.{tensor}": stored[f"trajectory_encoder.{i}.{tensor}"]
                for i in range(len(hidden) + 1)
                for tensor in ("weight", "bias")
            }
        )
        self.register_buffer("mean", networks.trajectory_mean)
        self.register_buffer("deviation", networks.trajectory_stddev)
        # Learned are the coefficients of a few smooth curves; the folder has their product with them.
        self.decoder = networks.decoder
        last = self.decoder[-1]
        with torch.no_grad():
            curves, sizes, rows = torch.linalg.svd(
                networks.trajectory_stddev.unsqueeze(1) * last.weight, full_matrices=False
            )
            count = int((sizes > 1e-5 * sizes[0]).sum())
            curves = curves[:, :count].contiguous()
            self.decoder[-1] = nn.Linear(last.in_features, count)
            self.decoder[-1].weight.copy_(sizes[:count, None] * rows[:count])
            self.decoder[-1].bias.copy_(curves.t() @ (networks.trajectory_stddev * last.bias))
        self.register_buffer("curves", curves)
        self.to(memory_format=torch.channels_last).train()

    def decode(self, latents):
        """Metres, [..., 2T]."""
        return linear(self.decoder(latents), self.curves, self.mean)

    def encode_scenarios(self, features):
        """Mean and log variance of q(z|y,s), each [B, K, D]."""
        last = len(self.encoder_weights) - 1
        for i, (weight, bias) in enumerate(zip(self.encoder_weights, self.encoder_biases)):
            if i == 0:  # all read the same features: one product for all of them
                x = linear(features, weight.flatten(0, 1), bias.flatten())
                x = x.unflatten(1, bias.shape).transpose(0, 1)
            else:
                x = torch.baddbmm(bias.unsqueeze(1), x, weight.transpose(1, 2))
            if i < last:
                x = x.relu()
        a, b = x.transpose(0, 1).chunk(2, -1)
        mean, log_variance = self.mixture_mean.detach(), self.mixture_log_variance.detach()
        return mean + (0.5 * log_variance).exp() * a, log_variance + b

    def log_likelihood(self, x, decoded):
        normalizer = x.shape[-1] * (0.5 * math.log(2 * math.pi) + math.log(self.stddev))
        return (x - decoded).square().sum(-1) * (-0.5 / self.stddev**2) - normalizer

    def loss(self, raster, motion, x):
        """raster: [B, C, H, W] of 0 to 1; x: [B, 2T] metres."""
        features = nn.functional.dropout(self.backbone(raster), DROPOUT)
        if self.motion:
            features = torch.cat((features, motion), 1)
        posterior = self.encode_scenarios(features)
        posterior_decoded = self.decode(sample(*posterior))
        encoded = self.trajectory_encoder((x - self.mean) / self.deviation).chunk(2, -1)
        decoded = self.decode(sample(*encoded))
        log_p_y = log_softmax(self.action_predictor(features), 1)

        mixture = (self.mixture_mean, self.mixture_log_variance)
        q_z = [values.unsqueeze(1) for values in encoded]
        posterior_divergence = divergence(*posterior, *mixture)
        with torch.no_grad():  # responsibilities, held fixed
            log_q_y = log_softmax(
                log_p_y - cross_entropy(*q_z, *mixture) - posterior_divergence, 1
            )
            q_y = log_q_y.exp()
        posterior_likelihood = self.log_likelihood(x.unsqueeze(1), posterior_decoded)
        return (
            (q_y * divergence(*q_z, *mixture)).sum(1)
            + ACTION_WEIGHT * (q_y * (log_q_y - log_p_y)).sum(1)
            - self.log_likelihood(x, decoded)
            - RECONSTRUCTION_WEIGHT * (q_y * posterior_likelihood).sum(1)
            + (q_y * posterior_divergence).sum(1)
        ).mean()

    def groups(self, rate, latent_rate, decay):
        """Of parameters, for AdamW: vectors do not decay, latents learn more slowly."""
        groups = {}
        for name, parameter in self.named_parameters():
            is_latent = name.split(".")[0] in ("trajectory_encoder", "decoder") or "mixture" in name
            key = (is_latent, parameter.dim() > 1)
            groups.setdefault(key, []).append(parameter)
        return [
            {
                "params": parameters,
                "lr": latent_rate if is_latent else rate,
                "weight_decay": decay if is_matrix else 0.0,
            }
            for (is_latent, is_matrix), parameters in groups.items()
        ]
