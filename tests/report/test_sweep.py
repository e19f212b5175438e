"""What a sweep says of jobs whose results have no networks, or that failed."""

import csv
import itertools
import json
import pickle
import statistics
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from omegaconf import OmegaConf

from tex_lightning.evaluation.outcomes import Outcome, summarise, write_outcomes
from tex_lightning.report.sweep import SweepSummary
from tex_lightning.report.sweep_summary import draw_sweep, key_figure
from tex_lightning.report.trials import shown_rows, sweep_rows, sweep_table, swept_keys


def job(folder: Path, task: str, results: dict | None) -> None:
    (folder / ".hydra").mkdir(parents=True)
    OmegaConf.save([f"task={task}", "seed=1"], folder / ".hydra" / "overrides.yaml")
    if results is not None:
        (folder / "results.json").write_text(json.dumps(results))


@pytest.fixture
def ended(monkeypatch):
    monkeypatch.setattr(SweepSummary, "failures", 0)

    def end(folder: Path) -> dict[str, str]:
        config = {"hydra": {"sweep": {"dir": str(folder)}}}
        SweepSummary().on_multirun_end(OmegaConf.create(config))
        with (folder / "sweep.csv").open() as stream:
            return {row["job"]: row["status"] for row in csv.DictReader(stream)}

    return end


def test_tables_of_their_own_are_done_and_a_failure_among_them_is_counted(tmp_path, ended):
    job(tmp_path / "0", "frontier", {"chosen": "lbp"})
    job(tmp_path / "1", "stream", None)
    job(tmp_path / "2", "fit", None)
    assert ended(tmp_path) == {"0": "done", "1": "done", "2": "not finished"}
    assert SweepSummary.failures == 1


def finish(folder: Path, seed: int, correct: int, fold: int = 0) -> None:
    """A finished run that classified ten samples of a fold."""
    job(folder, "fit", None)
    overrides = ["model=haptic", f"seed={seed}", f"data.test_fold={fold}", "debug=tiny"]
    OmegaConf.save(overrides, folder / ".hydra" / "overrides.yaml")
    settings = {"seed": seed, "data.test_fold": fold, "data.val_fold": fold + 1, "model": "haptic"}
    (folder / "settings.json").write_text(json.dumps(settings))
    outcomes = [
        Outcome({"haptic": f"{fold}-{n}.wav"}, "a", "ab"[n >= correct], 1.0, 1, 1, 2.0)
        for n in range(10)
    ]
    write_outcomes(outcomes, folder / "predictions" / "haptic.csv")
    entry = {**summarise(outcomes), "fit_seconds": 40.0, "parameters": 7, "checkpoint": ""}
    results = {"model": "haptic", "data": "folder", "classes": ["a", "b"]}
    results |= {"networks": {"haptic": entry}}
    (folder / "results.json").write_text(json.dumps(results))


def swept(folder: Path) -> list[dict[str, str]]:
    config = {"sweep": {"dir": str(folder)}, "overrides": {"task": ["seed=0,1,2", "debug=tiny"]}}
    SweepSummary().on_multirun_end(OmegaConf.create({"hydra": config}))
    with (folder / "sweep.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_seeds_get_mean_and_sample_deviation_with_the_counts_of_each(tmp_path):
    for seed, correct in enumerate((8, 9, 10)):
        finish(tmp_path / str(seed), seed, correct)
    *_, row = swept(tmp_path)
    assert row["job"] == "3 seeds"
    assert float(row["vote_accuracy"]) == pytest.approx(statistics.mean([0.8, 0.9, 1]))
    assert float(row["vote_accuracy_sd"]) == pytest.approx(statistics.stdev([0.8, 0.9, 1]))
    assert row["correct"] == row["ci_low"] == ""  # the same samples three times are no thirty
    report = (tmp_path / "report.md").read_text()
    assert report.count("| HapticNet |") == 1
    assert "90.0% ± 10.0% (3 seeds)" in report
    assert "**debug=tiny shrank every budget" in report


def test_folds_are_pooled_before_seeds_and_fit_seconds_are_one_sum(tmp_path, capfd):
    for seed in (0, 1):
        for fold in (0, 1):
            finish(tmp_path / f"{seed}{fold}", seed, 9 - seed, fold)
    rows = swept(tmp_path)
    assert [row["job"] for row in rows[4:]] == ["2 folds", "2 folds", "2 seeds"]
    assert [row["fit_seconds"] for row in rows[4:]] == ["80.0", "80.0", "160.0"]
    assert [row["correct"] for row in rows[4:6]] == ["18", "16"]
    assert float(rows[6]["vote_accuracy"]) == pytest.approx(0.85)
    report = (tmp_path / "report.md").read_text()
    (line,) = (line for line in report.splitlines() if "| HapticNet |" in line)
    assert "85.0% ± 7.1% (2 seeds)" in line
    assert "| 160.0 | 7 |" in line
    assert "85.0% ± 7.1%" in capfd.readouterr().err


def test_a_second_sweep_in_the_folder_is_refused_until_the_first_has_ended(tmp_path, capsys):
    trainer = {"devices": 1, "num_nodes": 1}
    hydra = {"sweep": {"dir": str(tmp_path)}}
    values = {"hydra": hydra, "trainer": trainer, "trusted": [], "model": {}}
    config = OmegaConf.create(values)
    first, second = SweepSummary(), SweepSummary()
    first.on_multirun_start(config)
    pickle.loads(pickle.dumps(first))  # as launchers send it to their processes
    with pytest.raises(SystemExit) as stop:
        second.on_multirun_start(config)
    assert stop.value.code == 2
    assert "choose another hydra.sweep.dir" in capsys.readouterr().err
    first.on_multirun_end(config)
    second.on_multirun_start(config)
    second.on_multirun_end(config)


def trial(folder: Path, loss: float | None, accuracy: float, **swept: object) -> None:
    """A finished job of a sweep, or one that failed."""
    (folder / ".hydra").mkdir(parents=True)
    overrides = [
        "model=haptic",
        *(f"{key.replace('__', '.')}={value}" for key, value in swept.items()),
    ]
    OmegaConf.save(overrides, folder / ".hydra" / "overrides.yaml")
    (folder / "settings.json").write_text(json.dumps(dict(item.split("=") for item in overrides)))
    if loss is None:
        (folder / "failure.json").write_text(json.dumps({"error": "why", "overrides": overrides}))
        return
    entry = {
        "vote_accuracy": accuracy, "vote_ci95": [accuracy - 0.1, min(1, accuracy + 0.1)],
        "correct": round(100 * accuracy), "test_samples": 100, "fragment_accuracy": accuracy,
        "latency_ms": {"median": 1.0}, "fit_seconds": 2.0, "val_loss": loss, "parameters": 7,
    }  # fmt: skip
    results = {
        "model": "haptic",
        "data": "folder",
        "classes": ["a", "b"],
        "networks": {"haptic": entry},
    }
    (folder / "results.json").write_text(json.dumps(results))


def jobs_of(folder: Path) -> list[Path]:
    return sorted(folder.iterdir(), key=lambda path: int(path.name))


def test_the_best_job_is_what_the_objective_says_and_never_the_test(tmp_path):
    for number, (loss, accuracy) in enumerate([(0.3, 0.99), (0.1, 0.7), (0.2, 0.8), (None, 0.0)]):
        trial(tmp_path / str(number), loss, accuracy, rate=number)
    rows = sweep_rows(jobs_of(tmp_path), searched=True)
    table = sweep_table(rows, searched=True)
    assert [row["best"] for row in table.rows] == ["", "best", "", ""]
    assert [row["val_loss"] for row in table.rows] == [
        "0.3",
        "0.1",
        "0.2",
        "",
    ]
    assert [row["accuracy"] for row in table.rows][-1] == "failed"
    without = sweep_table(sweep_rows(jobs_of(tmp_path), searched=False), searched=False)
    assert not {"best", "val_loss"} & {*without.headings}


def test_a_search_may_train_on_everything_that_does_not_validate(tmp_path):
    for number, loss in enumerate((0.5, 0.2, 0.4)):
        trial(tmp_path / str(number), loss, 0.9, lr=number)
        file = tmp_path / str(number) / "results.json"
        results = json.loads(file.read_text())
        entry = results["networks"]["haptic"]
        kept = {key: entry[key] for key in ("val_loss", "fit_seconds", "parameters")}
        results["networks"]["haptic"] = {"test_samples": 0, **kept}
        file.write_text(json.dumps(results))
    rows = sweep_rows(jobs_of(tmp_path), searched=True)
    assert [row.get("best", "") for row in rows] == ["", "best", ""]
    table = sweep_table(rows, searched=True)
    assert [row["accuracy"] for row in table.rows] == ["not tested"] * 3
    assert [row["val_loss"] for row in table.rows] == ["0.5", "0.2", "0.4"]
    assert [row["network"] for row in table.rows] == ["haptic"] * 3


def test_what_was_swept_stands_first_by_the_shortest_names_that_differ(tmp_path):
    for number, (rate, seed) in enumerate([(1, 0), (1, 1), (2, 0), (2, 1)]):
        swept = {
            "model__haptic__fit__rate": rate,
            "model__visual__fit__rate": 9 - rate,
            "seed": seed,
        }
        trial(tmp_path / str(number), 0.1, 0.5 + number / 10, **swept)
    rows = sweep_rows(jobs_of(tmp_path), searched=False)
    assert len(rows) == 6
    table = sweep_table(rows, searched=False)
    assert table.headings[:3] == ["haptic.fit.rate", "visual.fit.rate", "job"]
    told = [(row["haptic.fit.rate"], row["job"], row["accuracy"]) for row in table.rows]
    assert told == [("1", "2 seeds", "55.0% ± 7.1%"), ("2", "2 seeds", "75.0% ± 7.1%")]


def test_a_figure_over_each_swept_key_shows_lines_points_or_means(tmp_path):
    values = itertools.product([0.001, 0.01, 0.1], ["sgd", "adam"], range(8), [0, 1])
    for number, (rate, optimizer, layers, seed) in enumerate(values):
        swept = {"rate": rate, "optimizer": optimizer, "layers": layers, "seed": seed}
        trial(tmp_path / "jobs" / str(number), 0.1, 0.5 + 0.02 * layers, **swept)
    rows = sweep_rows(jobs_of(tmp_path / "jobs"), searched=False)
    files = draw_sweep(rows, tmp_path, searched=False)
    assert [file.name for file in files] == [
        "sweep_rate.png",
        "sweep_optimizer.png",
        "sweep_layers.png",
    ]
    names = {key: key for key in ("rate", "optimizer", "layers")}
    known = shown_rows(rows)
    rate, optimizer, layers = (key_figure(known, key, names, searched=False) for key in names)
    assert rate.axes[0].get_xscale() == "log"
    assert rate.axes[0].get_title() == "rate (mean over optimizer, layers)"
    assert [text.get_text() for text in optimizer.axes[0].get_xticklabels()] == ["adam", "sgd"]
    assert [len(axes.containers) for axes in layers.axes] == [6]  # a line for each combination
    line = layers.axes[0].containers[0].lines[0]  # data, caps, bars
    np.testing.assert_allclose(np.asarray(line.get_ydata(), float), 0.5 + 0.02 * np.arange(8))
    search = sweep_rows(jobs_of(tmp_path / "jobs")[:40:2], searched=True)
    found = key_figure(search, "layers", names, searched=True)
    assert found.axes[0].get_ylabel() == "val_loss, the objective"
    assert found.axes[0].get_title() == "layers (others vary too)"


def test_what_the_package_derives_is_not_swept_where_a_job_failed_before(tmp_path):
    finish(tmp_path / "0", 0, 8)
    asked = ["model=haptic", "data.test_fold=0"]
    settings = {"hydra": {"overrides": {"task": asked}}}
    OmegaConf.save(settings, tmp_path / "0" / ".hydra" / "hydra.yaml")
    OmegaConf.save([*asked, "data.sampling_rate=1"], tmp_path / "0" / ".hydra" / "overrides.yaml")
    failure = {"error": "no", "overrides": ["model=haptic", "data.test_fold=9"]}
    (tmp_path / "1").mkdir()
    (tmp_path / "1" / "failure.json").write_text(json.dumps(failure))
    rows = sweep_rows([tmp_path / "0", tmp_path / "1"], searched=False)
    assert swept_keys(rows) == ["data.test_fold"]


def test_a_trial_that_a_search_made_twice_is_no_second_fold_or_seed(tmp_path):
    for number, rate in enumerate((1, 1, 2)):
        finish(tmp_path / str(number), 0, 8)
        settings = json.loads((tmp_path / str(number) / "settings.json").read_text())
        (tmp_path / str(number) / "settings.json").write_text(json.dumps({**settings, "r": rate}))
    rows = sweep_rows(jobs_of(tmp_path), searched=True)
    assert [row["job"] for row in rows] == ["0", "1", "2"]


def test_values_of_a_search_by_decades_are_written_without_signs_of_math(tmp_path):
    for number in range(12):
        trial(tmp_path / "jobs" / str(number), 0.1 * number, 0.5, rate=10.0 ** (-number / 4))
    rows = sweep_rows(jobs_of(tmp_path / "jobs"), searched=True)
    figure = key_figure(rows, "rate", {"rate": "rate"}, searched=True)
    figure.draw_without_rendering()
    texts = [text.get_text() for text in figure.axes[0].get_xticklabels()]
    assert "0.01" in texts
    assert not any("$" in text for text in texts)


def test_numbers_that_lie_close_are_not_written_over_each_other(tmp_path):
    for number, rate in enumerate((0.0007368, 0.001885, 0.002128, 0.00695)):
        trial(tmp_path / "jobs" / str(number), 0.1 * number, 0.5, rate=rate)
    rows = sweep_rows(jobs_of(tmp_path / "jobs"), searched=True)
    figure = key_figure(rows, "rate", {"rate": "rate"}, searched=True)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    labels = (text for text in figure.axes[0].get_xticklabels() if text.get_text())
    boxes = [label.get_window_extent(canvas.get_renderer()) for label in labels]
    assert all(one.x1 < other.x0 for one, other in itertools.pairwise(boxes))


@pytest.mark.parametrize("widths", [(1, 2), (1, 100)])
def test_lines_of_equal_accuracy_stand_side_by_side(tmp_path, widths):
    for number, (width, norm) in enumerate(itertools.product(widths, ["batch", "layer"])):
        trial(tmp_path / "jobs" / str(number), 0.1, 0.5, width=width, norm=norm)
    rows = sweep_rows(jobs_of(tmp_path / "jobs"), searched=False)
    names = {"width": "width", "norm": "norm"}
    (axes,) = key_figure(rows, "width", names, searched=False).axes
    first, second = (container.lines[0].get_xdata() for container in axes.containers)
    assert np.all(first < second)
    assert np.all(second < np.asarray(first) * 1.1)


def test_a_finished_job_that_another_sweep_may_not_take_keeps_its_row(tmp_path, monkeypatch):
    monkeypatch.setattr(SweepSummary, "failures", 0)  # which is the exit status of later commands
    finish(tmp_path / "0", 0, 8)
    failure = {"error": "holds a run with another seed", "overrides": ["model=haptic", "seed=5"]}
    (tmp_path / "0" / "failure.json").write_text(json.dumps(failure))
    first, second = swept(tmp_path)
    assert first["status"] == "holds a run with another seed"
    assert (first["seed"], first["vote_accuracy"]) == ("5", "")
    assert (second["seed"], second["vote_accuracy"], second["status"]) == ("0", "0.8", "done")
    assert SweepSummary.failures == 1
    assert "holds a run with another seed" in (tmp_path / "report.html").read_text()
