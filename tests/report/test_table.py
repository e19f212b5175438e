"""Tables fit 80 columns whatever the figures, and nothing of a figure is cut."""

import io

import pytest
from rich.console import Console

from tex_lightning.core.console import Screen
from tex_lightning.report import frontier_chart, sweep_summary, table
from tex_lightning.report.trials import sweep_table

CORRECT = {"correct": 98_765, "test_samples": 100_000, "vote_accuracy": 0.98765}
NETWORK = {
    **CORRECT,
    "vote_ci95": [0.97812, 1.0],
    "fragment_accuracy": 0.98123,
    "latency_ms": {"median": 12_345.67},
    "fit_seconds": 123_456.78,
    "parameters": 123_456_789,
    "macs_per_sample": 123_456_000_000,
}

RUN = {"task": "crossval", "model": "fusion", "data": "manifest", "classes": [*"abc"]}


@pytest.fixture
def printed(monkeypatch):
    """What is printed on 80 columns."""
    console = Console(width=80, file=io.StringIO())
    for module in (table, sweep_summary, frontier_chart):
        monkeypatch.setattr(module, "console", console)
    monkeypatch.setattr(Screen, "sweep", False)  # whatever ran before in this process

    def read() -> str:
        text = console.file.getvalue()
        assert "…" not in text
        folders = "Summary in", "Results in"  # of any length
        shown = [line for line in text.splitlines() if not line.startswith(folders)]
        assert max(map(len, shown)) <= 80
        return text

    return read


def test_results(printed, tmp_path):
    networks = dict.fromkeys(("haptic", "visual", "fusion"), NETWORK)
    results = {**RUN, "networks": networks}
    table.print_results(results, tmp_path)
    text = printed()
    for figure in ("98765/100000", "97.8% to 100.0%", "12345.7", "123456.8", "123,456,789"):
        assert text.count(figure) == 3
    assert "debug=tiny" not in text


def test_bins_of_a_condition_stand_by_size():
    bins = ["-10 to -5", "-5 to 0.12", "0.12 to 0.5", "0.5 to 0.9"]
    networks = {"haptic": {"conditions": {"force": dict.fromkeys(bins, CORRECT)}}}
    assert [row["value"] for row in table.condition_rows(networks)] == bins


def test_what_was_asked_for_is_shown_beside_chance(printed, tmp_path):
    unknown = {"rate": 0.05, "threshold": 1.0, "novelty_auroc": 0.98765,
               "false_rejections": {"count": 2, "of": 40, "share": 0.05},
               "accepted_unknown": {"count": 3, "of": 20, "share": 0.15}}  # fmt: skip
    networks = {"a": NETWORK, "b": {**NETWORK, "unknown": unknown}}
    table.print_results({**RUN, "networks": networks}, tmp_path)
    rows = {line[:27].strip(): line[27:].split() for line in printed().splitlines()}
    assert rows["chance"] == ["33.3%", "33.3%"]
    assert rows["false rejections"] == ["2/40", "(5.0%)"]
    assert rows["accepted unknown"] == ["3/20", "(15.0%)"]
    assert rows["AUROC of unknown"] == ["0.988"]


def test_sweep(printed, tmp_path):
    rows = [
        {
            "job": str(job), "overrides": [f"model={model}", f"data.test_fold={job}", "seed=1"],
            "status": "done", "network": "fusion", "ci_low": 0.978, "ci_high": 1.0,
            "fit_seconds": 123_456.78, **CORRECT,
        }
        for job, model in enumerate(["minirocket", "fusion_fc3_tcnn"])
    ]  # fmt: skip
    lost = {"job": "17", "overrides": ["model=haptic"], "status": "A sentence that explains."}
    rows.append(lost)
    sweep_summary._print(sweep_table(rows, searched=False), rows, tmp_path)
    text = printed()
    assert text.count("98.8% (98765/100000)") == 2
    assert "Job 17: A sentence that explains." in text
