"""FusionNet: features of several senses, concatenated and classified together."""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import Level, initialise_scores, score_layer_of


class FusionNet(nn.Module):
    """Classify tuples of positions, one of each sense (paper, section "FusionNet").

    One 1x1 convolution over the concatenated features is a sum with a part for each sense:
    W [f_h; f_v] + b = W_h f_h + (W_v f_v + b). Each part is computed once per position, so that a
    thousand sampled tuples cost a thousand additions.

    Whether the paper fuses FC3 before or after softmax is open; here it is before, where a linear
    layer loses nothing. At level "fc2" the FC3 layers and their dropout do not exist; a network
    that has no ``score_layer`` is fused on its class scores at either level.

    Args:
        *networks: One for each sense, with pretrained or random weights; they are copied. The
            paper's are a HapticNet and a VisualNet.
        classes: Number of materials.
        level: Layer whose features are fused.

    Example:
        >>> import tex_lightning as tl, torch
        >>> from tex_lightning.networks.trunks.alexnet import CaffeAlexNet
        >>> visual = tl.VisualNet(3, CaffeAlexNet(width=0.1, norm="batch"))
        >>> haptic = tl.HapticNet(3, width=0.1)
        >>> network = tl.FusionNet(haptic, visual, classes=3).eval()
        >>> pairs = torch.tensor([[0, 0], [13, 27]])  # of positions
        >>> network(torch.rand(1, 1, 50, 400), torch.rand(1, 3, 300, 400), tuples=pairs).shape
        torch.Size([1, 3, 2])
    """

    def __init__(self, *networks: nn.Module, classes: int, level: Level = "fc2") -> None:
        super().__init__()
        self.level: Level = level
        self.classes = classes
        layers = [score_layer_of(network) for network in networks]
        self.levels: list[Level] = ["fc3" if layer is None else level for layer in layers]
        self.sizes = [
            classes if layer is None else layer.weight.shape[own == "fc2"]
            for own, layer in zip(self.levels, layers, strict=True)
        ]
        self.networks = nn.ModuleList(map(deepcopy, networks))
        for network, own in zip(self.networks, self.levels, strict=True):
            if own == "fc2" and hasattr(network, "head"):
                network.get_submodule("head").scores = nn.Identity()
        self.head = nn.Linear(sum(self.sizes), classes)
        initialise_scores(self.head)

    def forward(self, *inputs: Tensor, tuples: Tensor | None = None) -> Tensor:
        """Return class scores before softmax, (B, classes, P).

        Args:
            *inputs: One for each sense, as its network takes it.
            tuples: (P, senses), int64; each row holds a position of each sense, positions of an
                image counted row by row. None, for training, takes the only one there is.

        Raises:
            ValueError: ``tuples`` is None but the inputs have more than one position.
        """
        return self.fuse(self.parts(*inputs), tuples)

    def fuse(self, parts: Sequence[Tensor], tuples: Tensor | None = None) -> Tensor:
        """Return class scores (B, classes, P) of ``tuples`` of positions of the :meth:`parts`."""
        if tuples is not None:
            parts = [part[..., tuples[:, index]] for index, part in enumerate(parts)]
        elif any(part.shape[-1] != 1 for part in parts):
            counts = " and ".join(str(part.shape[-1]) for part in parts)
            raise ValueError(
                f"tuples is needed for {counts} positions; without it every input must give one."
            )
        total, *others = parts
        for part in others:
            total = total + part
        return total

    def parts(self, *inputs: Tensor) -> list[Tensor]:
        """Return the partial logits of the class scores for every position of every sense.

        Returns:
            One (B, classes, positions) for each sense, the last with the bias.
        """
        return [
            self.project(index, self.features(index, x).flatten(2))
            for index, x in enumerate(inputs)
        ]

    def features(self, index: int, x: Tensor) -> Tensor:
        """Return the features ``(B, D, *positions)`` of the sense at ``index`` that are fused."""
        network: Any = self.networks[index]
        found: Tensor = network.features(x, self.levels[index])
        return found

    def project(self, index: int, features: Tensor) -> Tensor:
        """Return partial logits (B, classes, L) from features (B, D, L) of the sense ``index``."""
        weight = torch.split(self.head.weight, self.sizes, dim=1)[index]
        partial_logits = torch.matmul(weight, features)
        return (
            partial_logits + self.head.bias[:, None]
            if index == len(self.sizes) - 1
            else partial_logits
        )

    @torch.no_grad()
    def start_from_scores(self, *networks: nn.Module) -> None:
        """Set the head to the sum of the class scores of trained networks.

        Given the class, what the senses say is independent, so that their probabilities multiply
        and their scores add. Fusion then begins with what all networks know, weighted by how sure
        they are, and need not learn it anew from samples that all have seen and find equally easy.

        Args:
            *networks: Those whose copies are in here, with their score layers.
        """
        weights, bias = [], torch.zeros_like(self.head.bias)
        for network, level in zip(networks, self.levels, strict=True):
            if level == "fc3":
                weights.append(torch.eye(self.classes).to(bias))
            else:
                layer: Any = network.score_layer
                weights.append(layer.weight.flatten(1))
                bias = bias + layer.bias
        self.head.weight.copy_(torch.cat(weights, dim=1))
        self.head.bias.copy_(bias)

    @torch.no_grad()
    def subset(self, indices: Sequence[int]) -> "FusionNet":
        """Return a FusionNet of some of the senses, for samples that lack the others."""
        chosen = nn.ModuleList(deepcopy(self.networks[index]) for index in indices)
        part = deepcopy(self, {id(self.networks): chosen})  # without a copy of the other networks
        columns = torch.split(self.head.weight, self.sizes, dim=1)
        part.levels = [self.levels[index] for index in indices]
        part.sizes = [self.sizes[index] for index in indices]
        part.head.weight = nn.Parameter(torch.cat([columns[index] for index in indices], dim=1))
        return part

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """Iterate over the parameters of all networks."""
        yield from self.networks.parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """Iterate over the parameters of the fusion layer, trained faster than the networks."""
        yield from self.head.parameters()
