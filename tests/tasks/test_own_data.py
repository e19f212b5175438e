"""Recordings as users have them, from the command line: what is said first, and what is bad."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import make_photo, make_trace
from PIL import Image

from tex_lightning.core.console import console

FOLDS = 4
TINY = ("debug=tiny", "trainer.threads=1", "logger=csv", f"data.folds={FOLDS}")


def write_timed(path: Path, trace: np.ndarray, rate: int) -> None:
    """A spreadsheet of a German dataset: semicolons, decimal commas, milliseconds."""
    lines = [f"{1000 * n / rate:.3f};{value:.6f}" for n, value in enumerate(trace)]
    text = "Zeit [ms];Beschl.\r\n" + "\r\n".join(lines).replace(".", ",")
    path.write_text(text, encoding="utf-8-sig")


def slower(trace: np.ndarray) -> np.ndarray:
    """The same at 2.5 kHz; the tones of the test traces are far below half of that."""
    return trace[::4]


@pytest.fixture
def mixed(tmp_path) -> Path:
    """NPY at 10 kHz beside CSV with times and bare TXT, both at 2.5 kHz, and photos."""
    root = tmp_path / "data"
    for label in ("alpha", "beta", "gamma"):
        (root / label / "Images").mkdir(parents=True)
        (root / label / "Haptic").mkdir()
    for n in range(FOLDS):
        np.save(root / "alpha" / "Haptic" / f"{n}.npy", make_trace(0, n))
        write_timed(root / "beta" / "Haptic" / f"{n}.csv", slower(make_trace(1, n)), 2500)
        np.savetxt(root / "gamma" / "Haptic" / f"{n}.txt", slower(make_trace(2, n, 8.0)))
        for kind, label in enumerate(("alpha", "beta", "gamma")):
            Image.fromarray(make_photo(kind, n)).save(root / label / "Images" / f"{n}.png")
    return root


def options(root: Path, tmp_path: Path, name: str = "run") -> list[object]:
    common = ["data=folder", f"data.root={root}", "data.half_scale=false", *TINY]
    return [*common, f"hydra.run.dir={tmp_path / name}"]


def entry(err: str, title: str) -> str:
    """One line of the opening block, which must be there once."""
    (line,) = (line for line in err.splitlines() if line.startswith(f"{title} "))
    return line.removeprefix(title).strip()


def stamp(folder: Path) -> None:
    """Give the files of a folder times at 2.5 kHz."""
    for path in folder.glob("*.txt"):
        samples = np.loadtxt(path)
        columns = np.stack([np.arange(len(samples)) / 2500, samples]).T
        np.savetxt(path, columns, header="time x")


def results(tmp_path: Path, name: str = "run") -> dict:
    return json.loads((tmp_path / name / "results.json").read_text())


def test_mixed_rates_are_told_apart_and_said_first(cli, mixed, tmp_path, monkeypatch):
    monkeypatch.setattr(console, "width", 120)
    stamp(mixed / "gamma" / "Haptic")
    (mixed / "empty").mkdir()
    (mixed / "alpha" / "stray.wav").write_text("x")
    for name in ("alpha/Haptic/9.mp3", "beta/Haptic/9.MP3", "beta/Images/9.heic"):
        (mixed / name).write_text("x")
    outcome = cli("model=haptic", "data.val_fold=1", *options(mixed, tmp_path))
    assert outcome.status == 0, outcome.err
    assert entry(outcome.err, "Classes") == "3: alpha, beta, gamma"
    assert entry(outcome.err, "Traces") == (
        "12 files; 2.4 to 8 s each, 51.2 in all; 4 of a class; 12 groups; 1 axis; "
        "2,500 to 10,000 Hz (4 only assumed)"
    )
    assert (
        entry(outcome.err, "Folds") == "4, of which fold 0 is tested, and fold 1 chooses the epoch"
    )
    assert f"Class folder {mixed}/empty is skipped" in outcome.err
    assert "not read: 2 .mp3, 1 .heic (such as" in outcome.err
    assert "Is 10,000 Hz the rate" not in outcome.err
    assert results(tmp_path)["skipped"] == []
    predicted = cli(
        "task=predict",
        f"checkpoint={tmp_path}/run/checkpoints/haptic.ckpt",
        f"haptic=[{mixed}/beta/Haptic/0.csv,{mixed}/gamma/Haptic/0.txt]",
    )
    fragments = [json.loads(line)["fragments"] for line in predicted.out.splitlines()]
    assert fragments[1] > 3 * fragments[0]  # 8 s and 2.4 s; at 10 kHz neither gives any


@pytest.fixture
def bad(mixed) -> Path:
    """The same with a damaged trace, a short one of assumed rate, and a photo cut off."""
    stamp(mixed / "gamma" / "Haptic")
    np.savetxt(mixed / "gamma" / "Haptic" / "0.txt", np.ones(1200))
    (mixed / "alpha" / "Haptic" / "2.npy").write_bytes(b"damaged")
    photo = mixed / "beta" / "Images" / "1.png"
    photo.write_bytes(photo.read_bytes()[:5000])
    return mixed


NAMES = ("alpha/Haptic/2.npy", "beta/Images/1.png", "gamma/Haptic/0.txt")


def test_all_files_that_cannot_be_used_are_listed_at_once(cli, bad, tmp_path):
    outcome = cli("model=fusion", *options(bad, tmp_path))
    assert outcome.status == 2
    assert "Error: 3 of 24 files cannot be used" in outcome.err
    assert "data.skip_bad=true" in outcome.err
    assert all(outcome.err.count(f"{bad}/{name}") == 1 for name in NAMES)
    assert "The trace has 0.12 s of movement" in outcome.err
    assert not (tmp_path / "run" / "checkpoints").exists()


def assert_skipped(found: list[dict], root: Path, *names: str) -> None:
    assert {item["path"]: item["path"] in item["reason"] for item in found} == {
        f"{root}/{name}": True for name in names
    }


def test_every_task_can_go_on_without_bad_files(cli, bad, tmp_path):
    skip = "data.skip_bad=true"
    fitted = cli("model=haptic", skip, *options(bad, tmp_path))
    assert fitted.status == 0, fitted.err
    assert "Going on without 2 files:" in fitted.err
    assert "; 3 to 4 of a class; " in entry(fitted.err, "Traces")
    assert_skipped(results(tmp_path)["skipped"], bad, NAMES[0], NAMES[2])
    tested = (tmp_path / "run" / "predictions" / "haptic.csv").read_text()
    assert "alpha/Haptic/0.npy" in tested  # group 0 is still fold 0 ...
    assert "gamma/Haptic" not in tested  # ... and no other takes the place of one that is left out
    checkpoint = f"checkpoint={tmp_path}/run/checkpoints/haptic.ckpt"
    evaluated = cli("task=evaluate", checkpoint, skip, *options(bad, tmp_path, "evaluated"))
    assert evaluated.status == 0, evaluated.err
    assert_skipped(results(tmp_path, "evaluated")["skipped"], bad, NAMES[2])
