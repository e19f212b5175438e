"""The runner of the benchmarks; what they measure is measured by them."""

import json

import pytest

from benchmarks import __main__ as runner
from benchmarks import _run
from tex_lightning.errors import UserError


class Module:
    """Stands for a benchmark."""

    def __init__(self, figures):
        self.figures = figures

    def measure(self, **options):
        if isinstance(self.figures, Exception):
            raise self.figures
        return {**self.figures, **options}


@pytest.fixture
def measured(tmp_path, monkeypatch):
    def run(figures):
        monkeypatch.setattr(_run, "RESULTS", tmp_path)
        monkeypatch.setattr(_run, "import_module", lambda name: Module(figures))
        return _run.run_one("example")

    return run


def test_every_module_but_the_runner_is_a_benchmark():
    assert "peers" in runner.names()
    assert not any(name.startswith("_") for name in runner.names())


def test_figures_are_kept_with_machine_and_versions(measured, tmp_path):
    measured({"a_ms": 2.0})
    kept = json.loads((tmp_path / "example.json").read_text())
    assert kept["figures"] == {"a_ms": 2.0}
    assert kept["environment"]["versions"]["torch"]
    assert kept["date"]


def test_the_table_has_ratios_first_and_flattens_what_is_nested(measured):
    result = measured({"a_ms": 2.0, "part": {"gain_ratio": 3.14159, "list": [1]}, "ok": True})
    assert runner.rows(result) == [("part.gain_ratio", "3.142"), ("a_ms", "2"), ("ok", "True")]


def test_what_cannot_be_measured_here_says_why(measured):
    result = measured(UserError("It needs another library."))
    assert runner.rows(result) == [("not run", "It needs another library.")]


def test_a_name_that_there_is_not_is_refused(capsys):
    assert runner.main(["speeed"]) == 2
    assert "There is no benchmark speeed; choose from" in capsys.readouterr().out


def test_options_reach_the_benchmark(tmp_path, monkeypatch):
    monkeypatch.setattr(_run, "RESULTS", tmp_path)
    monkeypatch.setattr(_run, "import_module", lambda name: Module({}))
    assert _run.run_one("faults", {"rounds": "2"})["figures"] == {"rounds": "2"}
