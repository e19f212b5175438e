"""Read a trace from its beginning, each time twice as many fragments, without repetition."""

from collections.abc import Iterator

from torch import Tensor

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.decision.voting import Vote
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import movement_start
from tex_lightning.inference.costs import Costs
from tex_lightning.inference.streaming.classifier import StreamingClassifier

STREAMED = 3.0  # time of a multiply-accumulate here over that in a full pass; measured 2.3 to 3


def signal_stream(classifier: SurfaceClassifier, sense: str) -> StreamingClassifier | None:
    """Make a stream for a signal; for a FusionNet, of the part of its sense with its scores.

    None if there is no such part, or features or weights are such that it needs the whole signal.
    """
    try:
        return StreamingClassifier(classifier.part([sense]), keep_scores=True)
    except UserError:
        return None


def beginnings(trace: Tensor, stream: StreamingClassifier, costs: Costs) -> Iterator[Vote]:
    """Yield votes over longer and longer beginnings of a signal, each computed when it is needed.

    They end before the next one would bring the time of all to that of a full pass, which then
    should be done. That may be before the first.

    Args:
        trace: (axes, samples), decoded.
        stream: Computes; it is restarted.
        costs: Costs of the full pass.

    Raises:
        UserError: If there is not one fragment.
    """
    features, branch = stream.features, stream.branch
    bands, frames = branch.input_size(trace)
    branch.check_frames(frames)
    start = movement_start(trace, features.sampling_rate) if features.skip_impact else 0
    movement, begin, before = trace[:, start:], 0, 0
    budget = costs.of(branch.name, bands, frames) / STREAMED
    stream.restart(start_known=True)
    for seen in _lengths(branch, frames):
        cost = costs.of(branch.name, bands, seen)
        if stream.macs + cost - before > budget:
            return
        end, before = features.samples(seen), cost
        vote = stream.push(movement[:, begin:end])
        assert vote is not None  # every beginning has a fragment
        yield vote
        begin = end


def _lengths(branch: Branch, frames: int) -> Iterator[int]:
    """Frames of 1, 2, 4, 8 ... fragments: every push has a cost of its own."""
    fragments, stride = 1, branch.stride
    while (seen := branch.min_size[1] + (fragments - 1) * stride) < frames:
        yield seen
        fragments *= 2
    yield frames
