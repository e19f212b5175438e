"""What of a recording lies outside of everything in training, and must not decide."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from tex_lightning.core.devices import is_at_hand
from tex_lightning.networks.blocks import FittedLater

MARGIN = 4.0  # over the root of the rows: of few the largest length says little about the next
ROWS = 1000  # that are measured at once
BEYOND = 1.5  # times the share of features that chance takes out of the range of the training
ROUNDING = 1e-5  # of a mean: proportions of 0 and 1 are the range's ends, and no more outside of it


class RangeGate(nn.Module):
    """Take out groups of features that lie outside of everything in training.

    Another gain or mount of the sensor, or a hum, is no property of the material. A group becomes
    zero, the mean of the training, if its mean over the recording is longer than its limit. Groups
    are what depends on gain and mount (``power``, ``level``), and every frequency band.

    Args:
        member: Which features each group has, (groups, D).

    Attributes:
        limits: Largest squared length of each group.
        fragments: Fragments of a usual training recording; the mean of fewer varies more.
    """

    member: Tensor
    groups: Tensor
    features: Tensor
    limits: Tensor
    fragments: Tensor

    def __init__(self, member: Tensor) -> None:
        super().__init__()
        self.register_buffer("member", member.float(), persistent=False)
        for name, places in zip(("groups", "features"), member.nonzero().T, strict=True):
            self.register_buffer(name, places.contiguous(), persistent=False)
        self.register_buffer("limits", torch.full((len(member),), torch.finfo().max))
        self.register_buffer("fragments", torch.ones(()))

    def limits_of(self, rows: Tensor) -> Tensor:
        """Return the limits (groups,) that training on rows (rows, D) gives."""
        margin, blocks = 1 + MARGIN / len(rows) ** 0.5, torch.split(rows[:, :, None], ROWS)
        longest = torch.stack([self.lengths(x).amax(dim=0) for x in blocks]).amax(dim=0)
        limits: Tensor = (margin**2 * longest).clamp_min(torch.finfo().tiny)
        return limits.to(self.limits)

    def widened(self, rows: Tensor) -> dict[str, Tensor]:
        """Return the limits with those that more rows (rows, D) give."""
        return {"limits": torch.maximum(self.limits, self.limits_of(rows))}

    def lengths(self, x: Tensor) -> Tensor:
        """Return squared lengths (B, groups) of the mean of features (B, D, positions...)."""
        squares = x.flatten(2).mean(dim=2).square()
        if not is_at_hand(x):
            lengths: Tensor = squares @ self.member.to(x.dtype).T
            return lengths
        sums = squares.new_zeros(len(squares), len(self.limits))
        return sums.index_add_(1, self.groups, squares[:, self.features])

    def forward(self, x: Tensor, whole: tuple[Tensor, int] | None = None) -> Tensor:
        """Return features (B, D, M, N) with zeros in the groups that are out of range.

        Args:
            x: Features of all fragments of a recording, or of some.
            whole: Mean (B, D, 1) of all its fragments and their number; None takes those of ``x``.
        """
        mean, count = (x, x[0, 0].numel()) if whole is None else whole
        limits = self.limits * (self.fragments / count).clamp_min(1)
        far = self.lengths(mean) > limits
        if is_at_hand(x) and not far.any():
            return x
        outside = far.to(x.dtype) @ self.member.to(x.dtype)
        inside: Tensor = x * (1 - outside.clamp(max=1))[:, :, None, None]
        return inside


def gated_groups(blocks: Sequence[tuple[str, int]], bins: Sequence[int]) -> Tensor:
    """Return which features (groups, D) are out of range together.

    Args:
        blocks: Kind and number of the features of each block, levels last.
        bins: Number of the frequency band of each feature, -1 for none.
    """
    band, sizes = torch.tensor(bins), torch.tensor([size for _, size in blocks])
    groups = [band == number for number in sorted({*bins} - {-1})]
    block = torch.repeat_interleave(torch.arange(len(blocks)), sizes)
    groups += [block == index for index, (kind, _) in enumerate(blocks) if kind == "power"]
    levels = torch.repeat_interleave(torch.tensor([kind == "level" for kind, _ in blocks]), sizes)
    if levels.any():
        groups.append(levels)
    return torch.stack(groups) if groups else torch.zeros(0, len(block))


class FeatureRange(FittedLater):
    """Move a recording that is unlike all in training to the edge of what they reach.

    A line goes on for ever, and knows nothing of what lies outside. Another sensor, clock or hand
    takes many features there at once; one more recording of the same kind takes few: of n training
    recordings and itself each has the same chance to be the least or the largest. The means of
    short recordings vary more, and are left as they are.

    Attributes:
        lowest: Least mean (D,) of a training recording.
        highest: Largest mean (D,).
        share: Of the features that vary, from which on a recording is unlike all in training.
        most: Fragments of the longest recording that is short.
    """

    lowest: Tensor
    highest: Tensor
    share: Tensor
    most: Tensor

    def __init__(self, bands: int) -> None:
        super().__init__(lowest=(bands,), highest=(bands,), share=(), most=())

    def fit(self, means: Tensor, count: int, most: int) -> None:
        """Take the range of the training.

        Args:
            means: Features (versions, D) of recordings.
            count: Number of the recordings that these are versions of.
            most: Fragments of the longest recording that is short.
        """
        self.take({
            "lowest": means.amin(dim=0),
            "highest": means.amax(dim=0),
            "share": torch.tensor(BEYOND * 2 / (count + 1)),
            "most": torch.tensor(float(most)),
        })  # fmt: skip

    def widened(self, means: Tensor) -> dict[str, Tensor]:
        """Return the least and largest means with those of more recordings (recordings, D)."""
        if not self.in_use:
            return {}
        return {
            "lowest": torch.minimum(self.lowest, means.amin(dim=0)),
            "highest": torch.maximum(self.highest, means.amax(dim=0)),
        }

    def forward(self, x: Tensor, whole: tuple[Tensor, int]) -> Tensor:
        """Return features (B, D, M, N) that are moved as the mean of their recording has to be.

        Args:
            x: Features of all fragments of a recording, or of some.
            whole: Mean (B, D, 1) of all its fragments and their number.
        """
        if not self.in_use or self.training:
            return x
        mean, count = whole[0].flatten(1), whole[1]
        moves = mean.clamp(self.lowest, self.highest) - mean
        outside = (moves.abs() > ROUNDING).sum(dim=1, keepdim=True)
        unlike = outside >= self.share * (self.lowest < self.highest).sum()
        unlike = unlike & (self.most < count)
        if is_at_hand(x) and not unlike.any():
            return x
        return x + (unlike * moves)[:, :, None, None]
