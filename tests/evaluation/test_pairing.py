"""Systems of different senses on the samples of all of them, against counts by hand and SciPy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tex_lightning.evaluation.comparison import correct_shares, difference
from tex_lightning.evaluation.outcomes import Outcome

VOTES = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30)


def outcome(correct: bool, **files: str) -> Outcome:
    return Outcome(files, "oak", "oak" if correct else "ash", 1.0, 1, int(correct), 1.0)


@given(VOTES, st.integers(1, 4))
def test_samples_that_repeat_a_recording_are_one_sample_to_the_test(votes, photos):
    """A trace with several photos is wrong, or repaired, in all of its samples at once."""
    before = [outcome(old, haptic=f"t{n}") for n, (old, _) in enumerate(votes)]
    after = [
        outcome(new, haptic=f"t{n}", image=f"p{n}_{photo}")
        for n, (_, new) in enumerate(votes)
        for photo in range(photos)
    ]
    repaired = sum(new and not old for old, new in votes)
    broken = sum(old and not new for old, new in votes)
    found = difference(before, after)
    assert found[:3] == (photos * len(votes), photos * repaired, photos * broken)
    discordant = repaired + broken
    exact = binomtest(repaired, discordant).pvalue if discordant else 1.0
    assert found.p_value == pytest.approx(exact)


def test_votes_are_those_on_the_joint_samples():
    photos = [outcome(n != 1, image=f"p{n}") for n in range(4)]
    both = [outcome(True, haptic=f"t{n % 2}", image=f"p{n}") for n in range(4)]
    assert correct_shares(photos, both) == {"t0": 1.0, "t1": 0.5}
    assert correct_shares(both, both) == {"t0": 1.0, "t1": 1.0}


def test_samples_that_are_not_in_the_joint_ones_stand_for_themselves():
    sounds = [outcome(n == 0, sound=f"s{n}") for n in range(2)]
    traces = [outcome(True, haptic="t0")]
    assert correct_shares(sounds, traces) == {"s0": 1.0, "s1": 0.0}
    assert difference(sounds, traces) is None
