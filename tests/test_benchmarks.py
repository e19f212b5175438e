"""The runner of the benchmarks; what they measure is measured by them."""

import math
import shutil
import time
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.signal import welch
from scipy.stats import binomtest, multinomial

from benchmarks import __main__ as runner
from benchmarks import _peers, accuracy, adaptation, device, drifting, shapes, shifts
from benchmarks._changes import Item, apply
from benchmarks._classifiers import make_classifier
from benchmarks._field import spread
from benchmarks._paired import Cell, compare, paired_interval, to_table
from tex_lightning.data.recordings import Recording
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.studies.profile import only_sense


def test_every_module_but_the_runner_is_a_benchmark(capsys):
    assert "startup" in runner.names()
    assert not any(name.startswith("_") for name in runner.names())
    assert runner.main(["speeed"]) == 2
    assert "There is no benchmark speeed; choose from" in capsys.readouterr().out
    assert runner.main(["engine", "--thread=1"]) == 2
    assert "Error: engine takes no option --thread; see --help." in capsys.readouterr().out


TABLE = """
common: [task=fit, data.val_fold=null, verbose=0, "data.cache_dir=CACHE"]
protocols:
  first: {first: 3}
  lamp: {tests: [{lamp: a}]}
data:
  waves: {reads: [data=folder, "data.root=$DATA"], modality: haptic, every: 2, protocols: [first]}
  lamps:
    reads: [data=manifest, "data.manifest=$DATA/lamps.csv"]
    modality: haptic
    window: 16000
    balanced: true
    protocols: [lamp]
classifiers: [&own {_target_: benchmarks._peers.OwnHead}]
systems:
  haptic:
    bands: [model=band_proportions]
    log_bands: {features: log_bands, classifier: {_target_: sklearn.linear_model.RidgeClassifierCV}}
    log_mel: {features: log_mel, pieces: 0.5, slow: true, classifier: *own}
    signals: {classifier: {_target_: sklearn.linear_model.RidgeClassifier}}
    broken: [model=mfcc_nb, "data.channels=[7]"]
field: [{data: lamps, protocol: lamp, title: lamps}, {data: none, protocol: lamp, title: none}]
ours: [ours]
names: {bands: ours, log_bands: a peer, log_mel: a peer}
"""


@pytest.mark.slow
def test_adaptation_to_draws_of_what_is_tested(surfaces, tmp_path):
    table = tmp_path / "table.yaml"
    table.write_text(TABLE)
    figures = adaptation.measure(data=str(surfaces), only="waves", table=str(table))
    kinds = {"all", "half", "two", "one", "ten", "common", "unknown", "unknown_some"}
    kinds |= {"unknown_told", "unknown_some_told"}
    assert {*figures} == {f"waves.first.{kind}" for kind in kinds}
    assert figures["waves.first.all"].startswith("100.0% -> 100.0% (21 -> 21 of 21), adapted ")
    assert "of 14), adapted " in figures["waves.first.unknown"]


@pytest.mark.slow
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
    assert figures["waves.first.log_mel"].startswith("100.0% (11/11), fit ")
    assert figures["best peer of waves.first"].split(",")[0] in {"log_bands", "log_mel"}
    assert figures["lamps.lamp.signals"].startswith("failed: ValueError")
    assert figures["waves.first.broken"].startswith("failed: ")
    assert "data.channels" in figures["waves.first.broken"]
    assert figures["chosen without lamps"].startswith("bands, ")
    lines = (tmp_path / "out" / "accuracy.md").read_text().splitlines()
    assert len(lines) == 2 + 10
    assert (tmp_path / "out" / "field.png").stat().st_size > 1000

    monkeypatch.setattr(accuracy, "run_package", lambda *_: pytest.fail("runs again"))
    again = accuracy.measure(**where, only="waves,ba,log_bands")
    assert again.items() <= figures.items()
    assert len(again) == 2 + 2
    with pytest.raises(UserError, match="nothing begins no name; choose from bands, "):
        accuracy.measure(**where, only="nothing")


def test_a_cell_that_takes_too_long_is_given_up():
    with pytest.raises(UserError, match=r"more than 0\.05 s"), accuracy.limited(0.05):
        time.sleep(5)


def test_pieces_of_a_recording_answer_together_and_groups_are_left_out_whole():
    rng, told = (
        np.random.default_rng(0),
        {"features": "log_mel", "pieces": 0.1, "standardised": True},
    )
    ridge = {"_target_": "sklearn.linear_model.RidgeClassifierCV"}
    peer = _peers.Peer({**told, "classifier": ridge})
    slow = [(5 + rng.normal(size=(2, 400)).cumsum(axis=1), 1000.0) for _ in range(4)]
    quick = [(rng.normal(size=(2, 400)), 1000.0) for _ in range(4)]
    peer.fit([*slow[:3], *quick[:3]], ["slow"] * 3 + ["quick"] * 3, "abcdef")
    assert [len(peer.pieces(signal)) for signal in (slow[0], (slow[0][0][:, :40], 1000.0))] == [
        4,
        1,
    ]
    np.testing.assert_allclose([x.mean(axis=1) for x, _ in peer.pieces(slow[0])], 0, atol=1e-9)
    assert [peer.predict(signal) for signal in (slow[3], quick[3])] == ["slow", "quick"]
    parts = peer.model.cv.test_fold.reshape(6, 4)  # four pieces of a recording share its part
    assert (parts == parts[:, :1]).all()


def test_balanced_scores_have_the_interval_of_as_many_equal_classes():
    equal = [("x", "xy"[n % 2], 1.0) for n in range(20)] + [
        ("y", "xy"[n % 2], 1.0) for n in range(20)
    ]
    expected = wilson_interval(20, 40)
    for balanced in (False, True):
        assert accuracy.interval(equal, balanced) == pytest.approx(expected, abs=1e-6)
    low, high = accuracy.interval([*equal, *equal[:20] * 9], balanced=True)
    assert expected[0] < low < high < expected[1]
    assert accuracy.interval([("x", "x", 1.0)] * 10, False)[1] == pytest.approx(1)


def test_names_beside_a_chart_keep_their_distance_and_their_order():
    places = spread(np.array([0.98, 0.97, 0.5, 0.3, 0.02, 0.01]), 0.1)
    assert np.diff(places).max() <= -0.1 + 1e-9
    np.testing.assert_allclose(places, [1, 0.9, 0.5, 0.3, 0.1, 0], atol=1e-9)
    np.testing.assert_allclose(spread(np.array([0.5, 0.5]), 0.1), [0.55, 0.45])


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
    draws = tested({"drawn": 3, "times": 20})
    assert [len(draw) for draw in draws] == [1] * 20
    assert {number for draw in draws for number in draw} == {10, 2, 3, 1}
    assert tested({"folds": 2}) == [[3, 1], [10, 2]]
    assert tested({"tests": [{"lamp": "b"}, {"lamp": ["a", "b"]}]}) == [[3, 1], [10, 2, 3, 1]]


def test_balanced_scores_are_means_of_the_classes():
    tested = [("x", "x", 1.0)] * 3 + [("y", "x", 1.0)]
    assert [accuracy.score(tested, balanced) for balanced in (False, True)] == [0.75, 0.5]


def test_a_recording_that_is_tested_again_makes_no_interval_smaller():
    once = [("x", "x", 1.0)] * 3 + [("y", "x", 1.0)]
    low, high = binomtest(3, 4).proportion_ci(method="wilson")
    for times in (1, 5):
        found = accuracy.interval(times * once, False, times)
        np.testing.assert_allclose(found, (low, high), rtol=1e-6)


SHAPES = """
common: [task=fit, data.val_fold=null, logger=csv, verbose=0]
data:
  waves:
    reads: [data=folder, "data.root=$DATA"]
    divide: {haptic: {train: 4, every: 3}}
    models: [bands]
models:
  bands: {overrides: [model=band_proportions], once: true}
shapes:
  any: {unchanged: {}}
  haptic: {test_tiny: {test: {cut: {value: 0.01, count: 1}}}, test_flat: {test: {flat: null}}}
"""


@pytest.mark.slow
def test_shapes_are_compared_with_the_unchanged_data(surfaces, tmp_path, monkeypatch):
    table = tmp_path / "table.yaml"
    table.write_text(SHAPES)
    where = {"data": str(surfaces), "table": str(table), "out": str(tmp_path / "out")}
    figures = shapes.measure(**where)
    assert figures["waves.unchanged.bands"] == "6/6"
    assert figures["waves.test_flat.bands"].startswith("2/6, -66.7 (")
    assert figures["waves.test_tiny.bands"].startswith("refused: 1 of 6 files cannot be used")
    assert str(tmp_path) not in figures["waves.test_tiny.bands"]

    monkeypatch.setattr(shapes, "classify", lambda *_: pytest.fail("runs again"))
    again = shapes.measure(**where, models="bands", only="test_f", before=where["out"])
    assert again.items() <= figures.items()
    assert len(again) == 2 + 1
    table, results = (tmp_path / "out" / f"shapes.{kind}" for kind in ("md", "csv"))
    assert table.read_text().startswith("| set | shape | bands before | bands |")
    assert len(results.read_text().splitlines()) == 1 + 3
    with pytest.raises(UserError, match="tset begins no name; choose from test_flat, test_tiny, "):
        shapes.measure(**where, only="tset")


def test_shapes_that_lose_significantly_are_bold():
    def results(*hits):
        outcomes = {str(n): ("x", "xy"[not hit]) for n, hit in enumerate(hits)}
        return {"outcomes": outcomes, "said": "", "fit_seconds": 1.0}

    lines = compare({
        Cell("set", "unchanged", "model"): results(*[True] * 20),
        Cell("set", "five", "model"): results(*[False] * 5, *[True] * 15),
        Cell("set", "six", "model"): results(*[False] * 6, *[True] * 14),
        Cell("set", "back", "model", "six"): results(*[True] * 20),
        Cell("set", "none", "model"): {"said": "refused: no\n- a_b"},
    })  # fmt: skip
    assert [(line["lost"], line["gained"]) for line in lines[:4]] == [
        (0, 0),
        (5, 0),
        (6, 0),
        (0, 6),
    ]
    *_, five, six, back, none = to_table(lines, lines[:1]).splitlines()
    assert five.startswith("| set | five |  | 15/20, -25.0 (-4")
    assert six.startswith("| set | six |  | **14/20, -30.0 (-")
    assert back.startswith("| set | back (than six) |  | 20/20, +30.0 (")
    assert none == "| set | none |  | refused: no - a_b |"


def items(modality="haptic", axes=1, rate=1000.0):
    """Two classes with six recordings each: two of training, two tested, two spare."""
    rng = np.random.default_rng(0)
    array = (axes, 2000) if modality == "haptic" else (40, 60, 3)
    return [
        Item(
            f"{label}{n}", label, n, ("train", "test", "spare")[n // 2], modality,
            rng.standard_normal(array) if rate else rng.integers(256, size=array, dtype=np.uint8),
            rate,
        )
        for label in "xy"
        for n in range(6)
    ]  # fmt: skip


def test_every_shape_of_the_table_gives_recordings():
    settings = accuracy.yaml.safe_load(Path(shapes.__file__).with_suffix(".yaml").read_text())
    signals, photos = items(axes=3), items("image", rate=0.0)
    for kind, lines in settings["shapes"].items():
        unchanged = photos if kind == "image" else signals
        for name, line in lines.items():
            changes = {part: steps for part, steps in line.items() if part != "base"}
            changed = apply(changes, unchanged, name)
            assert {item.part for item in changed} == {"train", "test"}, name
            assert len({item.key for item in changed}) == len(changed), name
            assert all(np.isfinite(item.array).all() and item.array.size for item in changed), name
            before = {item.key: item for item in unchanged}
            if {*changes} == {"test"}:
                kept = [item for item in changed if item.part == "train"]
                assert all(item is before[item.key] for item in kept), name


def changed(part, **steps):
    return apply({part: steps}, items(), "name")


def test_changes_of_signals_are_what_they_say():
    (before, *_), (*_, hummed) = items(), changed("test", hum={"value": 20, "hertz": 60})
    tone = np.abs(np.fft.rfft(hummed.array[0]))
    assert np.fft.rfftfreq(2000, 1e-3)[tone.argmax()] == 60
    (unhummed,) = [item for item in items() if item.key == hummed.key]
    noise = (hummed.array - unhummed.array).var() / unhummed.array.var()
    assert 10 * math.log10(noise) == pytest.approx(-20, abs=0.1)

    rested = changed("train", rest={"value": 0.5, "place": "middle"})[-1].array
    assert rested.shape == (1, 2500)
    assert rested[0, 1000:1500].std() == pytest.approx(before.array.std() / 100, rel=0.2)
    faster = changed("all", at_rate=2)[0]
    assert (faster.rate, faster.array.shape) == (2000.0, (1, 4000))
    assert changed("all", cut=0.3)[0].array.shape == (1, 300)
    loud = changed("all", by_class={"value": "gain", "low": 0.1, "high": 10})
    ratios = {x.label: x.array.std() for x in loud if x.key in ("x0", "y0")}
    assert ratios["y"] / ratios["x"] == pytest.approx(100, rel=0.1)


def test_changes_of_lists_are_what_they_say():
    def trained(**steps):
        return sorted(x.key for x in changed("all", **steps) if x.part == "train")

    assert trained(first=1) == ["x0", "y0"]
    assert trained(first=4) == ["x0", "x1", "x4", "x5", "y0", "y1", "y4", "y5"]
    assert trained(first={"value": 1, "classes": 1}) == ["x0", "y0", "y1"]
    assert trained(unequal=[3, 1]) == ["x0", "x1", "x4", "y0"]
    assert {x.group for x in changed("train", one_group=None) if x.part == "train"} == {"monday"}
    labels = [x.label != x.key[0] for x in changed("train", wrong_labels=0.5)]
    assert sum(labels) == 2
    files = {x.key: x.array.shape[1] for x in changed("test", joined=1) if x.part == "test"}
    assert files == {"x2": 5000, "y2": 5000}
    assert sum(np.ptp(x.array) == 0 for x in changed("train", flat={"count": 1})) == 1
    assert {x.label for x in changed("all", named="odd")} == {"1_0", "1e3"}


@pytest.mark.parametrize(("lost", "gained"), [(0.02, 0.02), (0.1, 0.02), (0.3, 0.2)])
def test_intervals_of_paired_differences_hold_their_level(lost, gained):
    count, covered = 60, 0.0
    for b, c in product(range(count + 1), repeat=2):
        if b + c <= count:
            _, low, high = paired_interval(b, c, count)
            chance = multinomial.pmf(
                [b, c, count - b - c], count, [lost, gained, 1 - lost - gained]
            )
            covered += chance * (low <= gained - lost <= high)
    assert 0.94 < covered < 0.998


def test_help_says_what_a_benchmark_does(capsys):
    assert runner.main(["accuracy", "--help"]) == 0
    assert "--only" in capsys.readouterr().out


def test_a_turned_signal_keeps_its_length_and_a_fast_clock_its_seconds():
    signal = np.stack([np.sin(np.arange(400) / 20), np.cos(np.arange(400) / 20), np.ones(400)])
    turned = shifts.turned(signal, 30, 1)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=0), np.linalg.norm(signal, axis=0))
    cosines = (turned * signal).sum(axis=0) / (signal**2).sum(axis=0)
    assert math.cos(math.radians(30)) - 1e-9 <= cosines.min() < 0.999
    faster = shifts.clocked(signal, 1.05)
    assert faster.shape == (3, 419)
    np.testing.assert_allclose(faster[0], np.sin(np.arange(419) / 21), atol=1e-3)


def test_spectra_of_drifting_textures_are_those_of_their_strokes():
    textures, rng = drifting.Textures(2), np.random.default_rng(0)
    slow = (0.5, 0.5 + 1e-9)
    strokes = [textures.stroke(1, rng, slow) for _ in range(20)]
    _, powers = zip(*(welch(x, drifting.RATE, nperseg=64) for x in strokes), strict=True)
    conditions = np.array([[math.log(0.5), force] for force in np.linspace(-0.9, 0.9, 20)])
    expected = textures.spectra(1, conditions).mean(axis=0)
    shape = np.log(np.mean(powers, axis=0))[2:-2] - expected[2:-2]
    assert np.std(shape) < 0.35 < np.std(expected)


def test_a_device_without_cuda_has_a_row_for_what_takes_it(tmp_path):
    few = "debug=tiny data.classes=3 data.synthetic.recordings=4 data.folds=4"
    given = f"{few} data.cache_dir={tmp_path} profile.budget_s=0.01"
    figures = device.measure("model=haptic", given, accelerator="cpu", batch="2")
    assert figures["device"] == "cpu"
    haptic = figures["haptic"]["haptic"]
    missing = {key for key, value in haptic.items() if value == device.NO_CUDA}
    precisions = {f"steps_per_s_{name}" for name in ("tf32", "bf16", "fp16")}
    assert missing == {"copies_per_label", "copies_per_step", *precisions}
    assert {*haptic} - missing - {"batch_ms"} == {
        "fit_s", "steps_per_s", "label_ms", "label_p95_ms", "recordings_per_s",
        "dense_ms", "windows_ms", "dense_speedup", "dense_speedup_same_engine",
    }  # fmt: skip
    assert haptic["dense_speedup"] == pytest.approx(haptic["windows_ms"] / haptic["dense_ms"])
    assert [name for name, ms in haptic["batch_ms"].items() if ms != device.NO_CUDA] == ["fp32"]


def test_copies_of_a_profile_are_those_between_cpu_and_gpu():
    def event(key, count, microseconds):
        return SimpleNamespace(key=key, count=count, self_device_time_total=microseconds)

    found = device.copies(
        [
            event("Memcpy HtoD (Pageable -> Device)", 3, 500.0),
            event("Memcpy HtoD (Pinned -> Device)", 1, 1500.0),
            event("Memcpy DtoD (Device -> Device)", 9, 9.0),
            event("Memcpy DtoH (Device -> Pageable)", 2, 100.0),
        ],
        calls=2,
    )
    assert found == {"to": 2, "to_ms": 1, "from": 1, "from_ms": 0.05}


@torch.inference_mode()
def test_passes_of_other_precisions_and_layouts_give_the_same_scores():
    sense = only_sense(make_classifier("model=haptic", "model.haptic.width=0.1"))
    x = device.network_inputs(sense, torch.randn(1, 30_000), 2)
    ways = device.passes(sense, x)
    expected = ways.pop("fp32")()
    assert expected.shape[0] == 2
    assert ways.keys() == {"tf32", "bf16", "fp16", "compiled", "channels_last"}
    for name in ("tf32", "bf16", "channels_last"):  # the others take a compiler or long on a CPU
        torch.testing.assert_close(ways[name]().float(), expected, rtol=0.1, atol=0.1)
