import csv

from tex_lightning.report.table import MAX_LISTED, condition_rows, write_conditions


def entry(**values: tuple[int, int]) -> dict:
    return {
        "conditions": {
            "speed": {
                name.strip("v"): {
                    "correct": right, "test_samples": count, "vote_accuracy": right / count,
                    "vote_ci95": [0.0, 1.0],
                }
                for name, (right, count) in values.items()
            }
        }
    }  # fmt: skip


def test_the_file_has_a_line_for_each_value_and_network(tmp_path):
    networks = {"haptic": entry(v60=(3, 4), v90=(1, 1)), "fusion": entry(v90=(1, 2)), "none": {}}
    write_conditions(networks, tmp_path)
    with (tmp_path / "conditions.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [
        (row["condition"], row["value"], row["network"], row["correct"], row["test_samples"])
        for row in rows
    ] == [
        ("speed", "60", "haptic", "3", "4"),
        ("speed", "90", "haptic", "1", "1"),
        ("speed", "90", "fusion", "1", "2"),
    ]
    assert float(rows[0]["vote_accuracy"]) == 0.75
    first = condition_rows(networks)[0]
    assert [*first.values()] == ["speed", "60", "75.0% (3/4)", "", ""]


def test_a_condition_of_many_values_is_left_to_the_file():
    values = {f"v{n}": (1, 1) for n in range(MAX_LISTED + 1)}
    assert condition_rows({"haptic": entry(**values)}) == []
    assert condition_rows({"haptic": entry(v60=(1, 2))}) == []  # as all votes
