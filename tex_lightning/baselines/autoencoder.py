"""Filters that a sparse auto-encoder learns from raw patches."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

STEPS = 200
BATCH = 256
LEARNING_RATE = 1e-2
WEIGHT_DECAY = 1.0  # lets the noise of the initial weights go
SPARSITY_WEIGHT = 1.0  # of the penalty, beside the squared error of the reconstruction


def learn_filters(
    traces: Sequence[Tensor], length: int, units: int, patches: int, sparsity: float
) -> Tensor:
    """Weights (units, length) of the encoder, by PyTorch's global generator.

    Hidden units are sigmoids of a linear layer, the decoder is linear, and the Kullback-Leibler
    divergence between ``sparsity`` and each unit's mean activation in a batch is a penalty (Ng
    2011). Patches have no mean and, but for silence, unit deviation.

    Args:
        traces: (samples,) each, at least ``length`` long.
        length: Length of a patch in samples.
        units: Hidden units.
        patches: How many patches are drawn, of all traces alike.
        sparsity: Mean activation to aim at, between 0 and 1.
    """
    data = draw_patches(traces, length, patches)
    encoder, decoder = nn.Linear(length, units), nn.Linear(units, length)
    parameters = [*encoder.parameters(), *decoder.parameters()]
    optimizer = torch.optim.AdamW(parameters, LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    for _ in range(STEPS):
        batch = data[torch.randint(len(data), (BATCH,))]
        hidden = encoder(batch).sigmoid()
        error = (decoder(hidden) - batch).square().mean()
        optimizer.zero_grad()
        (error + SPARSITY_WEIGHT * divergence(hidden.mean(dim=0), sparsity).mean()).backward()
        optimizer.step()
    return encoder.weight.detach()


def draw_patches(traces: Sequence[Tensor], length: int, count: int) -> Tensor:
    """Patches (count, length) from random places, with mean 0 and deviation 1."""
    pieces = []
    for _ in range(count):
        trace = traces[int(torch.randint(len(traces), ()))]
        start = int(torch.randint(len(trace) - length + 1, ()))
        pieces.append(trace[start : start + length])
    data = torch.stack(pieces)
    data = data - data.mean(dim=1, keepdim=True)
    deviation = data.std(dim=1, keepdim=True)
    return data / torch.where(deviation > 0, deviation, 1.0)


def divergence(activation: Tensor, sparsity: float) -> Tensor:
    """Kullback-Leibler divergence of Bernoulli variables, each activation from ``sparsity``."""
    activation = activation.clamp(1e-6, 1 - 1e-6)
    on = sparsity * torch.log(sparsity / activation)
    return on + (1 - sparsity) * torch.log((1 - sparsity) / (1 - activation))
