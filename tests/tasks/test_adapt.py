"""task=adapt, adapt=true and Estimator.adapt: recordings without labels that help."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tex_lightning as tl
from tex_lightning.classifier.card import NOVELTIES

RATE, BANDS, CLASSES, EACH = 2000, 12, 6, 20


def trace(kind: int, number: int) -> np.ndarray:
    """A second of noise, whose spectrum tells the class and varies in three more directions."""
    rng = np.random.default_rng(7)
    classes, drift = rng.standard_normal((9, BANDS)), rng.standard_normal((3, BANDS))
    rng = np.random.default_rng([kind, number, 2])
    gains = 0.8 * classes[kind] + 0.2 * rng.standard_normal(3) @ drift
    noise = np.fft.rfft(rng.standard_normal(RATE))
    places = np.linspace(0, BANDS - 1, len(noise))
    return np.fft.irfft(noise * np.exp(np.interp(places, np.arange(BANDS), gains))) / 40


@pytest.fixture(scope="module")
def strokes(tmp_path_factory) -> Path:
    """``known``, one recording of each class, and ``others``, many without labels."""
    root = tmp_path_factory.mktemp("strokes")
    (root / "others").mkdir()
    for kind in range(CLASSES):
        (root / f"known/{kind}").mkdir(parents=True)
        soundfile.write(root / f"known/{kind}/0.wav", trace(kind, 0), RATE, "FLOAT")
        for number in range(1, EACH + 1):
            path = root / f"others/{number}_{kind}.wav"
            soundfile.write(path, trace(kind, number), RATE, "FLOAT")
    return root


@pytest.fixture(scope="module")
def trained(run_once, strokes) -> Path:
    given = ("experiment=few/haptic", "data=folder", f"data.root={strokes}/known")
    return run_once(*given, "data.test_fold=null")


@pytest.fixture(scope="module")
def adapted(run_once, strokes, trained) -> Path:
    return run_once("task=adapt", f"checkpoint={trained}", f"haptic={strokes}/others")


def errors(lines: str) -> int:
    said = [json.loads(line) for line in lines.splitlines()]
    assert len(said) == CLASSES * EACH
    return sum(Path(x["haptic"]).stem[-1] != x["label"] for x in said)


def test_files_without_labels_help(strokes, trained, adapted, cli):
    files = f"haptic={strokes}/others"
    before, after = (cli("task=predict", f"checkpoint={x}", files) for x in (trained, adapted))
    assert before.status == after.status == 0
    assert errors(before.out) > 5
    assert errors(after.out) == 0
    results = json.loads((adapted / "results.json").read_text())
    entry = results["networks"]["haptic"]
    assert (results["task"], entry["adapted"], entry["reason"]) == ("adapt", True, None)
    assert entry["recordings"] == CLASSES * EACH
    assert set(entry["taught"]) == {*map(str, range(CLASSES))}
    assert entry["changed"] == errors(before.out)
    assert tl.load(adapted).classifier.rows["haptic"].labels.tolist() == [*range(CLASSES)]


def test_many_files_are_adapted_to_before_they_are_classified(strokes, trained, adapted, cli):
    whole = cli("task=predict", f"checkpoint={adapted}", f"haptic={strokes}/others")
    files = [str(path) for path in sorted((strokes / "others").iterdir(), reverse=True)]
    asked = ("task=predict", f"checkpoint={trained}", "adapt=true")
    outcome = cli(*asked, f"haptic=[{','.join(files)}]")
    assert outcome.status == 0, outcome.err
    assert "Adapted to 120 recordings" in outcome.err
    told = [
        {x["haptic"]: x["probabilities"] for x in map(json.loads, lines.splitlines())}
        for lines in (whole.out, outcome.out)
    ]
    assert told[0].keys() == told[1].keys()
    for file, found in told[
        0
    ].items():  # in any order, but for rounding by another number of threads
        assert found == pytest.approx(told[1][file], rel=1e-6)
    few = cli(*asked, f"haptic=[{','.join([*files[:4], str(strokes / 'gone.wav')])}]")
    assert few.status == 2
    assert len(few.out.splitlines()) == 4
    assert "Nothing was adapted: of 4 recordings only" in few.err


def test_a_file_that_is_too_short_does_not_stop_the_others(strokes, trained, cli, tmp_path):
    soundfile.write(tmp_path / "short.wav", trace(0, 0)[:40], RATE, "FLOAT")
    files = [tmp_path / "short.wav", *sorted((strokes / "others").iterdir())[:4]]
    given = f"haptic=[{','.join(map(str, files))}]"
    outcome = cli("task=predict", f"checkpoint={trained}", "adapt=true", given)
    assert outcome.status == 2
    assert len(outcome.out.splitlines()) == 4
    assert "of 4 recordings only" in outcome.err
    assert "short.wav: The signal has 0.02 s of movement" in outcome.err


def test_a_data_set_gives_what_was_not_trained_on(strokes, trained, cli, tmp_path):
    lines = ["label,modality,path,group,session"]
    lines += [f"{n},haptic,{strokes}/known/{n}/0.wav,{n},1" for n in range(CLASSES)]
    lines += [f"any,haptic,{path},{path.stem},2" for path in (strokes / "others").iterdir()]
    (tmp_path / "all.csv").write_text("\n".join(lines))
    data = ("task=adapt", f"checkpoint={trained}", "data=manifest",
            f"data.manifest={tmp_path}/all.csv")  # fmt: skip
    outcome = cli(*data, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 0, outcome.err
    assert "Adapted to 120 recordings" in outcome.err
    again = cli(*data, "data.test_where={session: 1}", f"hydra.run.dir={tmp_path}/none")
    assert again.status == 2
    assert "nothing to adapt to" in again.err


def test_a_checkpoint_that_stays_as_it_was_is_written_all_the_same(strokes, trained, cli, tmp_path):
    files = [str(path) for path in sorted((strokes / "others").iterdir())[:10]]
    run = f"hydra.run.dir={tmp_path}/run"
    outcome = cli("task=adapt", f"checkpoint={trained}", f"haptic=[{','.join(files)}]", run)
    assert outcome.status == 0, outcome.err
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert (results["model"], results["data"]) == (
        "band_proportions",
        None,
    )  # files are no data set
    entry = results["networks"]["haptic"]
    assert not entry["adapted"]
    assert entry["reason"] in outcome.err
    one, other = (
        cli("task=predict", f"checkpoint={x}", f"haptic={files[0]}").out
        for x in (trained, tmp_path / "run")
    )
    assert json.loads(one)["probabilities"] == json.loads(other)["probabilities"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["task=adapt", "checkpoint={untrained}/checkpoints/haptic.ckpt"], "not fitted in closed"),
        (["task=adapt", "checkpoint={naive_bayes}"], "This is a mfcc_nb, and task=adapt fits"),
        (["task=adapt", "checkpoint={trained}", "image=A.png"], "does not look at image"),
        (["task=evaluate", "checkpoint={trained}", "adapt=true"], "adapt is read by task=predict"),
    ],
)
def test_what_cannot_be_meant_is_said(
    trained, untrained, naive_bayes, strokes, cli, tmp_path, given, said
):
    places = {"trained": trained, "untrained": untrained, "naive_bayes": naive_bayes}
    given = [each.format(**places) for each in given]
    files = [] if "image=A.png" in given or "adapt=true" in given else [f"haptic={strokes}/others"]
    outcome = cli(*given, *files, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 2, outcome.err
    assert said in " ".join(outcome.err.split())


def test_what_is_called_unknown_on_the_command_line_is_not_learnt_from(
    strokes, trained, cli, tmp_path
):
    model, told = tl.load(trained), "decision.unknown=0.05"
    model.classifier.card = replace(model.card, calibration={NOVELTIES: {"haptic": [0.0]}})
    model.classifier.save(tmp_path / "strict.ckpt")  # everything is unknown
    given = f"checkpoint={tmp_path}/strict.ckpt", f"haptic={strokes}/others", told
    run = "task=adapt", f"hydra.run.dir={tmp_path}/run"
    for task in (run, ("task=predict", "adapt=true")):
        outcome = cli(*task, *given)
        assert outcome.status == 0, outcome.err
        said = " ".join(outcome.err.split())
        assert "Nothing was adapted: there are no recordings of known classes" in said
    estimator = tl.Estimator.load(tmp_path / "strict.ckpt", rate=RATE, **{"decision.unknown": 0.05})
    with pytest.warns(UserWarning, match="no recordings of known classes"):
        estimator.adapt([trace(0, 1), trace(1, 1)])


def test_the_estimator_adapts(trained):
    model = tl.Estimator.load(trained, rate=RATE)
    kinds = np.repeat([*map(str, range(CLASSES))], EACH)
    others = [trace(n // EACH, 1 + n % EACH) for n in range(len(kinds))]
    before = model.score(others, kinds)
    assert model.adapt(others) is model
    assert model.score(others, kinds) == 1 > before
    assert not model.adaptation_.reason
    with pytest.warns(UserWarning, match="Nothing was adapted: of 10 recordings"):
        model.adapt(others[::12])
    assert model.score(others, kinds) == 1
