"""The figure and tables of stability hold many systems and perturbations."""

import pytest

from tex_lightning.evaluation.robustness import StabilityRow, failure_entry, find_failures
from tex_lightning.perturbations.table import perturbations
from tex_lightning.report.stability_charts import (
    BROKEN,
    FINE,
    LOWER,
    failure_table,
    stability_figure,
)

TABLE = perturbations()
CORRECT = {"white_noise": [40, 38, 30, 10, 5, 2], "jpeg": [40] * 6}
SYSTEMS = {f"s{n}": f"System {n}" for n in range(12)}


def trial(system: str, name: str, severity: int) -> StabilityRow:
    correct = CORRECT[name][severity]
    return StabilityRow(
        system, TABLE[name].modality, name, severity, 40, correct / 40, 0.8 * correct / 40,
        0.2 + 0.8 * correct / 40, 0, 40 - correct, 0,
    )  # fmt: skip


@pytest.fixture
def trials() -> list[StabilityRow]:
    """Of twelve systems; the last one has no photo."""
    return [
        trial(system, name, severity)
        for system in SYSTEMS
        for name in CORRECT
        if (system, name) != ("s11", "jpeg")
        for severity in range(6)
    ]


def test_each_system_and_perturbation_has_a_cell_with_intervals_and_chance(trials):
    guessed = {name: 1 / 8 if name == "s3" else 1 / 16 for name in SYSTEMS}
    figure = stability_figure(trials, TABLE, SYSTEMS, guessed)
    (axes,) = figure.axes
    cells = 23
    assert len(axes.patches) == cells
    lines = [line.get_xydata() for line in axes.get_lines()]
    bars = [line for line in lines if len(line) == 2 and line[0][0] == line[1][0]]
    assert len(bars) == 6 * cells
    assert max(bar[1][1] - bar[0][1] for bar in bars) == pytest.approx(0.2)
    chances = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
    assert len(chances) == cells
    heights = [round(line.get_ydata()[0] % 1.35, 4) for line in chances]
    assert (heights.count(1 / 16), heights.count(1 / 8)) == (cells - 2, 2)
    dots = [line.get_color() for line in axes.get_lines() if len(line.get_xdata()) == 1]
    assert [dots.count(look.colour) for look in (FINE, LOWER, BROKEN)] == [2 * 12 + 66, 12, 36]
    assert [text.get_text() for text in axes.get_xticklabels()] == list(SYSTEMS.values())
    assert axes.get_yticklabels()[0].get_text().startswith("white noise (haptic)\n30 to 0 SNR")


def test_the_table_has_every_pair_with_counts_interval_and_breaking_point(trials):
    entries = [failure_entry(failure, TABLE) for failure in find_failures(trials)]
    systems = {name: {"name": label} for name, label in SYSTEMS.items()}
    table = failure_table({"systems": systems, "failures": entries})
    assert len(table.rows) == 23
    assert table.rows[0]["perturbation"] == "white noise"
    assert table.rows[0]["lower from"] == "20 SNR in dB (severity 2): 30/40, 60.0 to 80.0 %"
    assert table.rows[0]["broken from"].startswith("10 SNR in dB (severity 3): 10/40")
    assert table.rows[0]["breaking point"] == "15 SNR in dB"
    low_pass = {**entries[0], "unit": "Hz", "breaking_value": 5512.9}
    shown = failure_table({"systems": systems, "failures": [low_pass]})
    assert shown.rows[0]["breaking point"] == "5510 Hz"
    assert table.rows[-1]["lower from"] == table.rows[-1]["breaking point"] == "-"
