"""Comparison of systems of different senses on the samples of all these senses together."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import NamedTuple

from tex_lightning.evaluation.mcnemar import mcnemar
from tex_lightning.evaluation.outcomes import Outcome


class Difference(NamedTuple):
    """Samples that one system classifies correctly and another does not.

    Attributes:
        test_samples: Test samples that both classify.
        repaired: Samples that only the second gets right.
        broken: Samples that only the first gets right.
        p_value: p of the exact McNemar test, two-sided. Samples that share a recording count once,
            by their majority, since a recording that misleads does so in all of them.
    """

    test_samples: int
    repaired: int
    broken: int
    p_value: float


def scarcest(files: Sequence[Mapping[str, str]]) -> list[str]:
    """Return, of each sample's files by modality, that of the modality with the fewest files."""
    recorded = [[each[modality] for each in files] for modality in files[0]]
    return min(recorded, key=lambda names: len(set(names)))


def pair(
    outcomes: Sequence[Outcome], joint: Sequence[Outcome]
) -> list[tuple[str, bool, bool]] | None:
    """Return each joint sample's independent recording, and whether each system is correct.

    That recording is of the modality with the fewest recordings, which several samples share.

    Args:
        outcomes: Outcomes of a system that uses some of the modalities.
        joint: Outcomes of a system that uses all of them.

    Returns:
        None if no joint sample holds what the first system has classified.
    """
    modalities = sorted(outcomes[0].files)
    if not set(modalities) <= set(joint[0].files):
        return None
    known = {each.sample: each.label == each.predicted for each in outcomes}
    recordings = scarcest([each.files for each in joint])
    names = ["|".join(each.files[modality] for modality in modalities) for each in joint]
    return [
        (recording, known[name], each.label == each.predicted)
        for recording, name, each in zip(recordings, names, joint, strict=True)
        if name in known
    ] or None


def correct_shares(outcomes: Sequence[Outcome], joint: Sequence[Outcome]) -> dict[str, float]:
    """Share of correct votes on the joint samples, by independent recording; see :func:`pair`.

    Where the joint samples do not hold the system's own, by its own samples.
    """
    pairs = pair(outcomes, joint)
    if pairs is None:
        return {each.sample: float(each.label == each.predicted) for each in outcomes}
    votes = defaultdict(list)
    for recording, correct, _ in pairs:
        votes[recording].append(correct)
    return {recording: fmean(correct) for recording, correct in votes.items()}


def difference(before: Sequence[Outcome], after: Sequence[Outcome]) -> Difference | None:
    """What a system gains and loses by its senses beyond those of another.

    Args:
        before: Outcomes of the system with fewer senses.
        after: Outcomes of the system with more.
    """
    pairs = pair(before, after)
    if pairs is None:
        return None
    net: dict[str, int] = defaultdict(int)
    for recording, old, new in pairs:
        net[recording] += new - old
    tested = mcnemar(
        {name: gain > 0 for name, gain in net.items()},
        {name: gain < 0 for name, gain in net.items()},
    )
    return Difference(
        test_samples=len(pairs),
        repaired=sum(new and not old for _, old, new in pairs),
        broken=sum(old and not new for _, old, new in pairs),
        p_value=1.0 if tested is None else tested[2],
    )
