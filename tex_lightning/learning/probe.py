"""Train VisualNet's head on the features of a pretrained trunk, before both are trained together.

A head of random weights sends noise into a trunk that already knows images; training it first on
fixed features keeps them (Kumar et al. 2022, "Fine-tuning can distort pretrained features"). The
trunk runs once over every crop, and the head alone costs next to nothing.
"""

from collections.abc import Iterator
from typing import Any

import torch
from lightning.fabric.utilities import move_data_to_device
from torch import Tensor, nn

from tex_lightning.core.progress import track
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.visualnet import VisualNet

MIN_DEVIATION = 1e-3  # of a feature; one that hardly varies is not blown up


def probe_head(module: SurfaceModule, batches: Iterator[Any], count: int, seed: int) -> None:
    """Train FC1 to FC3 of ``module``'s network in place, on the device it is on.

    The features are standardised for this, which lets every one of them learn alike; the
    standardisation is folded into FC1 afterwards. AdamW, one cycle, the module's label smoothing.

    Args:
        module: With pretrained weights in the trunk.
        batches: Training batches.
        count: How many of them are taken.
        seed: Seed of dropout and of the order of the features.
    """
    recipe, head = module.fit_config["probe"], module.network.head
    inputs, labels = _features(module, batches, count)
    mean = inputs.mean(dim=(0, 2, 3), keepdim=True)
    std = inputs.std(dim=(0, 2, 3), keepdim=True) + MIN_DEVIATION
    inputs = (inputs - mean) / std
    torch.manual_seed(seed)
    rate, steps = recipe["learning_rate"], recipe["steps"]
    optimizer = torch.optim.AdamW(head.parameters(), lr=rate, weight_decay=1e-2)
    scheduler = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps)
    head.train()
    for _ in track(range(steps), "Head on fixed features"):
        chosen = torch.randint(len(inputs), (recipe["batch_size"],)).to(inputs.device)
        logits = head(inputs[chosen]).flatten(2)
        loss = nn.functional.cross_entropy(
            logits,
            labels[chosen, None].expand(-1, logits.shape[2]),
            label_smoothing=module.fit_config["label_smoothing"],
        )
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # no annotation in PyTorch
        optimizer.step()
        scheduler.step()
    _fold_standardisation(module.network, mean, std)


@torch.no_grad()
def _features(module: SurfaceModule, batches: Iterator[Any], count: int) -> tuple[Tensor, Tensor]:
    """Trunk features (crops, D, M, N) and labels (crops,) of ``count`` batches."""
    device = module.device
    features, labels = [], []
    module.eval()
    for _ in track(range(count), "Features of the pretrained trunk"):
        batch = move_data_to_device(next(batches), device)
        features.append(module.network.trunk(*module.inputs(batch)))
        labels.append(batch["label"])
    return torch.cat(features), torch.cat(labels)


@torch.no_grad()
def _fold_standardisation(network: VisualNet, mean: Tensor, std: Tensor) -> None:
    """Let FC1 take features as they come: w (x - m) / s + b = (w / s) x + (b - sum of w m / s)."""
    fc1 = network.fc1
    fc1.weight.div_(std)
    shift = (fc1.weight * mean).sum(dim=(1, 2, 3))
    if fc1.bias is not None:  # under batch normalisation a shift is subtracted again
        fc1.bias.sub_(shift)
