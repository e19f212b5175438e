"""The runner of the benchmarks; what they measure is measured by them."""

import shutil
from pathlib import Path

import pytest

from benchmarks import __main__ as runner
from benchmarks import accuracy
from tex_lightning.data.recordings import Recording
from tex_lightning.errors import UserError


def test_every_module_but_the_runner_is_a_benchmark(capsys):
    assert "startup" in runner.names()
    assert not any(name.startswith("_") for name in runner.names())
    assert runner.main(["speeed"]) == 2
    assert "There is no benchmark speeed; choose from" in capsys.readouterr().out


TABLE = """
common: [task=fit, data.val_fold=null, verbose=0, "data.cache_dir=CACHE"]
protocols:
  first: {first: 3}
  lamp: {tests: [{lamp: a}]}
data:
  waves: {reads: [data=folder, "data.root=$DATA"], modality: haptic, protocols: [first]}
  lamps:
    reads: [data=manifest, "data.manifest=$DATA/lamps.csv"]
    modality: haptic
    window: 16000
    balanced: true
    protocols: [lamp]
systems:
  haptic: {bands: [model=haptic_bands], log_bands: [], broken: [model=mfcc_nb, "data.channels=[7]"]}
"""


def test_accuracy_of_systems_by_data_set_and_protocol(surfaces, cache, tmp_path, monkeypatch):
    data, table = tmp_path / "data", tmp_path / "table.yaml"
    shutil.copytree(surfaces, data)
    files = [file for file in sorted(data.glob("*/haptic/*")) if int(file.stem[-1]) < 4]
    lines = [f"{x.parts[-3]},haptic,{x},{x.stem[-1]},{'ab'[int(x.stem[-1]) % 2]}" for x in files]
    (data / "lamps.csv").write_text("\n".join(["label,modality,path,group,lamp", *lines]))
    table.write_text(TABLE.replace("CACHE", str(cache)))
    where = {"data": str(data), "out": str(tmp_path / "out"), "table": str(table)}
    figures = accuracy.measure(**where, choose="bands,log_bands")
    assert figures["waves.first.bands"].startswith("100.0% (21/21), fit ")
    assert "/6), fit " in figures["lamps.lamp.log_bands"]
    assert figures["waves.first.broken"].startswith("failed: ")
    assert "data.channels" in figures["waves.first.broken"]
    assert figures["chosen without lamps"].startswith("bands, ")
    lines = (tmp_path / "out" / "accuracy.md").read_text().splitlines()
    assert len(lines) == 2 + 6
    assert (tmp_path / "out" / "accuracy.png").stat().st_size > 1000

    monkeypatch.setattr(accuracy, "run_package", lambda *_: pytest.fail("runs again"))
    again = accuracy.measure(**where, only="waves,ba,log_bands")
    assert again.items() <= figures.items()
    assert len(again) == 2 + 1
    with pytest.raises(UserError, match="nothing begins no name; choose from bands, "):
        accuracy.measure(**where, only="nothing")


def test_rows_are_divided_by_group_by_number_and_by_condition():
    rows = [
        Recording(label, "haptic", Path(f"{label}{n}.wav"), n, None, (("lamp", "ab"[n % 2]),))
        for label in "xy"
        for n in (10, 2, 3, 1)
    ]

    def tested(division):
        masks = accuracy.divide(rows, division)
        return [[rows[n].group for n in range(4) if mask[n]] for mask in masks]

    assert tested({"first": 3}) == [[10]]
    assert tested({"folds": 2}) == [[10, 2], [3, 1]]
    assert tested({"tests": [{"lamp": "b"}, {"lamp": ["a", "b"]}]}) == [[3, 1], [10, 2, 3, 1]]


def test_balanced_scores_are_means_of_the_classes():
    tested = [("x", "x", 1.0)] * 3 + [("y", "x", 1.0)]
    assert [accuracy.score(tested, balanced) for balanced in (False, True)] == [0.75, 0.5]
