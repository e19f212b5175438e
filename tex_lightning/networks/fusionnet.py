"""FusionNet: haptic and visual features, concatenated and classified together."""

from collections.abc import Iterator
from copy import deepcopy
from typing import cast

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import Level, initialise_scores
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet


class FusionNet(nn.Module):
    """Classify pairs of a haptic and a visual position (paper, section "FusionNet").

    One 1x1 convolution over the concatenated features is the sum of a haptic and a visual part:
    W [f_h; f_v] + b = W_h f_h + (W_v f_v + b). Each part is computed once per position, so that a
    thousand sampled pairs cost a thousand additions.

    Whether the paper fuses FC3 before or after softmax is open; here it is before, where a linear
    layer loses nothing. At level "fc2" the FC3 layers and their dropout do not exist.

    Args:
        haptic: The haptic network, with pretrained or random weights; it is copied.
        visual: The visual network, with pretrained or random weights; it is copied.
        classes: Number of materials.
        level: Layer whose features are fused.

    Example:
        >>> import tex_lightning as tl, torch
        >>> from tex_lightning.networks.trunks.alexnet import CaffeAlexNet
        >>> visual = tl.VisualNet(3, CaffeAlexNet(width=0.1, norm="batch"))
        >>> haptic = tl.HapticNet(3, width=0.1)
        >>> network = tl.FusionNet(haptic, visual, classes=3).eval()
        >>> pairs = torch.tensor([[0, 0], [13, 27]])  # of positions
        >>> network(torch.rand(1, 1, 50, 400), torch.rand(1, 3, 300, 400), pairs).shape
        torch.Size([1, 3, 2])
    """

    def __init__(
        self, haptic: HapticNet, visual: VisualNet, *, classes: int, level: Level = "fc2"
    ) -> None:
        super().__init__()
        self.level: Level = level
        self.classes = classes
        self.haptic = deepcopy(haptic)
        self.visual = deepcopy(visual)
        if level == "fc2":
            self.haptic.head.scores = nn.Identity()
            self.visual.head.scores = nn.Identity()
        self.haptic_size = haptic.feature_size(level)
        self.head = nn.Linear(self.haptic_size + visual.feature_size(level), classes)
        initialise_scores(self.head)

    def forward(self, spectrogram: Tensor, image: Tensor, pairs: Tensor | None = None) -> Tensor:
        """Return class scores before softmax, (B, classes, P).

        Args:
            spectrogram: (B, 1, 50, T), as for HapticNet.
            image: (B, 3, H, W), as for VisualNet.
            pairs: (P, 2), int64; each row a haptic position below L and a visual position below
                M * N, row by row. None, for training, takes the only pair there is.

        Raises:
            ValueError: ``pairs`` is None but the inputs have more than one pair of positions.
        """
        return self.join(*self.parts(spectrogram, image), pairs)

    def join(self, haptic: Tensor, visual: Tensor, pairs: Tensor | None = None) -> Tensor:
        """Return class scores (B, classes, P) of ``pairs`` of the two :meth:`parts`."""
        if pairs is not None:
            return haptic[..., pairs[:, 0]] + visual[..., pairs[:, 1]]
        if haptic.shape[-1] != 1 or visual.shape[-1] != 1:
            raise ValueError(
                f"pairs is needed for {haptic.shape[-1]} haptic and {visual.shape[-1]} visual"
                " positions; without it both inputs must give one prediction."
            )
        return haptic + visual

    def parts(self, spectrogram: Tensor, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return the two summands of the class scores for every position.

        Returns:
            The haptic part (B, classes, L), and the visual part (B, classes, M * N), which holds
            the bias, with the positions row by row.
        """
        haptic = self.haptic.features(spectrogram, self.level)
        return self.project(haptic, self.visual.features(image, self.level).flatten(2))

    def project(self, haptic: Tensor, visual: Tensor) -> tuple[Tensor, Tensor]:
        """Return :meth:`parts` of haptic features (B, D, L) and visual ones (B, D, M * N)."""
        return self.project_haptic(haptic), self.project_visual(visual)

    def project_haptic(self, haptic: Tensor) -> Tensor:
        """Return the haptic summand (B, classes, L) of features (B, D, L)."""
        return torch.matmul(self.head.weight[:, : self.haptic_size], haptic)

    def project_visual(self, visual: Tensor) -> Tensor:
        """Return the visual summand (B, classes, M * N), with bias, of features (B, D, M * N)."""
        weight, bias = self.head.weight[:, self.haptic_size :], self.head.bias[:, None]
        return torch.matmul(weight, visual) + bias

    @torch.no_grad()
    def start_from_scores(self, haptic: HapticNet, visual: VisualNet) -> None:
        """Set the head to the sum of the class scores of two trained networks.

        Given the class, trace and photo say nothing more of each other, so that their
        probabilities multiply and their scores add. Fusion then begins with what both networks
        know, weighted by how sure they are, and need not learn it anew from samples that both have
        seen and find equally easy.

        Args:
            haptic: The network whose copy is in here, with its score layer.
            visual: Likewise.
        """
        if self.level == "fc3":
            self.head.weight.copy_(torch.eye(self.classes).repeat(1, 2))
            self.head.bias.zero_()
            return
        left, right = haptic.head.score_layer, visual.head.score_layer
        self.head.weight.copy_(torch.cat([left.weight, right.weight], dim=1).flatten(1))
        self.head.bias.copy_(cast(Tensor, left.bias) + cast(Tensor, right.bias))

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """Iterate over the parameters of both networks."""
        yield from self.haptic.parameters()
        yield from self.visual.parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """Iterate over the parameters of the fusion layer, trained faster than the networks."""
        yield from self.head.parameters()
