"""The opening block: once for a task, however many systems it opens, and never too long."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from PIL import Image

from tex_lightning.config import CONF, Config, register
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.recordings import Note, Recording, Recordings
from tex_lightning.data.store import Store, Unusable
from tex_lightning.studies.console_summary import Opening


@pytest.fixture(scope="module")
def config() -> Config:
    register()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        composed = compose("config", overrides=["task=frontier", "data=folder", "data.root=DIR"])
    return OmegaConf.to_object(composed)


@pytest.fixture
def store(tmp_path):
    decoders = {"haptic": SignalDecoder(), "image": PhotoDecoder(half_scale=False)}
    return Store(tmp_path / "cache", decoders)


@pytest.fixture
def rows(tmp_path):
    np.save(tmp_path / "t.npy", np.ones(30_000))
    Image.new("RGB", (400, 300)).save(tmp_path / "p.png")
    notes = (Note("class folder", 1, "Class folder x is skipped: it is empty."),)
    traces = [Recording(f"class{n}", "haptic", tmp_path / "t.npy", n) for n in range(60)]
    photos = [Recording(f"class{n}", "image", tmp_path / "p.png", n) for n in range(60)]
    return Recordings((*traces, *photos), notes)


def test_the_block_fits_a_terminal_whatever_it_lists(config, store, rows):
    deep = replace(config.data, root="/very/long" * 20 + "/end")
    systems = list(config.frontier.systems)
    opening = Opening(deep, f"{len(systems)} systems: {', '.join(systems)}", range(10))
    many = tuple(Note(f"kind {n} of folder", n, "") for n in range(9))
    lines = opening.lines(replace(rows, notes=many), store, [])
    assert len(lines) <= 12
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("Data      folder …")
    assert lines[0].endswith("long/end")
    text = " ".join(" ".join(line.split()) for line in lines)
    assert "Classes 60: class0, class1" in text
    assert "Traces 60; 3 s; 1 of a class" in text
    assert "Photos 60; 0.12 megapixels; 1 of a class" in text
    assert "Rates 60 x 10,000 Hz assumed (data.file_rate)" in text
    assert "Folds 108 recordings train, 12 test (each of 10 folds of 10)" in text
    assert f"Trains {len(config.frontier.systems)} systems: bands, hapticnet" in text


def test_a_long_path_of_a_checkpoint_is_known_by_its_end(config, store, rows):
    file = "/very/long" * 9 + "/checkpoints/haptic.ckpt"
    (line,) = [
        line for line in Opening(config.data, file).lines(rows, store, []) if "Tests" in line
    ]
    assert line.startswith("Tests     …")
    assert line.endswith("/long/checkpoints/haptic.ckpt")
    assert len(line) == 80


def test_a_family_announces_each_sense_and_each_left_out_file_once(
    config, store, rows, caplog, capsys
):
    traces, photos = rows.of("haptic"), rows.of("image")
    one, other = (
        Unusable(row, f"{row.path} is broken") for row in (traces.rows[0], photos.rows[0])
    )
    opening = Opening(config.data, "two systems", [0])
    opening.announce(traces, store, [one])
    opening.announce(traces, store, [one])
    assert capsys.readouterr().err.count("Data ") == 1
    opening.announce(rows, store, [one, other])
    opening.announce(photos, store, [other])
    second = capsys.readouterr().err
    assert second.count("Photos ") == 1
    assert "Traces " not in second
    assert caplog.text.count("t.npy is broken") == 1
    assert caplog.text.count("p.png is broken") == 1
    assert caplog.text.count("Class folder x is skipped") == 1


def test_a_note_on_one_modality_is_for_those_who_read_it_and_may_leave_nothing_out(
    config, store, rows, caplog, capsys
):
    rows = replace(rows, notes=(Note("divided photo", 0, "Photos are divided.", "image"),))
    opening = Opening(config.data, "two systems", [0])
    opening.announce(rows.of("haptic"), store, [])
    assert "divided" not in caplog.text
    opening.announce(rows, store, [])
    opening.announce(rows, store, [])
    assert caplog.text.count("Photos are divided.") == 1
    assert "divided photo" not in capsys.readouterr().err


def test_nothing_usable_is_announced_as_nothing(config, store):
    lines = Opening(config.data, "nothing").lines(Recordings(()), store, [])
    assert lines[1] == "Classes   0:"


def test_copies_and_mixed_rates_are_said_before_training(config, store, tmp_path, caplog):
    rng = np.random.default_rng(0)
    rows = []
    for number, rate in enumerate((10_000.0, 10_000.0, 5_000.0)):
        np.save(tmp_path / f"{number}.npy", rng.standard_normal(20_000))
        path = tmp_path / f"{number}.npy"
        rows.append(Recording("a", "haptic", path, number, rate, fold=number))
    shutil.copy(rows[0].path, tmp_path / "copy.npy")
    rows.append(Recording("a", "haptic", tmp_path / "copy.npy", 1, 10_000.0, fold=1))
    Opening(config.data, "a system", [0]).announce(Recordings(tuple(rows)), store, [])
    assert "1 of 4 traces have a lower rate than the 10,000 Hz of others" in caplog.text
    assert "0.npy and " in caplog.text
    assert "copy.npy have the same content, but are in the folds 0 and 1" in caplog.text
