"""FusionNet: features of several senses, concatenated and classified together."""

from collections.abc import Iterable, Sequence
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import (
    Head,
    Level,
    independent_copy,
    initialise_scores,
    score_layer_of,
    shared_copy,
)


class FusionLayer(nn.Module):
    """Sum of partial logits, one part for each sense (paper, section "FusionNet").

    One 1x1 convolution over the concatenated features is a sum with a part for each sense:
    W [f_h; f_v] + b = W_h f_h + (W_v f_v + b). Each part is computed once per position, so that a
    thousand sampled tuples cost a thousand additions.

    Whether the paper fuses FC3 before or after softmax is open; here it is before, where a linear
    layer loses nothing. A network that has no ``score_layer`` is fused on its class scores at
    either level.

    Args:
        *networks: One for each sense, with their score layers; none is kept.
        classes: Number of materials.
        level: Layer whose features are fused.

    Attributes:
        levels: The layer of each sense that is fused.
        sizes: Number of features of each sense.
        head: The linear layer.
    """

    def __init__(self, *networks: nn.Module, classes: int, level: Level = "fc2") -> None:
        super().__init__()
        self.classes = classes
        layers = [score_layer_of(network) for network in networks]
        self.levels: list[Level] = ["fc3" if layer is None else level for layer in layers]
        self.sizes = [
            classes if layer is None else layer.weight.shape[fused == "fc2"]
            for fused, layer in zip(self.levels, layers, strict=True)
        ]
        self.head = nn.Linear(sum(self.sizes), classes)
        initialise_scores(self.head)

    def remove_scores(self, networks: Iterable[nn.Module]) -> None:
        """Remove FC3 and its dropout from built-in networks that are fused on FC2."""
        for network, level in zip(networks, self.levels, strict=True):
            head = getattr(network, "head", None)
            if level == "fc2" and isinstance(head, Head):
                head.scores = nn.Identity()

    def fuse(self, parts: Sequence[Tensor], tuples: Tensor | None = None) -> Tensor:
        """Return the class scores (B, classes, P) of tuples of positions.

        Args:
            parts: Partial logits (B, classes, positions) of each sense.
            tuples: (P, senses), int64; each row holds a position of each sense, positions of an
                image counted row by row. None, for training, takes the only one there is.

        Raises:
            ValueError: ``tuples`` is None but a sense has more than one position.
        """
        if tuples is not None:
            parts = [part[..., tuples[:, index]] for index, part in enumerate(parts)]
        elif any(part.shape[-1] != 1 for part in parts):
            counts = " and ".join(str(part.shape[-1]) for part in parts)
            raise ValueError(
                f"tuples is needed for {counts} positions; without it every input must give one."
            )
        first, *others = parts
        return sum(others, first)

    def project(self, index: int, features: Tensor) -> Tensor:
        """Return partial logits (B, classes, L) from features (B, D, L) of the sense ``index``."""
        weight = torch.split(self.head.weight, self.sizes, dim=1)[index]
        partial_logits = torch.matmul(weight, features)
        if index == len(self.sizes) - 1:
            partial_logits = partial_logits + self.head.bias[:, None]
        return partial_logits

    @torch.no_grad()
    def start_from_scores(self, *networks: nn.Module) -> None:
        """Set the head to the sum of the class scores of trained networks.

        Given the class, what the senses say is independent, so that their probabilities multiply
        and their scores add. Fusion then begins with what all networks know, weighted by how sure
        they are, and need not learn it anew from samples that all have seen and find equally easy.

        Args:
            *networks: Those of all senses, with their score layers.
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
    def of(self, indices: Sequence[int]) -> "FusionLayer":
        """Return the layer of some of the senses, by their numbers.

        Only the last sense adds the bias; without that sense the bias is zero.
        """
        part = deepcopy(self)
        columns = torch.split(self.head.weight, self.sizes, dim=1)
        part.levels = [self.levels[index] for index in indices]
        part.sizes = [self.sizes[index] for index in indices]
        weight = torch.cat([columns[index] for index in indices], dim=1)
        part.head.weight = nn.Parameter(weight, self.head.weight.requires_grad)
        if len(self.sizes) - 1 not in indices:
            part.head.bias.zero_()
        return part


@torch.no_grad()
def scored_by(network: Any, layer: nn.Linear) -> nn.Module:  # noqa: ANN401
    """Return a copy of a network whose score layer is the fusion layer of its sense alone.

    A network of this package gets a new score layer and shares all others with the original. A
    user's network is copied as a whole, since its score layer may be anywhere in it.
    """
    if isinstance(getattr(network, "head", None), Head):
        copy: Any = shared_copy(network, head=shared_copy(network.head))
        copy.head.restore_scores(layer.weight.shape[1], layer.weight.shape[0])
    else:
        copy = independent_copy(network)
    scores = copy.score_layer.to(layer.weight)  # its device and type
    scores.weight.copy_(layer.weight.reshape(scores.weight.shape))
    scores.bias.copy_(layer.bias)
    scores.requires_grad_(layer.weight.requires_grad)
    made: nn.Module = copy
    return made


def bounded(partial_logits: Tensor, error: Tensor) -> Tensor:
    """Bound what the partial logits (classes, positions) of a sense can decide by its error.

    Their mean becomes the logarithm of its probabilities, a share ``error`` of which is spread over
    all classes. So a sense that is sure outvotes no other that errs less, and the positions differ
    as before.
    """
    mean = partial_logits.mean(dim=1, keepdim=True)
    probabilities = (1 - error) * mean.softmax(dim=0) + error / len(partial_logits)
    return partial_logits - mean + probabilities.log()


class FusionNet(FusionLayer):
    """Classify tuples of positions, one of each sense: the networks and their fusion layer.

    At level "fc2" the FC3 layers of the networks and their dropout do not exist.

    Args:
        *networks: Network of each sense, with pretrained or random weights; they are copied. The
            paper fuses a HapticNet and a VisualNet.
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
        super().__init__(*networks, classes=classes, level=level)
        self.networks = nn.ModuleList(map(deepcopy, networks))
        self.remove_scores(self.networks)

    def forward(self, *inputs: Tensor, tuples: Tensor | None = None) -> Tensor:
        """Return class scores before softmax, (B, classes, P).

        Args:
            *inputs: Network input of each sense.
            tuples: Tuples of positions, see :meth:`fuse`.
        """
        return self.fuse(self.parts(*inputs), tuples)

    def parts(self, *inputs: Tensor) -> list[Tensor]:
        """Return partial logits (B, classes, positions) of each sense, the last with the bias."""
        partials = []
        for index, x in enumerate(inputs):
            network: Any = self.networks[index]
            partials.append(self.project(index, network.features(x, self.levels[index]).flatten(2)))
        return partials
