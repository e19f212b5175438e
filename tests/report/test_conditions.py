"""Votes by condition as rows of a table."""

from tex_lightning.report.table import MAX_LISTED, condition_rows


def entry(**values: tuple[int, int]) -> dict:
    counts = {
        name.strip("v"): {"correct": right, "test_samples": n, "vote_accuracy": right / n}
        for name, (right, n) in values.items()
    }
    return {"conditions": {"speed": counts}}


def test_there_is_a_row_for_each_value_and_a_column_for_each_network():
    networks = {"haptic": entry(v100=(3, 4), v90=(1, 1)), "fusion": entry(v90=(1, 2)), "none": {}}
    assert [[*row.values()] for row in condition_rows(networks)] == [
        ["speed", "90", "100.0% (1/1)", "50.0% (1/2)", ""],
        ["speed", "100", "75.0% (3/4)", "", ""],
    ]


def test_a_condition_of_one_or_of_many_values_has_no_row():
    values = {f"v{n}": (1, 1) for n in range(MAX_LISTED + 1)}
    assert condition_rows({"haptic": entry(**values)}) == []
    assert condition_rows({"haptic": entry(v60=(1, 2))}) == []  # as all votes
