"""Systems of different senses on the samples of all of them."""

from tex_lightning.evaluation.comparison import correct_shares, pair
from tex_lightning.evaluation.outcomes import Outcome


def outcome(correct: bool, **files: str) -> Outcome:
    return Outcome(files, "oak", "oak" if correct else "ash", 1.0, 1, int(correct), 1.0)


def test_votes_are_those_on_the_joint_samples():
    photos = [outcome(n != 1, image=f"p{n}") for n in range(4)]
    both = [outcome(True, haptic=f"t{n % 2}", image=f"p{n}") for n in range(4)]
    assert correct_shares(photos, both) == {"t0": 1.0, "t1": 0.5}
    assert correct_shares(both, both) == {"t0": 1.0, "t1": 1.0}


def test_samples_that_are_not_in_the_joint_ones_stand_for_themselves():
    sounds = [outcome(n == 0, sound=f"s{n}") for n in range(2)]
    traces = [outcome(True, haptic="t0")]
    assert correct_shares(sounds, traces) == {"s0": 1.0, "s1": 0.0}
    assert pair(sounds, traces) is None
