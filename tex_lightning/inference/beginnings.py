"""A trace taken from its beginning, a fragment more at a time, and nothing of it twice."""

from collections.abc import Iterator
from typing import cast

from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier, check_frames
from tex_lightning.decision.voting import Vote
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import movement_start
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.parts import part_for
from tex_lightning.streaming.classifier import StreamingClassifier


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


def beginnings(trace: Tensor, frames: int, stream: StreamingClassifier) -> Iterator[Vote]:
    """Votes over longer and longer beginnings of a trace; what is not asked for is not computed.

    Args:
        trace: (axes, samples), decoded.
        frames: Of its spectrogram.
        stream: Computes; it is restarted.

    Raises:
        UserError: If there is not one fragment.
    """
    features = stream.features
    check_frames(frames, features)
    start = movement_start(trace, features.sampling_rate) if features.skip_impact else 0
    movement, begin = trace[:, start:], 0
    stream.restart(start_known=True)
    for seen in (*range(HapticNet.min_frames, frames, HapticNet.stride), frames):
        end = features.samples(seen)
        yield cast(Vote, stream.push(movement[:, begin:end]))
        begin = end
