"""A trace taken from its beginning, each time twice as many fragments, and nothing of it twice."""

from collections.abc import Iterator
from typing import cast

from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier, check_frames
from tex_lightning.decision.voting import Vote
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import movement_start
from tex_lightning.inference.costs import Costs
from tex_lightning.inference.streaming.classifier import StreamingClassifier
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.parts import part_for

STREAMED = 3.0  # time of a multiply-accumulate here over that in a full pass; measured 2.3 to 3


def haptic_stream(classifier: SurfaceClassifier) -> StreamingClassifier | None:
    """What takes a trace piece by piece, of a FusionNet its haptic part with its scores.

    None if there is no such part, or features or weights are such that it needs the whole trace.
    """
    fused = classifier.card.kind == "fusion"
    part = part_for(classifier, "haptic") if fused else classifier
    try:
        return StreamingClassifier(part, keep_scores=fused)
    except UserError:
        return None


def beginnings(
    trace: Tensor, frames: int, stream: StreamingClassifier, costs: Costs
) -> Iterator[Vote]:
    """Votes over longer and longer beginnings of a trace; what is not asked for is not computed.

    They end before the next one would bring the time of all to that of a full pass, which then
    should be done. That may be before the first.

    Args:
        trace: (axes, samples), decoded.
        frames: Of its spectrogram.
        stream: Computes; it is restarted.
        costs: Of the full pass.

    Raises:
        UserError: If there is not one fragment.
    """
    features = stream.features
    check_frames(frames, features)
    start = movement_start(trace, features.sampling_rate) if features.skip_impact else 0
    movement, begin, before = trace[:, start:], 0, 0
    budget = costs.haptic(frames) / STREAMED
    stream.restart(start_known=True)
    for seen in _lengths(frames):
        if stream.macs + costs.haptic(seen) - before > budget:
            return
        end, before = features.samples(seen), costs.haptic(seen)
        yield cast(Vote, stream.push(movement[:, begin:end]))
        begin = end


def _lengths(frames: int) -> Iterator[int]:
    """Frames of 1, 2, 4, 8 ... fragments: every push has a cost of its own."""
    fragments = 1
    while (seen := HapticNet.min_frames + (fragments - 1) * HapticNet.stride) < frames:
        yield seen
        fragments *= 2
    yield frames
