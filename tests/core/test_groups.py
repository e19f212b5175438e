"""Division by group against scikit-learn: no group on two sides, no class missing on one."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.model_selection import StratifiedGroupKFold

from tex_lightning.core.groups import divide, leave_out

ROWS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 12)), min_size=1, max_size=60)


@given(rows=ROWS, parts=st.integers(1, 8))
def test_a_group_is_in_one_part_and_no_part_is_empty(rows, parts):
    kinds, groups = zip(*rows, strict=True)
    found = divide(kinds, groups, parts)
    assert len(set(zip(groups, found, strict=True))) == len(set(groups))
    assert len(set(found)) == min(parts, len(set(groups)))
    turned = divide(kinds[::-1], groups[::-1], parts)
    assert turned[::-1] == found


@given(rows=ROWS)
def test_what_is_left_out_leaves_every_class_some_rows(rows):
    labels, groups = zip(*rows, strict=True)
    parts = leave_out(labels, groups)
    grouped, counts = Counter(label for label, _ in set(rows)), Counter(labels)
    for label in counts:
        of_class = {part for row, part in zip(rows, parts, strict=True) if row[0] == label}
        assert of_class == {-1} if counts[label] == 1 else len(of_class) > 1 and -1 not in of_class
    whole = [pair for pair in zip(rows, parts, strict=True) if grouped[pair[0][0]] > 1]
    assert len({(group, part) for (_, group), part in whole}) == len({row[1] for row, _ in whole})


def test_what_has_no_other_group_is_left_out_by_recording_and_versions_of_one_stay_together():
    labels, groups = [0, 0, 0, 1, 1, 1, 1, 2, 2], ["a", "b", "c", "d", "d", "d", "d", "e", "e"]
    recordings = [0, 1, 2, 3, 3, 4, 5, 6, 6]
    parts = leave_out(labels, groups, recordings)
    assert len(set(parts[:3])) == 3
    assert parts[3] == parts[4]
    assert len(set(parts[3:7])) == 3
    assert parts[7:] == [-1, -1]  # both are versions of the only recording


def test_a_rare_class_counts_as_much_as_a_common_one():
    kinds = ["common", "rare", "common", "common", "common", "rare"]
    assert divide(kinds, ["a", "a", "b", "b", "c", "c"], 2) == [0, 0, 0, 0, 1, 1]


@pytest.mark.parametrize("parts", [2, 5, 10])
def test_classes_are_spread_as_evenly_as_scikit_learn_spreads_them(parts):
    rng = np.random.default_rng(parts)
    groups = rng.integers(0, 60, 800)
    labels = (groups + rng.integers(0, 2, 800)) % 5
    ours = np.array(divide(labels.tolist(), groups.tolist(), parts))
    theirs = np.empty(800, int)
    splitter = StratifiedGroupKFold(parts, shuffle=True, random_state=0)
    for part, (_, out) in enumerate(splitter.split(labels, labels, groups)):
        theirs[out] = part

    def unevenness(found: np.ndarray) -> float:
        counts = [[np.sum(found[labels == kind] == part) for part in range(parts)]
                  for kind in range(5)]  # fmt: skip
        return float(np.std(counts, axis=1).mean())

    assert unevenness(ours) < unevenness(theirs) + 1  # row of about 160
